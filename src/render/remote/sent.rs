//! What a client sends to its servers, and has sent before.

use std::sync::{Mutex, MutexGuard, PoisonError};

use burn::backend::RemoteDevice;
use burn::tensor::{Device, Int, Tensor};

use super::bounded::{Bounded, LEAST_WEIGHT};
use super::message::{Call, INPUTS, Scenes, Vertices, Views};
use super::words::{Hash, encode, hash, pack, tensor};
use crate::device::remote::unique;
use crate::error::Result;
use crate::render::batch::Batch;
use crate::render::options::RenderOptions;
use crate::scene::slots::{self, Places, Topology, Written};

/// The most bytes that a client keeps on each server between its renders.
const KEPT: usize = 1 << 28;
/// The most topologies whose hashes a client keeps.
const HASHES: usize = 64;

static SERVERS: Mutex<Vec<Server>> = Mutex::new(Vec::new());

pub(super) struct Server {
    device: RemoteDevice,
    /// The last render.
    call: Call,
    /// A word, for operations without another input.
    input: Option<Tensor<1, Int>>,
    /// Whether its version is that of this program.
    pub checked: bool,
    /// Whether a gradient may have failed since the server was last asked.
    pub pending: bool,
    /// Parts of scenes, which do not have to be sent again.
    parts: Bounded<Hash, Tensor<1, Int>>,
    /// The hashes of lists, which do not have to be computed again.
    hashes: Bounded<Places, Hash>,
}

/// Calls `f` with what is known of a server, which is locked with all others: it should take a moment.
pub(super) fn server<T>(device: &RemoteDevice, f: impl FnOnce(&mut Server) -> T) -> T {
    let mut servers: MutexGuard<'_, Vec<Server>> =
        SERVERS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(known) = servers.iter_mut().find(|server| server.device == *device) {
        return f(known);
    }
    servers.push(Server {
        device: device.clone(),
        call: Call {
            client: unique(),
            number: 0,
        },
        input: None,
        checked: false,
        pending: false,
        parts: Bounded::new(KEPT),
        hashes: Bounded::new(HASHES),
    });
    f(servers.last_mut().expect("a server"))
}

impl Server {
    /// Names the next render.
    pub fn next(&mut self) -> Call {
        self.call.number += 1;
        self.call
    }

    /// An input for operations without another one.
    pub fn input(&mut self, device: &Device) -> Tensor<1, Int> {
        let input = self.input.get_or_insert_with(|| tensor(vec![0], device));
        input.clone()
    }

    /// Names this client's gradients.
    pub fn gradients(&self) -> Call {
        self.call.gradients()
    }
}

/// A part of a batch on a server.
struct Part {
    hash: Hash,
    words: Tensor<1, Int>,
}

/// Returns a part on the server. It is sent unless it was sent before.
fn part(on: &RemoteDevice, words: Vec<u32>, device: &Device) -> Part {
    let hash = hash(&words);
    let sent = server(on, |known| known.parts.get(&hash));
    let words = sent.unwrap_or_else(|| {
        let bytes = (4 * words.len()).max(LEAST_WEIGHT);
        let part = tensor(words, device);
        server(on, |known| {
            known.parts.insert(hash, part.clone(), bytes);
        });
        part
    });
    Part { hash, words }
}

/// Returns lists on the server. Lists at the same places have the same values.
fn part_of_topology(on: &RemoteDevice, topology: &Topology, device: &Device) -> Part {
    let places = topology.places();
    let sent = server(on, |known| {
        let hash = known.hashes.get(&places)?;
        let words = known.parts.get(&hash)?;
        Some(Part { hash, words })
    });
    sent.unwrap_or_else(|| {
        let part = part(on, topology.words(), device);
        server(on, |known| known.hashes.insert(places, part.hash, 1));
        part
    })
}

/// A batch as words and tensors.
pub(super) struct Sending {
    /// The topology, scenes and views.
    pub parts: [Tensor<1, Int>; INPUTS],
    pub written: Written,
}

/// Returns the messages for a batch on a remote device.
pub(super) fn send(
    batch: &Batch,
    options: &RenderOptions,
    pixels: Option<&Vec<u32>>,
    on: &RemoteDevice,
    device: &Device,
) -> Result<Sending> {
    let parts = || -> Result<[Vec<u8>; 3]> {
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
        let head = encode(&Scenes {
            distinct: distinct.len(),
            of_batch,
            vertices: vertices.collect(),
        })?;
        let views = encode(&Views {
            views: batch.views.clone(),
            pixels: pixels.cloned(),
            options: options.clone().with_seed(0),
            cache: options.cache.as_ref().map(|cache| cache.id()),
            quiet: options.quiet,
            normalization: options.normalization(),
        })?;
        Ok([head, distinct.concat(), views])
    };
    let (parts, written) = slots::write(device, parts);
    let [head, scenes, views] = parts?;
    let topology = part_of_topology(on, &written.topology, device);
    let scenes = [encode(&topology.hash)?, head, scenes].concat();
    let [scenes, views] = [scenes, views].map(|bytes| part(on, pack(&bytes), device));
    let parts = [topology, scenes, views].map(|part| part.words);
    Ok(Sending { parts, written })
}
