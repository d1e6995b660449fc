//! What clients and servers send to each other.

use std::sync::Arc;

use burn::backend::DispatchTensor;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

use super::words::{Hash, decode, encode, malformed, pack, unpack};
use crate::error::{Error, Result};
use crate::render::batch::Batch;
use crate::render::film::Statistics;
use crate::render::options::RenderOptions;
use crate::scene::slots::{self, Read, Topology, Written};
use crate::scene::{Camera, Normalization, Scene};
use crate::tensors::Diagnostics;

/// The operations. A server that lacks one ends the session, so that the first is called before the others.
pub(crate) const VERSION: &str = "softray::version";
pub(crate) const RENDER: &str = "softray::render";
pub(crate) const GRADIENT: &str = "softray::gradient";

/// The version of these messages. It changes with them, and with the fields of a scene.
pub(crate) const PROTOCOL: u32 = 1;

/// The inputs of both operations before the scene's tensors: a [`Call`], a [`Topology`], scenes, and views. The gradient
/// of the loss with respect to the rows stands last.
pub(crate) const INPUTS: usize = 4;

/// The number of words of a message about an error.
pub(crate) const MESSAGE: usize = 512;

/// What differs between the steps of a fit.
#[derive(Serialize, Deserialize)]
pub(crate) struct Call {
    /// A random number of the client's that names the render for its gradient.
    pub id: u64,
    pub topology: Hash,
    pub seed: u64,
    /// The client's cache.
    pub cache: Option<u64>,
    pub quiet: bool,
    pub normalization: Option<Normalization>,
}

/// The scenes of a batch. The distinct ones follow in the same bytes.
#[derive(Serialize, Deserialize)]
struct Scenes {
    distinct: usize,
    of_batch: Vec<u32>,
    options: RenderOptions,
    vertices: Vec<(String, Vertices)>,
}

#[derive(Serialize, Deserialize)]
struct Vertices(#[serde(with = "slots::tensor")] Tensor<3>);

#[derive(Serialize, Deserialize)]
struct Views {
    views: Vec<(usize, Camera)>,
    pixels: Option<Vec<u32>>,
}

/// A batch as words and tensors.
pub(super) struct Sending {
    pub call: Vec<u32>,
    /// The topology, scenes and views.
    pub parts: [Vec<u32>; INPUTS - 1],
    pub written: Written,
}

/// Returns the messages for a batch on a remote device.
pub(super) fn send(
    batch: &Batch,
    options: &RenderOptions,
    pixels: Option<&Vec<u32>>,
    device: &Device,
    id: u64,
) -> Result<Sending> {
    let parts = || -> Result<[Vec<u8>; 2]> {
        let mut distinct: Vec<Vec<u8>> = Vec::new();
        let mut of_batch = Vec::with_capacity(batch.scenes.len());
        for scene in &batch.scenes {
            let bytes = encode(scene)?;
            // Most batches have scenes that all differ, or are all the same.
            let known = distinct.last().is_some_and(|last| *last == bytes);
            if !known {
                distinct.push(bytes);
            }
            of_batch.push(distinct.len() as u32 - 1);
        }
        let vertices = batch.vertices.iter();
        let vertices = vertices.map(|(name, values)| (name.clone(), Vertices(values.clone())));
        let mut scenes = encode(&Scenes {
            distinct: distinct.len(),
            of_batch,
            options: options.clone().with_seed(0),
            vertices: vertices.collect(),
        })?;
        distinct.iter().for_each(|bytes| scenes.extend(bytes));
        let views = Views {
            views: batch.views.clone(),
            pixels: pixels.cloned(),
        };
        Ok([scenes, encode(&views)?])
    };
    let (parts, written) = slots::write(device, parts);
    let [scenes, views] = parts?;
    let topology = written.topology.words();
    let call = Call {
        id,
        topology: super::words::hash(&topology),
        seed: options.seed,
        cache: options.cache.as_ref().map(|cache| cache.id()),
        quiet: options.quiet,
        normalization: options.normalization(),
    };
    Ok(Sending {
        call: pack(&encode(&call)?),
        parts: [topology, pack(&scenes), pack(&views)],
        written,
    })
}

/// A batch that was received.
pub(crate) struct Received {
    pub batch: Batch,
    pub options: RenderOptions,
    pub pixels: Option<Arc<Vec<u32>>>,
    /// Leaf tensors in place of the client's tracked tensors, in their order.
    pub leaves: Vec<Tensor<1>>,
}

/// Makes the batch of a message. `options` of the result have no cache yet.
pub(crate) fn receive(
    call: &Call,
    topology: Arc<Topology>,
    [scenes, views]: [&[u32]; 2],
    tensors: Vec<DispatchTensor>,
) -> Result<Received> {
    let read = Read {
        topology,
        tensors,
        leaves: Vec::new(),
    };
    let parts = || -> Result<(Scenes, Vec<Scene>, Views)> {
        let bytes = unpack(scenes).ok_or_else(|| malformed("too short"))?;
        let mut decoder = rmp_serde::Deserializer::from_read_ref(&bytes[..]);
        let head = Scenes::deserialize(&mut decoder).map_err(malformed)?;
        let each = (0..head.distinct).map(|_| Scene::deserialize(&mut decoder).map_err(malformed));
        let distinct = each.collect::<Result<Vec<_>>>()?;
        Ok((head, distinct, decode(views)?))
    };
    let (parts, mut read) = slots::read(read, parts);
    let (head, distinct, Views { views, pixels }) = parts?;
    let scene = |&i: &u32| distinct.get(i as usize).cloned();
    let scenes: Option<Vec<Scene>> = head.of_batch.iter().map(scene).collect();
    let mut batch = Batch::views(
        scenes.ok_or_else(|| malformed("a scene is missing"))?,
        views,
    )?;
    for (name, Vertices(values)) in head.vertices {
        batch = batch.with_vertices(name, values)?;
    }
    let mut options = head.options.with_seed(call.seed);
    if let Some(normalization) = call.normalization {
        options = options.normalization_or(normalization);
    }
    if call.quiet {
        options = options.quietly();
    }
    read.leaves.sort_by_key(|leaf| leaf.0);
    Ok(Received {
        batch,
        options,
        pixels: pixels.map(Arc::new),
        leaves: read.leaves.into_iter().map(|leaf| leaf.1).collect(),
    })
}

/// What a render returns beside its rows.
#[derive(Serialize, Deserialize)]
pub(crate) struct Counts {
    pub statistics: Vec<Statistics>,
    pub diagnostics: Vec<Diagnostics>,
}

impl Counts {
    /// The largest number of words of the counts of some views, and a word for success.
    pub fn room(views: usize, options: &RenderOptions) -> usize {
        let of_view = 240 + 9 * (options.bounces as usize + 3);
        8 + (views * of_view).div_ceil(4)
    }
}

/// An error as it is sent.
#[derive(Serialize, Deserialize)]
pub(crate) enum Failure {
    Invalid([String; 4]),
    NoTriangles(usize),
    InBatch(bool, usize, Box<Failure>),
    Other(String),
}

impl Failure {
    pub fn new(error: Error) -> Self {
        // The whole must fit into a message.
        let short = |text: String| text.chars().take(100).collect::<String>();
        match error {
            Error::Invalid {
                object,
                field,
                value,
                expected,
            } => Self::Invalid([
                short(object),
                short(field),
                short(value),
                expected.chars().take(200).collect(),
            ]),
            Error::NoTriangles { objects, .. } => Self::NoTriangles(objects),
            Error::InBatch {
                part,
                index,
                source,
            } => Self::InBatch(part == "scene", index, Box::new(Self::new(*source))),
            Error::Device { message, .. } => Self::Other(message.chars().take(400).collect()),
            other => Self::Other(other.to_string().chars().take(400).collect()),
        }
    }

    /// The error on the client. `server` names the device.
    pub fn error(self, server: &str) -> Error {
        match self {
            Self::Invalid([object, field, value, expected]) => {
                Error::invalid(object, field, value, expected)
            }
            Self::NoTriangles(objects) => Error::NoTriangles {
                path: None,
                objects,
            },
            Self::InBatch(scene, index, source) => Error::InBatch {
                part: if scene { "scene" } else { "view" },
                index,
                source: Box::new(source.error(server)),
            },
            Self::Other(message) => Error::device(server, format!("its server says: {message}")),
        }
    }
}
