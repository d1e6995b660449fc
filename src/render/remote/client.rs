//! The client: an image on a device of a server.

use std::sync::Arc;
use std::sync::atomic::AtomicUsize;

use burn::backend::ir::{CustomOpIr, ScalarIr, TensorIr};
use burn::backend::ops::FloatTensorOps;
use burn::backend::tensor::{FloatTensor, IntTensor};
use burn::backend::{Dispatch, DispatchTensor, Remote, RemoteDevice, TensorMetadata};
use burn::remote::CustomOpClient;
use burn::tensor::{DType, Device, Int, Shape, Tensor};

use super::message::{Call, Counts, Failure, GRADIENT, MESSAGE, PROTOCOL, RENDER, STATE};
use super::sent::{Sending, send, server};
use super::words::decode;
use crate::device::remote::read_words;
use crate::error::{Error, Result};
use crate::geometry::Context;
use crate::render::batch::Batch;
use crate::render::film::Means;
use crate::render::node::{Derivative, attach};
use crate::render::options::RenderOptions;

/// The shape and type of an operation's output.
type Output = (Shape, DType);

/// Registers an operation, and returns its outputs.
fn register<const N: usize>(
    device: &RemoteDevice,
    name: &'static str,
    inputs: &[TensorIr],
    scalars: Vec<ScalarIr>,
    outputs: [Output; N],
) -> [FloatTensor<Remote>; N] {
    let client = CustomOpClient::new(device);
    let outputs =
        outputs.map(|(shape, dtype)| TensorIr::uninit(client.create_empty_handle(), shape, dtype));
    let outputs = client.register(CustomOpIr::with_scalars(name, inputs, &outputs, scalars));
    match outputs.try_into() {
        Ok(outputs) => outputs,
        Err(_) => unreachable!("burn returns the outputs that it is given"),
    }
}

fn words_of(output: IntTensor<Remote>) -> Tensor<1, Int> {
    Tensor::from_primitive::<Remote>(output)
}

fn handle(words: Tensor<1, Int>) -> Result<IntTensor<Remote>> {
    let handle = words.try_into_primitive::<Remote>();
    handle.map_err(|e| Error::device("of a server", format!("{e:?}")))
}

/// Asks the server what it says of a call, and returns its version with its words.
fn state(device: &RemoteDevice, on: &Device, call: Call, doing: &str) -> Result<(u32, Vec<u32>)> {
    let inputs = [handle(server(device, |known| known.input(on)))?.into_ir()];
    let output = (Shape::from([MESSAGE]), DType::I32);
    let [words] = register(device, STATE, &inputs, call.scalars(0), [output]);
    let mut words = read_words(words_of(words), doing)?;
    words.rotate_left(1);
    let version = words.pop().unwrap_or(0);
    Ok((version, words))
}

/// Returns the error of a server's message.
fn error_of(words: &[u32], on: &Device) -> Result<Error> {
    let failure: Failure = decode(words)?;
    Ok(failure.error(&crate::device::label(on)))
}

/// Checks once that the server has these operations in this version.
fn check(device: &RemoteDevice, on: &Device) -> Result<()> {
    if server(device, |known| known.checked) {
        return Ok(());
    }
    let doing =
        "the first operation of softray (does the server have them, as the example render_server?)";
    let call = server(device, |known| known.gradients());
    let (version, _) = state(device, on, call, doing)?;
    if version != PROTOCOL {
        let message = format!(
            "its server speaks version {version} of softray's protocol, and this program {PROTOCOL}; build both from \
             the same version of softray"
        );
        return Err(Error::device(crate::device::label(on), message));
    }
    server(device, |known| known.checked = true);
    Ok(())
}

/// Waits for all gradients of a device. They are computed without waiting, so that an error is otherwise reported by the
/// next render.
///
/// # Errors
/// If a gradient failed on the server; it is NaN then. If the server has gone.
pub(crate) fn finish(on: &Device) -> Result<()> {
    let Some(device) = crate::device::remote::remote(on) else {
        return Ok(());
    };
    if !server(&device, |known| std::mem::take(&mut known.pending)) {
        return Ok(());
    }
    let call = server(&device, |known| known.gradients());
    let (_, words) = state(&device, on, call, "the last gradient").inspect_err(|_| {
        server(&device, |known| known.pending = true);
    })?;
    match words.first() {
        Some(0) => Ok(()),
        _ => Err(error_of(&words, on)?),
    }
}

/// The inputs of a render and its gradient, which the client keeps for the gradient.
struct Inputs {
    words: Vec<IntTensor<Remote>>,
    tensors: Vec<FloatTensor<Remote>>,
    scalars: Vec<ScalarIr>,
}

impl Inputs {
    fn all(&self) -> Vec<TensorIr> {
        let words = self.words.iter().map(|t| t.clone().into_ir());
        words
            .chain(self.tensors.iter().map(|t| t.clone().into_ir()))
            .collect()
    }
}

/// Renders on a server, and waits until it has finished. `channels` is the number of channels of an image of a scene of
/// so many objects.
pub(in crate::render) fn render(
    batch: &Batch,
    options: &RenderOptions,
    pixels: Option<Arc<Vec<u32>>>,
    channels: impl Fn(usize) -> usize,
) -> Result<Means> {
    let Context { device: on, dtype } = batch.context()?;
    let device = crate::device::remote::remote(&on)
        .ok_or_else(|| Error::device(crate::device::label(&on), "it is not of a server"))?;
    check(&device, &on)?;
    let Sending { parts, written } = send(batch, options, pixels.as_deref(), &device, &on)?;
    let call = server(&device, |known| known.next());
    let words = parts.into_iter().map(handle).collect::<Result<_>>()?;
    let inputs = Inputs {
        words,
        tensors: written.tensors,
        scalars: call.scalars(options.seed),
    };
    let (views, count) = (batch.views.len(), pixels.as_ref().map(|p| p.len()));
    let count = count.unwrap_or(options.width * options.height);
    let objects = batch.scenes.iter().map(|s| s.objects.len()).max();
    let objects = objects.unwrap_or(0);
    let outputs = [
        (Shape::from([views * count, channels(objects)]), dtype),
        (Shape::from([Counts::room(views, options)]), DType::I32),
    ];
    let scalars = inputs.scalars.clone();
    let [rows, counts] = register(&device, RENDER, &inputs.all(), scalars, outputs);
    let mut counts = read_words(words_of(counts), "a render")?;
    if counts.is_empty() || counts.remove(0) != 0 {
        let (_, words) = state(&device, &on, call, "the message of an error")?;
        return Err(error_of(&words, &on)?);
    }
    let counts: Counts = decode(&counts)?;
    options.progress.tile(&AtomicUsize::new(0), 1);
    let mut mean = Tensor::<2>::from_primitive::<Remote>(rows);
    if let Some(parent) = parent(written.tracked) {
        let shape = parent.shape();
        let derivative = move |upstream: FloatTensor<Remote>| {
            gradient(&device, &inputs, upstream, (shape.clone(), dtype))
        };
        mean = attach(parent, mean, Derivative::Remote(Box::new(derivative)));
    }
    Ok(Means {
        mean,
        objects,
        statistics: counts.statistics,
        diagnostics: counts.diagnostics,
    })
}

/// Returns the parent of an image: the only tracked tensor, or all of them in one row.
fn parent(mut tracked: Vec<DispatchTensor>) -> Option<DispatchTensor> {
    if tracked.len() < 2 {
        return tracked.pop();
    }
    let flat = |tensor: DispatchTensor| {
        let count = tensor.shape().num_elements();
        Dispatch::float_reshape(tensor, Shape::from([count]))
    };
    Some(Dispatch::float_cat(
        tracked.into_iter().map(flat).collect(),
        0,
    ))
}

/// Returns the gradient of the tracked tensors, which the server computes meanwhile.
fn gradient(
    device: &RemoteDevice,
    inputs: &Inputs,
    upstream: FloatTensor<Remote>,
    output: Output,
) -> FloatTensor<Remote> {
    let mut all = inputs.all();
    all.push(upstream.into_ir());
    let [gradient] = register(device, GRADIENT, &all, inputs.scalars.clone(), [output]);
    server(device, |known| known.pending = true);
    gradient
}
