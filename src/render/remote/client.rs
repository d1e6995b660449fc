//! The client: an image on a device of a server.

use std::sync::Arc;
use std::sync::atomic::AtomicUsize;

use burn::backend::ir::{CustomOpIr, TensorIr};
use burn::backend::tensor::{FloatTensor, IntTensor};
use burn::backend::{Remote, RemoteDevice};
use burn::remote::CustomOpClient;
use burn::tensor::{DType, Device, Int, Shape, Tensor};

use super::message::{
    Counts, Failure, GRADIENT, INPUTS, MESSAGE, PROTOCOL, RENDER, Sending, VERSION, send,
};
use super::sent::server;
use super::words::{decode, tensor};
use crate::device::remote::{read_words, unique};
use crate::error::{Error, Result};
use crate::geometry::Context;
use crate::render::batch::Batch;
use crate::render::film::Means;
use crate::render::node::{Derivative, attach};
use crate::render::options::RenderOptions;

/// The output of an operation.
type Output = (Shape, DType);

/// Registers an operation, and returns its outputs.
fn register(
    device: &RemoteDevice,
    name: &'static str,
    inputs: &[TensorIr],
    outputs: &[Output],
) -> Vec<FloatTensor<Remote>> {
    let client = CustomOpClient::new(device);
    let output = |(shape, dtype): &Output| {
        TensorIr::uninit(client.create_empty_handle(), shape.clone(), *dtype)
    };
    let outputs: Vec<TensorIr> = outputs.iter().map(output).collect();
    client.register(CustomOpIr::new(name, inputs, &outputs))
}

fn words_of(output: IntTensor<Remote>) -> Tensor<1, Int> {
    Tensor::from_primitive::<Remote>(output)
}

fn handle(words: &Tensor<1, Int>) -> Result<IntTensor<Remote>> {
    let handle = words.clone().try_into_primitive::<Remote>();
    handle.map_err(|e| Error::device("of a server", format!("{e:?}")))
}

/// Checks once that the server has these operations in this version, and reports gradients that failed.
fn check(device: &RemoteDevice, on: &Device) -> Result<()> {
    if !server(device, |known| known.checked) {
        let client = tensor(vec![PROTOCOL], on);
        let inputs = [handle(&client)?.into_ir()];
        let mut outputs = register(device, VERSION, &inputs, &[(Shape::from([1]), DType::I32)]);
        let version = words_of(outputs.remove(0));
        let doing = "the first operation of softray (does the server have them, as the example render_server?)";
        let found = read_words(version, doing)?.first().copied().unwrap_or(0);
        if found != PROTOCOL {
            let message = format!(
                "its server speaks version {found} of softray's protocol, and this program {PROTOCOL}; build both \
                 from the same version of softray"
            );
            return Err(Error::device(crate::device::label(on), message));
        }
        server(device, |known| known.checked = true);
    }
    let gradients = server(device, |known| std::mem::take(&mut known.gradients));
    for [success, message] in gradients {
        succeeded(success, message, on, "the last gradient")?;
    }
    Ok(())
}

/// Waits for an operation, and returns its words after the first.
fn succeeded(
    success: Tensor<1, Int>,
    message: Tensor<1, Int>,
    on: &Device,
    doing: &str,
) -> Result<Vec<u32>> {
    let mut words = read_words(success, doing)?;
    if words.first() == Some(&0) {
        words.remove(0);
        return Ok(words);
    }
    let failure: Failure = decode(&read_words(message, doing)?)?;
    Err(failure.error(&crate::device::label(on)))
}

/// Waits for all gradients of a device. They are computed without waiting, so that an error is otherwise reported by the
/// next render.
///
/// # Errors
/// If a gradient failed on the server; it is NaN then. If the server has gone.
pub(crate) fn finish(on: &Device) -> Result<()> {
    match crate::device::remote::remote(on) {
        Some(device) => check(&device, on),
        None => Ok(()),
    }
}

/// The inputs of a render and its gradient, which the client keeps for the gradient.
struct Inputs {
    words: Vec<IntTensor<Remote>>,
    tensors: Vec<FloatTensor<Remote>>,
}

impl Inputs {
    fn new(sending: &mut Sending, device: &RemoteDevice, on: &Device) -> Result<Self> {
        let call = tensor(std::mem::take(&mut sending.call), on);
        let mut words = Vec::with_capacity(INPUTS);
        words.push(handle(&call)?);
        for part in std::mem::take(&mut sending.parts) {
            words.push(handle(&server(device, |known| known.part(part, on)))?);
        }
        let tensors = std::mem::take(&mut sending.written.tensors);
        Ok(Self { words, tensors })
    }

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
    let mut sending = send(batch, options, pixels.as_deref(), &on, unique())?;
    let inputs = Inputs::new(&mut sending, &device, &on)?;
    let (views, count) = (batch.views.len(), pixels.as_ref().map(|p| p.len()));
    let count = count.unwrap_or(options.width * options.height);
    let objects = batch.scenes.iter().map(|s| s.objects.len()).max();
    let objects = objects.unwrap_or(0);
    let channels = channels(objects);
    let outputs = [
        (Shape::from([views * count, channels]), dtype),
        (Shape::from([Counts::room(views, options)]), DType::I32),
        (Shape::from([MESSAGE]), DType::I32),
    ];
    let mut outputs = register(&device, RENDER, &inputs.all(), &outputs).into_iter();
    let mut next = || outputs.next().expect("an output");
    let [rows, success, message] = [next(), next(), next()];
    let (success, message) = (words_of(success), words_of(message));
    let counts = succeeded(success, message, &on, "a render")?;
    let counts: Counts = decode(&counts)?;
    options.progress.tile(&AtomicUsize::new(0), 1);
    let mut mean = Tensor::<2>::from_primitive::<Remote>(rows);
    let tracked = sending.written.tracked;
    if !tracked.is_empty() {
        let derivative = move |upstream: FloatTensor<Remote>, size: usize| {
            gradient(&device, &inputs, upstream, (Shape::from([size]), dtype))
        };
        // One operation less to send if there is one tensor.
        let parent = match &tracked[..] {
            [one] => one.clone(),
            _ => Tensor::cat(tracked, 0),
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

/// Returns the gradient of the tracked tensors, which the server computes meanwhile.
fn gradient(
    device: &RemoteDevice,
    inputs: &Inputs,
    upstream: FloatTensor<Remote>,
    output: Output,
) -> FloatTensor<Remote> {
    let mut all = inputs.all();
    all.push(upstream.into_ir());
    let outputs = [
        output,
        (Shape::from([1]), DType::I32),
        (Shape::from([MESSAGE]), DType::I32),
    ];
    let mut outputs = register(device, GRADIENT, &all, &outputs);
    let result = [outputs.remove(1), outputs.remove(1)].map(words_of);
    server(device, |known| known.gradients.push(result));
    outputs.remove(0)
}
