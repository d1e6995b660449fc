//! A render as one node of the graph: forward without tape, and in the backward pass the paths are
//! traced again, tile by tile, each with a tape of its own that is gone after it. Memory does not
//! grow with samples, bounces or pixels, and tiles run on all cores in both directions.

#![allow(deprecated)] // burn deprecates ndarray; users ask for it

use std::fmt;
use std::sync::Arc;

use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind, unary};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, TensorMetadata, backend_extension};
use burn::tensor::{Tensor, TensorData};
use rayon::prelude::*;

use super::tensors::{Renderer, Tile, tiles};
use super::{RenderOptions, is_cpu};
use crate::accel::Hierarchy;
use crate::error::Result;
use crate::geometry::host_values;
use crate::scene::{Camera, Flattened, Normalization, Replace, Scene, visit_tensors};

/// From the gradient of the output to that of the parameters, both on the host.
#[derive(Clone)]
pub(super) struct Retrace(pub Arc<dyn Fn(TensorData) -> TensorData + Send + Sync>);

impl fmt::Debug for Retrace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Retrace")
    }
}

#[backend_extension(
    Autodiff,
    Flex: cfg(feature = "flex"),
    NdArray: cfg(feature = "ndarray"),
    Cube: cfg(feature = "wgpu")
)]
pub(super) trait ReplayBackend: Backend {
    /// The output as it is, with the parameters as its parent.
    fn replay(
        parameters: FloatTensor<Self>,
        output: FloatTensor<Self>,
        retrace: Retrace,
    ) -> FloatTensor<Self>;
}

#[cfg(feature = "flex")]
impl ReplayBackend for burn::backend::Flex {
    fn replay(_: FloatTensor<Self>, output: FloatTensor<Self>, _: Retrace) -> FloatTensor<Self> {
        output
    }
}

#[cfg(feature = "ndarray")]
impl ReplayBackend for burn::backend::NdArray {
    fn replay(_: FloatTensor<Self>, output: FloatTensor<Self>, _: Retrace) -> FloatTensor<Self> {
        output
    }
}

#[cfg(feature = "wgpu")]
impl ReplayBackend for burn::backend::Cube {
    fn replay(_: FloatTensor<Self>, output: FloatTensor<Self>, _: Retrace) -> FloatTensor<Self> {
        output
    }
}

#[derive(Debug)]
struct ReplayNode;

impl<B: Backend> Backward<B, 1> for ReplayNode {
    type State = Retrace;

    fn backward(
        self,
        ops: Ops<Self::State, 1>,
        grads: &mut Gradients,
        _checkpointer: &mut Checkpointer,
    ) {
        let Retrace(retrace) = ops.state;
        unary::<B, _>(ops.parents, ops.node, grads, |grad| {
            let device = grad.device();
            let data = burn::tensor::try_read_sync(B::float_into_data(grad));
            let data = data.and_then(Result::ok);
            let data = data.expect("the gradient of an image can be read back");
            B::float_from_data(retrace(data), &device)
        });
    }
}

impl<B: Backend + ReplayBackend, C: CheckpointStrategy> ReplayBackend for Autodiff<B, C> {
    fn replay(
        parameters: FloatTensor<Self>,
        output: FloatTensor<Self>,
        retrace: Retrace,
    ) -> FloatTensor<Self> {
        match ReplayNode
            .prepare::<C>([parameters.node()])
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(prep) => prep.finish(retrace, output.into_primitive()),
            OpsKind::UnTracked(prep) => prep.finish(output.into_primitive()),
        }
    }
}

/// `output` with a node whose backward pass is `retrace`.
pub(super) fn replay(parameters: Tensor<1>, output: Tensor<2>, retrace: Retrace) -> Tensor<2> {
    let output = <Dispatch as ReplayBackend>::replay(
        parameters.into_dispatch(),
        output.into_dispatch(),
        retrace,
    );
    Tensor::from_dispatch(output)
}

/// What the backward pass of a replay needs.
pub(super) struct Retraced {
    pub scene: Scene,
    pub camera: Camera,
    pub options: RenderOptions,
    pub normalization: Normalization,
    pub pixels: Option<Arc<Vec<u32>>>,
    /// Without tape.
    pub parameters: Tensor<1>,
}

impl Retraced {
    /// The gradient of the parameters from that of the means `[C, pixels]`.
    pub fn gradient(
        &self,
        upstream: &TensorData,
        hierarchy: &Option<Arc<Hierarchy>>,
    ) -> TensorData {
        let count = self.parameters.dims()[0];
        let dtype = self.parameters.dtype();
        let shape = upstream.shape().clone();
        let (channels, pixels) = (shape[0], shape[1]);
        let upstream: Vec<f64> = upstream.iter::<f64>().collect();
        let per_sample = f64::from(self.options.samples).recip();
        let of_tile = |tile: &Tile| -> Result<Vec<f64>> {
            let (leaf, scene, camera) = self.anew();
            let flattened =
                Flattened::of_scene(&scene, Some(self.normalization), None)?.seen_by(&camera)?;
            let pixels_of = self.pixels.clone();
            let renderer = Renderer::new(
                &flattened,
                &camera,
                &self.options,
                pixels_of,
                hierarchy.clone(),
            )?;
            let sums = renderer.tile(tile)?.sums;
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
        // A tape is as long as its paths.
        let rays = REPLAYED_RAYS / (self.options.bounces as usize + 1);
        let tiles = tiles(&self.options, pixels, rays.max(256));
        let parts = if is_cpu(&self.parameters.device()) {
            tiles.par_iter().map(of_tile).collect::<Result<Vec<_>>>()
        } else {
            tiles.iter().map(of_tile).collect()
        };
        // A backward pass can't return an error, and what could fail went well in the forward pass.
        let parts = parts.unwrap_or_else(|e| panic!("a render could not be replayed: {e}"));
        let mut sum = vec![0.0; count];
        for part in parts {
            sum.iter_mut().zip(part).for_each(|(s, p)| *s += p);
        }
        TensorData::new(sum, [count]).convert_dtype(dtype)
    }

    /// Scene and camera in a graph of their own, with the leaf of its parameters: that of the image is
    /// locked while it goes backward.
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

    /// A gradient with what jumps of visibility add to it.
    pub fn with_jumps(&self, gradient: TensorData, upstream: &TensorData) -> TensorData {
        let (_, scene, camera) = self.anew();
        let view = (&scene, &camera);
        let jumps = super::kernel::jumps(view, &self.options, self.pixels.clone(), upstream);
        let jumps = jumps.unwrap_or_else(|e| panic!("a render could not be replayed: {e}"));
        let (dtype, shape) = (gradient.dtype(), gradient.shape().clone());
        let sum: Vec<f64> = gradient
            .iter::<f64>()
            .zip(jumps)
            .map(|(a, b)| a + b)
            .collect();
        TensorData::new(sum, shape).convert_dtype(dtype)
    }
}

/// Surfaces of the paths of a tile that keeps a tape.
const REPLAYED_RAYS: usize = 1 << 14;
