//! The server: renders and gradients as operations of burn's server.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use burn::backend::ir::{BackendIr, CustomOpIr, HandleContainer};
use burn::backend::ops::FloatTensorOps;
use burn::backend::{Dispatch, DispatchDevice, DispatchKindConversion, DispatchTensor};
use burn::server::RemoteServer;
use burn::tensor::{Device, Int, Shape, Tensor};

use super::operation::{Answer, Inputs, answer, int, put_int, words_of};
use crate::error::{Error, Result};
use crate::render::remote::bounded::{Bounded, LEAST_WEIGHT};
use crate::render::remote::message::{
    Call, Counts, Failure, GRADIENT, PROTOCOL, RENDER, Received, STATE, receive,
};
use crate::render::remote::words::{Hash, encode, hash, malformed, pack};
use crate::render::{HierarchyCache, Means, means};
use crate::scene::slots::Topology;

/// The limits of a server.
///
/// [`RenderService`] has an example.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct ServiceLimits {
    /// The most pixels of a render, over all of its views.
    pub pixels: u64,
    /// The most samples of a render, over all pixels of all of its views.
    pub samples: u64,
    /// The most memory of the images of a render, in bytes. The limit of the client's options holds too.
    pub memory: u64,
    /// The number of forward passes that are kept for their backward passes, over all clients. A backward pass whose
    /// forward pass was dropped repeats it first.
    pub kept: usize,
}

impl Default for ServiceLimits {
    /// 2²⁶ pixels and 2³⁶ samples a render, 4 GiB of images, 8 forward passes.
    fn default() -> Self {
        Self {
            pixels: 1 << 26,
            samples: 1 << 36,
            memory: 4 << 30,
            kept: 8,
        }
    }
}

/// The operations of a server that renders, and their limits.
///
/// One service may be added to several servers of a process. Clients share its memory, but see nothing of each other.
///
/// ```no_run
/// use softray::burn::server::{RemoteServer, TokenAuthorizer, WebSocketTransport};
/// use softray::burn::tensor::Device;
/// use softray::remote::{RenderService, ServiceLimits};
///
/// let mut limits = ServiceLimits::default();
/// limits.pixels = 1 << 20;
/// let device = Device::flex();
/// let listener = std::net::TcpListener::bind("127.0.0.1:3000")?;
/// let server = RemoteServer::new([device.clone()]).with_authorizer(TokenAuthorizer::new("a secret")?);
/// let server = RenderService::new(limits).add_to(server, &device)?;
/// server.serve(WebSocketTransport::from_listener(listener)).expect("a server");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone)]
pub struct RenderService(Arc<State>);

struct State {
    limits: ServiceLimits,
    topologies: Mutex<Bounded<Hash, Arc<Topology>>>,
    caches: Mutex<Bounded<u64, HierarchyCache>>,
    forward: Mutex<Bounded<Call, Forward>>,
    failures: Mutex<Bounded<Call, Arc<Failure>>>,
}

/// A forward pass that waits for its backward pass: the rows, and the tensors whose gradient is the result.
#[derive(Clone)]
struct Forward {
    rows: Tensor<2>,
    leaves: Vec<Tensor<1>>,
}

impl RenderService {
    /// The most bytes of faces that are kept between renders.
    const TOPOLOGIES: usize = 1 << 28;
    /// The most caches of clients.
    const CACHES: usize = 16;
    /// The most failures that no client has asked for.
    const FAILURES: usize = 256;

    /// A service with some limits.
    pub fn new(limits: ServiceLimits) -> Self {
        Self(Arc::new(State {
            limits,
            topologies: Mutex::new(Bounded::new(Self::TOPOLOGIES)),
            caches: Mutex::new(Bounded::new(Self::CACHES)),
            forward: Mutex::new(Bounded::new(limits.kept)),
            failures: Mutex::new(Bounded::new(Self::FAILURES)),
        }))
    }

    /// Adds the operations to a server of devices like this one: Flex or CubeCL's GPUs.
    ///
    /// # Errors
    /// If the device is of another backend.
    pub fn add_to(&self, server: RemoteServer, device: &Device) -> Result<RemoteServer> {
        match device.clone().inner().as_dispatch() {
            #[cfg(feature = "flex")]
            DispatchDevice::Flex(_) => Ok(self.add::<burn::backend::Flex>(server)),
            #[cfg(feature = "gpu")]
            DispatchDevice::Cube(_) => Ok(self.add::<burn::backend::Cube>(server)),
            _ => {
                let message = "a server renders on flex and on GPUs";
                Err(Error::device(crate::device::label(device), message))
            }
        }
    }

    fn add<B: BackendIr>(&self, server: RemoteServer) -> RemoteServer
    where
        DispatchTensor: DispatchKindConversion<B>,
    {
        let [state, render, gradient] = [self.0.clone(), self.0.clone(), self.0.clone()];
        server
            .with_custom_op::<B, _>(STATE, move |handles, operation, _| {
                state.tell::<B>(handles, operation);
            })
            .with_custom_op::<B, _>(RENDER, move |handles, operation, _| {
                let failed = |call, error| render.fail(call, error);
                answer::<B>(handles, operation, |inputs| render.render(inputs), failed);
            })
            .with_custom_op::<B, _>(GRADIENT, move |handles, operation, _| {
                let failed = |call: Call, error| gradient.fail(call.gradients(), error);
                answer::<B>(
                    handles,
                    operation,
                    |inputs| gradient.gradient(inputs),
                    failed,
                );
            })
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl State {
    /// Keeps what failed for the client. Of all gradients it is the first failure.
    fn fail(&self, call: Call, error: Error) {
        let mut failures = lock(&self.failures);
        if failures.get(&call).is_none() {
            failures.insert(call, Arc::new(Failure::new(error)), 1);
        }
    }

    /// The version, and the failure of a call.
    fn tell<B: BackendIr>(&self, handles: &mut HandleContainer<B::Handle>, operation: &CustomOpIr)
    where
        DispatchTensor: DispatchKindConversion<B>,
    {
        let ([input, ..], [output, ..]) = (&operation.inputs[..], &operation.outputs[..]) else {
            log::error!("an operation without inputs or outputs");
            return;
        };
        let call = Call::of_scalars(&operation.scalars);
        let failed = call.and_then(|(call, _)| lock(&self.failures).remove(&call));
        let failure = failed.and_then(|failure| encode(&*failure).ok());
        let words = failure.map_or(Vec::new(), |failure| pack(&failure));
        let device = int::<B>(handles, input).device();
        put_int::<B>(handles, output, [vec![PROTOCOL], words].concat(), &device);
    }

    /// The lists of a hash. Those of the client are read if they are not known.
    fn topology(&self, key: &Hash, lists: &Tensor<1, Int>) -> Result<Arc<Topology>> {
        if let Some(known) = lock(&self.topologies).get(key) {
            return Ok(known);
        }
        let words = words_of(lists)?;
        let topology = Topology::of_words(&words).ok_or_else(|| malformed("faces"))?;
        let topology = Arc::new(topology);
        // The name is not taken from the client, whose lists must not replace another client's.
        let weight = (4 * words.len()).max(LEAST_WEIGHT);
        lock(&self.topologies).insert(hash(&words), topology.clone(), weight);
        Ok(topology)
    }

    fn received(&self, inputs: &Inputs, tensors: Vec<DispatchTensor>) -> Result<Received> {
        let [lists, scenes, views] = &inputs.words;
        let topology = |key: &Hash| self.topology(key, lists);
        let parts = [words_of(scenes)?, words_of(views)?];
        let mut received = receive(inputs.seed, topology, [&parts[0], &parts[1]], tensors)?;
        if let Some(id) = received.cache {
            let mut caches = lock(&self.caches);
            let cache = caches.get(&id).unwrap_or_default();
            caches.insert(id, cache.clone(), 1);
            received.options = received.options.with_cache(&cache);
        }
        received.options.memory_limit = received.options.memory_limit.min(self.limits.memory);
        self.check(&received)?;
        Ok(received)
    }

    fn check(&self, received: &Received) -> Result<()> {
        let Received {
            batch,
            options,
            pixels,
            ..
        } = received;
        let of_view = match pixels {
            Some(pixels) => pixels.len() as u64,
            None => (options.width as u64).saturating_mul(options.height as u64),
        };
        let pixels = of_view.saturating_mul(batch.len() as u64);
        let samples = pixels.saturating_mul(options.samples.into());
        let limits = [
            ("pixels", pixels, self.limits.pixels),
            ("samples", samples, self.limits.samples),
        ];
        for (field, found, limit) in limits {
            if found > limit {
                let expected = format!("at most {limit}, the limit of the server");
                return Err(Error::invalid("render", field, found, expected));
            }
        }
        Ok(())
    }

    /// Renders. Returns the rows with as many channels as the client expects, and the counts.
    fn forward(&self, received: Received, expected: &Shape) -> Result<(Forward, Vec<u32>)> {
        let Received {
            batch,
            options,
            pixels,
            leaves,
            ..
        } = received;
        let [rows, channels] = expected.to_vec()[..] else {
            return Err(malformed("the shape of the result"));
        };
        let Means {
            mean,
            statistics,
            diagnostics,
            ..
        } = means(&batch, &options, pixels)?;
        let [own_rows, own] = mean.dims();
        if own_rows != rows || own > channels {
            return Err(malformed("the shape of the result"));
        }
        // The weights of objects without faces, before that of the background.
        let mean = match channels - own {
            0 => mean,
            missing => {
                let on = (&mean.device().inner(), mean.dtype());
                let none = Tensor::zeros([rows, missing], on);
                let none = if mean.is_tracked() {
                    none.autodiff()
                } else {
                    none
                };
                let background = mean.clone().narrow(1, own - 1, 1);
                Tensor::cat(vec![mean.narrow(1, 0, own - 1), none, background], 1)
            }
        };
        let counts = Counts {
            statistics,
            diagnostics,
        };
        let forward = Forward { rows: mean, leaves };
        Ok((forward, pack(&encode(&counts)?)))
    }

    /// Renders, unless a gradient of the client has failed.
    fn render(&self, mut inputs: Inputs) -> Result<Answer> {
        let failed = lock(&self.failures).remove(&inputs.call.gradients());
        if let Some(failure) = failed {
            lock(&self.failures).insert(inputs.call, failure, 1);
            return Err(Error::device("", "a gradient failed before this render"));
        }
        let tensors = std::mem::take(&mut inputs.tensors);
        let received = self.received(&inputs, tensors)?;
        let (forward, counts) = self.forward(received, &inputs.expected)?;
        let rows = forward.rows.clone().inner().into_dispatch();
        if !forward.leaves.is_empty() {
            lock(&self.forward).insert(inputs.call, forward, 1);
        }
        Ok((rows, counts))
    }

    fn gradient(&self, mut inputs: Inputs) -> Result<Answer> {
        let mut tensors = std::mem::take(&mut inputs.tensors);
        let upstream = tensors.pop().ok_or_else(|| malformed("no gradient"))?;
        let upstream = Tensor::<2>::from_dispatch(upstream);
        let kept = lock(&self.forward).remove(&inputs.call);
        let Forward { rows, leaves } = match kept {
            Some(kept) => kept,
            None => {
                let received = self.received(&inputs, tensors)?;
                let shape = Shape::from(upstream.dims());
                self.forward(received, &shape)?.0
            }
        };
        if rows.dims() != upstream.dims() {
            return Err(malformed("the shape of the gradient"));
        }
        // Its derivative with respect to the rows is exactly `upstream`.
        let loss = (rows * upstream.autodiff()).sum();
        let gradients = loss.backward();
        let of_leaf = |leaf: &Tensor<1>| {
            let gradient = leaf.grad(&gradients);
            gradient.unwrap_or_else(|| leaf.clone().inner().zeros_like())
        };
        let gradient = Tensor::cat(leaves.iter().map(of_leaf).collect(), 0);
        if gradient.dims()[0] != inputs.expected.num_elements() {
            return Err(malformed("the shape of the parameters"));
        }
        let gradient = Dispatch::float_reshape(gradient.into_dispatch(), inputs.expected);
        Ok((gradient, Vec::new()))
    }
}
