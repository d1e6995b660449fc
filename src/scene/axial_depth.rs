//! Depths along the view axis from depths along the rays.

use burn::tensor::Tensor;

use super::{Camera, Detach, visit_camera};
use crate::error::Result;
use crate::geometry::Context;

impl Camera {
    /// Returns the depths along the view axis (PyTorch3D's `zbuf`, a rasteriser's depth) for depths along the rays
    /// (`Image::depth`), both `[H, W]` in scene units: each depth is multiplied by the cosine between its pixel's
    /// ray and the axis. The result is in the graph of the depths, not of the camera.
    ///
    /// # Errors
    /// If the camera is not valid.
    pub fn axial_depth(&self, depth: Tensor<2>) -> Result<Tensor<2>> {
        self.check(None)?;
        let [height, width] = depth.dims();
        if self.projection.is_parallel() || height == 0 || width == 0 {
            return Ok(depth);
        }
        let context = Context {
            device: depth.device().inner(),
            dtype: depth.dtype(),
        };
        let mut camera = self.clone();
        camera.lens = None;
        visit_camera(&mut camera, &mut Detach);
        let middle = |i: usize, size: usize| (i as f64 + 0.5) / size as f64;
        let pixels = 0..height * width;
        let columns: Vec<f64> = pixels.clone().map(|i| middle(i % width, width)).collect();
        let rows: Vec<f64> = pixels.map(|i| middle(i / width, height)).collect();
        let film = [context.row(&columns), context.row(&rows)];
        let aspect = width as f64 / height as f64;
        let (_, direction) = camera.rays(&context, [0.0; 3], 1.0, aspect, &film, None);
        let forward = camera.frame(&context, [0.0; 3], 1.0, aspect).forward;
        let cosine = forward.dot(&direction).reshape([height, width]);
        Ok(depth * cosine)
    }
}
