//! The rays through the middles of a camera's pixels.

use burn::tensor::Tensor;

use super::Camera;
use crate::error::Result;
use crate::geometry::{Context, Vec3, detached};

impl Camera {
    /// Converts depths along the rays (`Image::depth`) to depths along the view axis: PyTorch3D's `zbuf`, the depth of
    /// a rasterizer. Both are `[H, W]` in scene units. Each depth is multiplied by the cosine between its pixel's ray
    /// and the axis. The result is in the graph of the depths, not of the camera.
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
        let (_, direction) = self.pixel_rays(&context, [width, height])?;
        let [forward, ..] = self.axes(&context);
        let cosine = forward.dot(&direction).reshape([height, width]);
        Ok(depth * detached(&cosine))
    }

    /// Returns the rays ([`Camera::rays`]) through the middles of all pixels, row by row, and the middle of the lens.
    pub(crate) fn pixel_rays(
        &self,
        context: &Context,
        [width, height]: [usize; 2],
    ) -> Result<(Vec3, Vec3)> {
        let middle = |i: usize, size: usize| (i as f64 + 0.5) / size as f64;
        let pixels = 0..height * width;
        let columns: Vec<f64> = pixels.clone().map(|i| middle(i % width, width)).collect();
        let rows: Vec<f64> = pixels.map(|i| middle(i / width, height)).collect();
        let (film, aspect) = (
            [columns, rows].map(|f| context.row(&f)),
            width as f64 / height as f64,
        );
        self.rays(context, ([0.0; 3], 1.0), aspect, &film, None, None)
    }
}
