//! A node of burn's autodiff graph whose backward pass runs on the host: images of both engines hang on one,
//! so that their memory grows with neither samples nor bounces.

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

use crate::device::count_read_back;

/// A function from the gradient of the output to that of the parameters, both on the host.
#[derive(Clone)]
pub(super) struct HostBackward(Arc<dyn Fn(TensorData) -> TensorData + Send + Sync>);

impl fmt::Debug for HostBackward {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("HostBackward")
    }
}

#[backend_extension(
    Autodiff,
    Flex: cfg(feature = "flex"),
    NdArray: cfg(feature = "ndarray"),
    Cube: cfg(feature = "wgpu")
)]
pub(super) trait NodeBackend: Backend {
    /// The output as it is, with the parameters as its parent.
    fn attach(
        parameters: FloatTensor<Self>,
        output: FloatTensor<Self>,
        backward: HostBackward,
    ) -> FloatTensor<Self>;
}

/// Backends without autodiff, on which the output stays as it is.
macro_rules! without_autodiff {
    ($($feature:literal $backend:ident),*) => {
        $(
            #[cfg(feature = $feature)]
            impl NodeBackend for burn::backend::$backend {
                fn attach(
                    _: FloatTensor<Self>,
                    output: FloatTensor<Self>,
                    _: HostBackward,
                ) -> FloatTensor<Self> {
                    output
                }
            }
        )*
    };
}

without_autodiff!("flex" Flex, "ndarray" NdArray, "wgpu" Cube);

#[derive(Debug)]
struct HostNode;

impl<B: Backend> Backward<B, 1> for HostNode {
    type State = HostBackward;

    fn backward(
        self,
        ops: Ops<Self::State, 1>,
        grads: &mut Gradients,
        _checkpointer: &mut Checkpointer,
    ) {
        let HostBackward(backward) = ops.state;
        unary::<B, _>(ops.parents, ops.node, grads, |grad| {
            let device = grad.device();
            let data = burn::tensor::try_read_sync(B::float_into_data(grad));
            let data = data.and_then(Result::ok);
            let data = data.expect("the gradient of an image can be read back");
            B::float_from_data(backward(data), &device)
        });
    }
}

impl<B: Backend + NodeBackend, C: CheckpointStrategy> NodeBackend for Autodiff<B, C> {
    fn attach(
        parameters: FloatTensor<Self>,
        output: FloatTensor<Self>,
        backward: HostBackward,
    ) -> FloatTensor<Self> {
        match HostNode
            .prepare::<C>([parameters.node()])
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(prep) => prep.finish(backward, output.into_primitive()),
            OpsKind::UnTracked(prep) => prep.finish(output.into_primitive()),
        }
    }
}

/// `output` with `parameters` as its parent: the gradient of these is `backward` of that of the output.
pub(super) fn attach(
    parameters: Tensor<1>,
    output: Tensor<2>,
    backward: impl Fn(&TensorData) -> Vec<f64> + Send + Sync + 'static,
) -> Tensor<2> {
    let (shape, dtype) = (parameters.dims(), parameters.dtype());
    let device = output.device();
    let backward = HostBackward(Arc::new(move |upstream| {
        count_read_back(&device);
        TensorData::new(backward(&upstream), shape).convert_dtype(dtype)
    }));
    let output = <Dispatch as NodeBackend>::attach(
        parameters.into_dispatch(),
        output.into_dispatch(),
        backward,
    );
    Tensor::from_dispatch(output)
}
