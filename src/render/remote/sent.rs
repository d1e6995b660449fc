//! What a client knows of its servers.

use std::sync::{Mutex, MutexGuard, PoisonError};

use burn::backend::RemoteDevice;
use burn::tensor::{Device, Int, Tensor};

use super::bounded::{Bounded, LEAST_WEIGHT};
use super::words::{Hash, hash, tensor};

/// The most bytes that a client keeps on each server between its renders.
const KEPT: usize = 1 << 28;

static SERVERS: Mutex<Vec<Server>> = Mutex::new(Vec::new());

pub(super) struct Server {
    device: RemoteDevice,
    /// Whether its version is that of this program.
    pub checked: bool,
    /// Parts of scenes, which do not have to be sent again.
    parts: Bounded<Hash, Tensor<1, Int>>,
    /// The results of gradients that were not looked at yet: success, and a message.
    pub gradients: Vec<[Tensor<1, Int>; 2]>,
}

/// Calls `f` with what is known of a server.
pub(super) fn server<T>(device: &RemoteDevice, f: impl FnOnce(&mut Server) -> T) -> T {
    let mut servers: MutexGuard<'_, Vec<Server>> =
        SERVERS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(known) = servers.iter_mut().find(|server| server.device == *device) {
        return f(known);
    }
    servers.push(Server {
        device: device.clone(),
        checked: false,
        parts: Bounded::new(KEPT),
        gradients: Vec::new(),
    });
    f(servers.last_mut().expect("a server"))
}

impl Server {
    /// Returns a part on the server. It is sent unless it was sent before.
    pub fn part(&mut self, words: Vec<u32>, device: &Device) -> Tensor<1, Int> {
        let key = hash(&words);
        self.parts.get(&key).unwrap_or_else(|| {
            let bytes = (4 * words.len()).max(LEAST_WEIGHT);
            let part = tensor(words, device);
            self.parts.insert(key, part.clone(), bytes);
            part
        })
    }
}
