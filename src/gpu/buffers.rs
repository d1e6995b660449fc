//! Lists of scenes in two buffers, floats and words, which stay on the device from render to render: what has changed
//! since the last one is sent in blocks.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use burn::backend::StreamId;
use burn::tensor::Device;
use rayon::prelude::*;

use crate::cube::*;

use super::device::{List, launch};

/// Words of a block.
const BLOCK: usize = 1024;

/// Lists of numbers of 32 bits, one behind the other, each once.
#[derive(Default)]
pub(super) struct Plan<'a> {
    lists: Vec<&'a [u32]>,
    starts: Vec<usize>,
    length: usize,
    /// Where lists begin, by their addresses.
    known: HashMap<(*const u32, usize), u32>,
}

impl<'a> Plan<'a> {
    /// Where a list begins, after it was added if it was not there.
    pub fn place<T: CubeElement>(&mut self, list: &'a [T]) -> u32 {
        let list: &[u32] = u32::from_bytes(T::as_bytes(list));
        *self
            .known
            .entry((list.as_ptr(), list.len()))
            .or_insert_with(|| {
                self.lists.push(list);
                self.starts.push(self.length);
                self.length += list.len();
                (self.length - list.len()) as u32
            })
    }

    /// Room for so many words ahead of all lists.
    pub fn after(words: usize) -> Self {
        Self {
            length: words,
            ..Self::default()
        }
    }

    /// All lists in a buffer, behind those of `head`, and the blocks in which it differs from the last render's.
    pub fn fill(mut self, head: &'a [u32], last: Buffer) -> Buffer {
        self.lists.insert(0, head);
        self.starts.insert(0, 0);
        let alike = last.words.len() == self.length;
        let mut words = last.words;
        if !alike {
            words = vec![0; self.length];
        }
        let fill = |(block, part): (usize, &mut [u32])| {
            let first = block * BLOCK;
            let mut changed = false;
            let mut k = self.starts.partition_point(|&start| start <= first) - 1;
            let mut at = 0;
            while at < part.len() {
                let list = &self.lists[k][first + at - self.starts[k]..];
                let list = &list[..list.len().min(part.len() - at)];
                let part = &mut part[at..at + list.len()];
                if part != list {
                    part.copy_from_slice(list);
                    changed = true;
                }
                at += list.len();
                k += 1;
            }
            changed.then_some(block as u32)
        };
        let changed = words.par_chunks_mut(BLOCK).enumerate().filter_map(fill);
        let changed: Vec<u32> = changed.collect();
        Buffer {
            words,
            changed: alike.then_some(changed),
        }
    }
}

/// The numbers of lists.
#[derive(Default)]
pub(crate) struct Buffer {
    pub words: Vec<u32>,
    /// The blocks in which they differ from those of the last render; None if all may.
    changed: Option<Vec<u32>>,
}

impl Buffer {
    fn block(&self, k: u32) -> &[u32] {
        let first = k as usize * BLOCK;
        &self.words[first..self.words.len().min(first + BLOCK)]
    }
}

/// Two buffers, of floats and of words, on the host and on a device.
#[derive(Default)]
pub(crate) struct Buffers {
    pub floats: Buffer,
    pub words: Buffer,
    sent: Mutex<Sent>,
}

/// What is on a device: both lists, and one for kernels that need none.
#[derive(Default)]
struct Sent {
    lists: Option<[List; 3]>,
    /// Whether they are those of this render, and not of the last.
    current: bool,
    /// The streams of launches that read them.
    streams: Vec<StreamId>,
}

impl Buffers {
    /// Buffers of lists, behind `head` in that of words, where those of the last render were.
    pub(super) fn new<'a>(floats: Plan<'a>, words: Plan<'a>, head: &'a [u32], last: Self) -> Self {
        let sent = last.sent.into_inner();
        let sent = sent.unwrap_or_else(PoisonError::into_inner);
        Self {
            floats: floats.fill(&[], last.floats),
            words: words.fill(head, last.words),
            sent: Mutex::new(Sent {
                // What was never sent is not on the device.
                lists: sent.lists.filter(|_| sent.current),
                ..Sent::default()
            }),
        }
    }

    /// Numbers of the longer one.
    pub fn longest(&self) -> usize {
        self.floats.words.len().max(self.words.words.len())
    }

    /// The lists on the device, which are sent there once: of those of the last render what has changed.
    pub fn on_device(&self, client: &Client) -> [List; 3] {
        let mut sent = self.sent.lock().unwrap_or_else(PoisonError::into_inner);
        let here = StreamId::current();
        if !sent.streams.contains(&here) {
            sent.streams.push(here);
        }
        let patched = |lists: &[List; 3]| self.patch(client, lists);
        if !sent.current && !sent.lists.as_ref().is_some_and(patched) {
            // Their memory serves the new ones.
            sent.lists = None;
            let lists = [&self.floats.words, &self.words.words].map(|w| u32::as_bytes(w));
            sent.lists = Some(List::send(client, [lists[0], lists[1], &[0; 4]]));
        }
        sent.current = true;
        sent.lists.clone().expect("they were sent")
    }

    /// The streams of launches that read the lists.
    fn streams(&self) -> Vec<StreamId> {
        let sent = self.sent.lock().unwrap_or_else(PoisonError::into_inner);
        sent.streams.clone()
    }

    /// Forgets what is on the device, after a launch that failed may have left anything there.
    pub fn forget(&self) {
        *self.sent.lock().unwrap_or_else(PoisonError::into_inner) = Sent::default();
    }

    /// Sends what has changed since the last render, unless that is most of it; and says whether it did.
    fn patch(&self, client: &Client, [floats, words, _]: &[List; 3]) -> bool {
        let both = [&self.floats, &self.words];
        let [Some(of_floats), Some(of_words)] = both.map(|b| b.changed.as_deref()) else {
            return false;
        };
        let count = of_floats.len() + of_words.len();
        if 4 * count * BLOCK > 3 * (floats.length + words.length) {
            return false;
        }
        if count > 0 {
            let numbers = [of_floats, of_words].concat();
            let mut data = Vec::with_capacity(count * BLOCK);
            for (buffer, blocks) in both.into_iter().zip([of_floats, of_words]) {
                for &k in blocks {
                    let past = data.len() + BLOCK;
                    data.extend(buffer.block(k));
                    data.resize(past, 0);
                }
            }
            let lists = [&numbers, &data].map(|w| u32::as_bytes(w));
            let [numbers, data] = List::send(client, lists);
            let of_floats = of_floats.len() as u32;
            launch!(
                client,
                count * BLOCK,
                write_blocks(floats, words, &numbers, &data, of_floats)
            );
        }
        true
    }
}

/// Writes blocks into lists, the first ones into that of floats.
#[cube(launch)]
fn write_blocks(
    floats: &mut [u32],
    words: &mut [u32],
    numbers: &[u32],
    data: &[u32],
    of_floats: u32,
) {
    let block = ABSOLUTE_POS / BLOCK;
    if block < numbers.len() {
        let to = numbers[block] as usize * BLOCK + ABSOLUTE_POS % BLOCK;
        if (block as u32) < of_floats {
            if to < floats.len() {
                floats[to] = data[ABSOLUTE_POS];
            }
        } else if to < words.len() {
            words[to] = data[ABSOLUTE_POS];
        }
    }
}

/// The buffers of the last render with a cache, by group of views. They serve again on the same device, where no graph
/// holds them and all launches that read them are in the stream of this thread: then what changes comes behind these.
#[derive(Clone, Default)]
pub(crate) struct LastBuffers(Arc<Mutex<Vec<Last>>>);

/// Those of a group, and the device that they are on.
type Last = (Device, Arc<Buffers>);

impl LastBuffers {
    fn lock(&self) -> MutexGuard<'_, Vec<Last>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes those of all groups out.
    pub fn take(&self, device: &Device) -> impl Iterator<Item = Buffers> {
        let last = std::mem::take(&mut *self.lock()).into_iter();
        last.map(move |(on, buffers)| {
            let buffers = Arc::try_unwrap(buffers).unwrap_or_default();
            let here = StreamId::current();
            let streams = buffers.streams();
            let serves = on == *device && streams.iter().all(|&stream| stream == here);
            if serves { buffers } else { Buffers::default() }
        })
    }

    /// Keeps those of a render that has succeeded.
    pub fn keep(&self, device: &Device, buffers: impl Iterator<Item = Arc<Buffers>>) {
        *self.lock() = buffers.map(|buffers| (device.clone(), buffers)).collect();
    }
}
