//! A node of burn's autodiff graph with a backward pass of its own rather than tensor operations. The images of both
//! engines are such nodes, so their memory grows with neither samples nor bounces.

#![allow(deprecated)] // burn deprecates ndarray, which this crate still supports

use std::fmt;
use std::sync::Arc;

#[cfg(feature = "gpu")]
use burn::backend::Cube;
#[cfg(feature = "remote")]
use burn::backend::Remote;
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind, unary};
use burn::backend::tensor::FloatTensor;
use burn::backend::{
    Autodiff, Backend, Dispatch, DispatchTensor, TensorMetadata, backend_extension,
};
use burn::tensor::{DType, Device, Shape, Tensor, TensorData};

use crate::device::count_read_back;

type OnHost = dyn Fn(&TensorData) -> Vec<f64> + Send + Sync;
#[cfg(feature = "gpu")]
type OnGpu = dyn Fn(&FloatTensor<Cube>) -> FloatTensor<Cube> + Send + Sync;
#[cfg(feature = "remote")]
type OnServer = dyn Fn(FloatTensor<Remote>) -> FloatTensor<Remote> + Send + Sync;

/// A function from the upstream gradient of the output `[R, C]` to the gradient of the parameters.
pub(super) enum Derivative {
    Host(Box<OnHost>),
    /// For an image on a GPU. Its gradient stays there.
    #[cfg(feature = "gpu")]
    Gpu(Box<OnGpu>),
    /// For an image on a server.
    #[cfg(feature = "remote")]
    Remote(Box<OnServer>),
}

/// The derivative of an output, shared by the nodes of the graph.
#[derive(Clone)]
pub(super) struct SharedDerivative {
    of: Arc<Derivative>,
    /// The shape of the parameters.
    shape: Shape,
    dtype: DType,
    device: Device,
}

impl fmt::Debug for SharedDerivative {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("SharedDerivative")
    }
}

/// A backend without autodiff that computes gradients.
pub(super) trait ImageGradient: Backend {
    fn gradient(upstream: FloatTensor<Self>, derivative: &SharedDerivative) -> FloatTensor<Self> {
        match &*derivative.of {
            Derivative::Host(of) => by_host::<Self>(upstream, of, derivative),
            #[allow(unreachable_patterns)] // if no feature has another derivative
            _ => unreachable!("the image of a GPU or a server lies there"),
        }
    }
}

fn by_host<B: Backend>(
    upstream: FloatTensor<B>,
    of: impl Fn(&TensorData) -> Vec<f64>,
    derivative: &SharedDerivative,
) -> FloatTensor<B> {
    let device = upstream.device();
    count_read_back(&derivative.device, upstream.shape().num_elements());
    let data = burn::tensor::try_read_sync(B::float_into_data(upstream));
    let data = data.and_then(Result::ok);
    let data = data.expect("the gradient of an image can be read back");
    let gradient = TensorData::new(of(&data), derivative.shape.clone());
    B::float_from_data(gradient.convert_dtype(derivative.dtype), &device)
}

#[cfg(feature = "flex")]
impl ImageGradient for burn::backend::Flex {}

#[cfg(feature = "ndarray")]
impl ImageGradient for burn::backend::NdArray {}

#[cfg(feature = "gpu")]
impl ImageGradient for Cube {
    fn gradient(upstream: FloatTensor<Self>, derivative: &SharedDerivative) -> FloatTensor<Self> {
        match &*derivative.of {
            Derivative::Host(of) => by_host::<Self>(upstream, of, derivative),
            Derivative::Gpu(of) => of(&upstream),
            #[cfg(feature = "remote")]
            Derivative::Remote(_) => unreachable!("the image of a server lies there"),
        }
    }
}

#[cfg(feature = "remote")]
impl ImageGradient for Remote {
    fn gradient(upstream: FloatTensor<Self>, derivative: &SharedDerivative) -> FloatTensor<Self> {
        match &*derivative.of {
            Derivative::Remote(of) => of(upstream),
            _ => unreachable!("the server has the scene"),
        }
    }
}

#[backend_extension(
    Autodiff,
    Flex: cfg(feature = "flex"),
    NdArray: cfg(feature = "ndarray"),
    Cube: cfg(feature = "gpu"),
    Remote: cfg(feature = "remote")
)]
pub(super) trait NodeBackend: Backend {
    /// Returns the unchanged output with the parameters as its parent.
    fn attach(
        parameters: FloatTensor<Self>,
        output: FloatTensor<Self>,
        derivative: SharedDerivative,
    ) -> FloatTensor<Self>;
}

/// Implements [`NodeBackend`] for backends without autodiff, which return the output unchanged.
macro_rules! without_autodiff {
    ($($feature:literal $backend:ident),*) => {
        $(
            #[cfg(feature = $feature)]
            impl NodeBackend for burn::backend::$backend {
                fn attach(
                    _: FloatTensor<Self>,
                    output: FloatTensor<Self>,
                    _: SharedDerivative,
                ) -> FloatTensor<Self> {
                    output
                }
            }
        )*
    };
}

without_autodiff!("flex" Flex, "ndarray" NdArray, "gpu" Cube, "remote" Remote);

#[derive(Debug)]
struct ImageNode;

impl<B: ImageGradient> Backward<B, 1> for ImageNode {
    type State = SharedDerivative;

    fn backward(
        self,
        ops: Ops<Self::State, 1>,
        grads: &mut Gradients,
        _checkpointer: &mut Checkpointer,
    ) {
        let derivative = ops.state;
        unary::<B, _>(ops.parents, ops.node, grads, |upstream| {
            B::gradient(upstream, &derivative)
        });
    }
}

impl<B: NodeBackend + ImageGradient, C: CheckpointStrategy> NodeBackend for Autodiff<B, C> {
    fn attach(
        parameters: FloatTensor<Self>,
        output: FloatTensor<Self>,
        derivative: SharedDerivative,
    ) -> FloatTensor<Self> {
        match ImageNode
            .prepare::<C>([parameters.node()])
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(prep) => prep.finish(derivative, output.into_primitive()),
            OpsKind::UnTracked(prep) => prep.finish(output.into_primitive()),
        }
    }
}

/// Returns `output` with `parameters`, of any shape, as its parent and `derivative` as its backward pass.
pub(super) fn attach(
    parameters: DispatchTensor,
    output: Tensor<2>,
    derivative: Derivative,
) -> Tensor<2> {
    let derivative = SharedDerivative {
        of: Arc::new(derivative),
        shape: parameters.shape(),
        dtype: parameters.dtype(),
        device: output.device(),
    };
    let output = <Dispatch as NodeBackend>::attach(parameters, output.into_dispatch(), derivative);
    Tensor::from_dispatch(output)
}
