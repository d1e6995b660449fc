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
