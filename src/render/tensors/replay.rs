//! The backward pass of a view. It traces the paths again, tile by tile, each with its own short-lived tape. Memory
//! therefore does not grow with samples, bounces or pixels, and tiles run on all cores.

use std::sync::Arc;

use burn::tensor::{Tensor, TensorData};
use rayon::prelude::*;

use super::renderer::TensorRenderer;
use crate::device::is_cpu;
use crate::error::Result;
use crate::geometry::{Context, host_values};
use crate::render::kernel;
use crate::render::options::RenderOptions;
use crate::render::tiles::Tile;
use crate::scene::{Camera, Flattened, Normalization, Replace, Scene, visit_tensors};
use softray_kernels::accel::Hierarchy;
use softray_kernels::host::HostScene;

/// The backward pass of a view.
pub(super) struct Replay {
    pub scene: Scene,
    pub host: HostScene,
    pub context: Context,
    pub camera: Camera,
    pub options: RenderOptions,
    pub normalization: Normalization,
    pub pixels: Option<Arc<Vec<u32>>>,
    /// All tracked tensors in one row, detached.
    pub parameters: Tensor<1>,
    pub hierarchy: Option<Arc<Hierarchy>>,
    pub tiles: Vec<Tile>,
}

impl Replay {
    /// Returns the gradient of the parameters for the upstream gradient `[C, P]` of the means.
    pub fn gradient(&self, upstream: &TensorData) -> Vec<f64> {
        let interior = self.interior(upstream);
        if self.options.visibility.is_softmax() {
            return interior;
        }
        let (_, scene, camera) = self.anew();
        // In kernels the channels of a pixel are contiguous.
        let upstream = transposed(upstream);
        let pixels = self.pixels.clone();
        let jumps = kernel::jumps((&scene, &camera), &self.options, pixels, &upstream);
        let jumps = jumps.unwrap_or_else(|e| panic!("a render could not be replayed: {e}"));
        // Rounded before the boundary terms are added, so that it is the same as without them.
        let count = interior.len();
        let interior = TensorData::new(interior, [count]).convert_dtype(self.parameters.dtype());
        let sums = interior.iter::<f64>().zip(jumps).map(|(a, b)| a + b);
        sums.collect()
    }

    /// Returns the gradient by autodiff: the interior term for cones, the whole gradient for the softmax.
    fn interior(&self, upstream: &TensorData) -> Vec<f64> {
        let count = self.parameters.dims()[0];
        let shape = upstream.shape().clone();
        let (channels, pixels) = (shape[0], shape[1]);
        let upstream: Vec<f64> = upstream.iter::<f64>().collect();
        let per_sample = f64::from(self.options.samples).recip();
        let of_tile = |tile: &Tile| -> Result<Vec<f64>> {
            let (leaf, scene, camera) = self.anew();
            let flattened = Flattened::new(
                &scene,
                (&self.host, &self.context),
                &camera,
                self.normalization,
            )?;
            let (pixels_of, hierarchy) = (self.pixels.clone(), self.hierarchy.clone());
            let renderer =
                TensorRenderer::new(&flattened, &camera, &self.options, pixels_of, hierarchy)?;
            let sums = renderer.tile(tile)?.rows;
            if !sums.is_tracked() {
                return Ok(vec![0.0; count]);
            }
            let weights: Vec<f64> = (0..channels)
                .flat_map(|c| {
                    let row = &upstream[c * pixels..(c + 1) * pixels];
                    row[tile.first..tile.first + tile.pixels].iter().copied()
                })
                .map(|w| w * per_sample)
                .collect();
            let weights = flattened.context.tensor(&weights, sums.dims());
            let gradients = (sums * weights).sum().backward();
            match leaf.grad(&gradients) {
                Some(g) => host_values(&g),
                None => Ok(vec![0.0; count]),
            }
        };
        let parts = if is_cpu(&self.parameters.device()) {
            self.tiles
                .par_iter()
                .map(of_tile)
                .collect::<Result<Vec<_>>>()
        } else {
            self.tiles.iter().map(of_tile).collect()
        };
        // A backward pass can't return an error, and the forward pass ran the same operations without one.
        let parts = parts.unwrap_or_else(|e| panic!("a render could not be replayed: {e}"));
        let mut sum = vec![0.0; count];
        for part in parts {
            sum.iter_mut().zip(part).for_each(|(s, p)| *s += p);
        }
        sum
    }

    /// Returns the leaf tensor of the parameters, and the scene and the camera in a graph of their own. The image's
    /// graph is locked during its backward pass.
    fn anew(&self) -> (Tensor<1>, Scene, Camera) {
        let leaf = self.parameters.clone().autodiff().require_grad();
        let (mut scene, mut camera) = (self.scene.clone(), self.camera.clone());
        let mut replace = Replace {
            parameters: leaf.clone(),
            next: 0,
        };
        visit_tensors(&mut scene, &mut camera, &mut replace);
        (leaf, scene, camera)
    }
}

/// Transposes a matrix `[C, P]` to `[P, C]`.
fn transposed(data: &TensorData) -> TensorData {
    let (rows, columns) = (data.shape()[0], data.shape()[1]);
    let values: Vec<f64> = data.iter::<f64>().collect();
    let of_column = |p: usize| (0..rows).map(move |c| (c, p));
    let all = (0..columns).flat_map(of_column);
    let values: Vec<f64> = all.map(|(c, p)| values[c * columns + p]).collect();
    TensorData::new(values, [columns, rows])
}
