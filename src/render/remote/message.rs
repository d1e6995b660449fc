//! What clients and servers send to each other.

use std::collections::BTreeMap;
use std::sync::Arc;

use burn::backend::DispatchTensor;
use burn::backend::ir::ScalarIr;
use burn::tensor::Tensor;
use serde::{Deserialize, Serialize};

use super::words::{Hash, decode, malformed, unpack};
use crate::error::{Error, Result};
use crate::render::batch::Batch;
use crate::render::film::Statistics;
use crate::render::options::RenderOptions;
use crate::scene::slots::{self, Read, Topology};
use crate::scene::{Camera, Normalization, Scene};
use crate::tensors::Diagnostics;

/// The operations. A server that lacks one ends the session, so that the first is called before the others.
///
/// `STATE` returns the server's version, and what failed.
pub(crate) const STATE: &str = "softray::version";
pub(crate) const RENDER: &str = "softray::render";
pub(crate) const GRADIENT: &str = "softray::gradient";

/// The version of these messages. It changes with them, and with the fields of a scene.
pub(crate) const PROTOCOL: u32 = 2;

/// The inputs of a render and its gradient before the scene's tensors: a [`Topology`], scenes, and views. The gradient
/// of the loss with respect to the rows stands last.
pub(crate) const INPUTS: usize = 3;

/// The number of words of the server's version and a [`Failure`].
pub(crate) const MESSAGE: usize = 512;

/// Names a render, its gradient, or their failure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Call {
    /// A random number that names the client.
    pub client: u64,
    /// The number of the client's render, from 1. 0 stands for all gradients, whose failures are looked up later.
    pub number: u64,
}

impl Call {
    /// The client's gradients.
    pub fn gradients(self) -> Self {
        Self { number: 0, ..self }
    }

    /// The scalars of an operation. A render has a seed.
    pub fn scalars(self, seed: u64) -> Vec<ScalarIr> {
        [self.client, self.number, seed]
            .map(ScalarIr::UInt)
            .to_vec()
    }

    /// The call and the seed of an operation's scalars.
    pub fn of_scalars(scalars: &[ScalarIr]) -> Option<(Self, u64)> {
        match *scalars {
            [
                ScalarIr::UInt(client),
                ScalarIr::UInt(number),
                ScalarIr::UInt(seed),
            ] => Some((Self { client, number }, seed)),
            _ => None,
        }
    }
}

/// The scenes of a batch. The distinct ones follow in the same bytes, after the hash of the topology and this.
#[derive(Serialize, Deserialize)]
pub(super) struct Scenes {
    pub distinct: usize,
    pub of_batch: Vec<u32>,
    pub vertices: Vec<(String, Vertices)>,
}

#[derive(Serialize, Deserialize)]
pub(super) struct Vertices(#[serde(with = "slots::tensor")] pub Tensor<3>);

/// What changes more often than the scenes.
#[derive(Serialize, Deserialize)]
pub(super) struct Views {
    pub views: Vec<(usize, Camera)>,
    pub pixels: Option<Vec<u32>>,
    /// With the seed 0.
    pub options: RenderOptions,
    /// The client's cache.
    pub cache: Option<u64>,
    pub quiet: bool,
    pub normalization: Option<Normalization>,
}

/// A batch that was received.
pub(crate) struct Received {
    pub batch: Batch,
    pub options: RenderOptions,
    pub pixels: Option<Arc<Vec<u32>>>,
    /// Leaf tensors in place of the client's tracked tensors, in their order.
    pub leaves: Vec<Tensor<1>>,
    /// The client's cache, which the options lack.
    pub cache: Option<u64>,
}

/// Makes the batch of a message. `topology` returns the lists with a hash.
pub(crate) fn receive(
    seed: u64,
    topology: impl FnOnce(&Hash) -> Result<Arc<Topology>>,
    [scenes, views]: [&[u32]; 2],
    tensors: Vec<DispatchTensor>,
) -> Result<Received> {
    let bytes = unpack(scenes).ok_or_else(|| malformed("too short"))?;
    let mut decoder = rmp_serde::Deserializer::from_read_ref(&bytes[..]);
    let hash = Hash::deserialize(&mut decoder).map_err(malformed)?;
    let read = Read {
        topology: topology(&hash)?,
        tensors,
        leaves: BTreeMap::new(),
    };
    let parts = || -> Result<(Scenes, Vec<Scene>, Views)> {
        let head = Scenes::deserialize(&mut decoder).map_err(malformed)?;
        let each = (0..head.distinct).map(|_| Scene::deserialize(&mut decoder).map_err(malformed));
        let distinct = each.collect::<Result<Vec<_>>>()?;
        Ok((head, distinct, decode(views)?))
    };
    let (parts, read) = slots::read(read, parts);
    let (head, distinct, views) = parts?;
    let scene = |&i: &u32| distinct.get(i as usize).cloned();
    let scenes: Option<Vec<Scene>> = head.of_batch.iter().map(scene).collect();
    let scenes = scenes.ok_or_else(|| malformed("a scene is missing"))?;
    let mut batch = Batch::views(scenes, views.views)?;
    for (name, Vertices(values)) in head.vertices {
        batch = batch.with_vertices(name, values)?;
    }
    let mut options = views.options.with_seed(seed);
    if let Some(normalization) = views.normalization {
        options = options.normalization_or(normalization);
    }
    if views.quiet {
        options = options.quietly();
    }
    Ok(Received {
        batch,
        options,
        pixels: views.pixels.map(Arc::new),
        leaves: read.leaves.into_values().collect(),
        cache: views.cache,
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
