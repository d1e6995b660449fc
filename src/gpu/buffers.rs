//! Lists of scenes in two buffers, floats and words, which stay on the device from render to render: what has changed
//! since the last one is sent in blocks.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use burn::backend::StreamId;
use burn::tensor::Device;
use rayon::prelude::*;

use crate::cube::*;

use super::device::{List, launch};
use super::made::make_lists;

/// Words of a block.
const BLOCK: usize = 1024;
/// Blocks that are sent at once, at most: 64 MiB.
const AT_ONCE: usize = 1 << 14;

/// Lists of numbers of 32 bits, one behind the other, each once.
#[derive(Default)]
pub(super) struct Plan<'a> {
    /// Where each list begins, the list, and whether lists that the device makes depend on it.
    lists: Vec<(usize, &'a [u32], bool)>,
    length: usize,
    /// Where lists begin, by their addresses.
    known: HashMap<(*const u32, usize), u32>,
}

impl<'a> Plan<'a> {
    /// Where a list begins, after it was added if it was not there.
    pub fn place<T: CubeElement>(&mut self, list: &'a [T], shapes: bool) -> u32 {
        let list: &[u32] = u32::from_bytes(T::as_bytes(list));
        let key = (list.as_ptr(), list.len());
        if let Some(&start) = self.known.get(&key) {
            return start;
        }
        let start = self.length;
        self.lists.push((start, list, shapes));
        self.length += list.len();
        self.known.insert(key, start as u32);
        start as u32
    }

    /// Room for so many words, in blocks of their own: what the device writes there is never sent.
    pub fn room(&mut self, words: usize) -> u32 {
        let start = self.length.next_multiple_of(BLOCK);
        self.length = (start + words).next_multiple_of(BLOCK);
        start as u32
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
        self.lists.insert(0, (0, head, false));
        let alike = last.words.len() == self.length;
        let mut words = last.words;
        if !alike {
            words = vec![0; self.length];
        }
        let fill = |(block, part): (usize, &mut [u32])| {
            let first = block * BLOCK;
            let past = first + part.len();
            let (mut changed, mut shapes) = (false, false);
            let ends_behind =
                |&(start, list, _): &(usize, &[u32], bool)| start + list.len() <= first;
            let from = self.lists.partition_point(ends_behind);
            for &(start, list, is) in &self.lists[from..] {
                if start >= past {
                    break;
                }
                let (low, high) = (first.max(start), past.min(start + list.len()));
                if low >= high {
                    continue;
                }
                let (own, part) = (
                    &list[low - start..high - start],
                    &mut part[low - first..high - first],
                );
                if !alike || part != own {
                    part.copy_from_slice(own);
                    changed = true;
                    shapes |= is;
                }
            }
            changed.then_some((block as u32, shapes))
        };
        let changed = words.par_chunks_mut(BLOCK).enumerate().filter_map(fill);
        let changed: Vec<(u32, bool)> = changed.collect();
        Buffer {
            shapes: changed.iter().any(|c| c.1),
            changed: changed.into_iter().map(|c| c.0).collect(),
            words,
        }
    }
}

/// The numbers of lists.
#[derive(Default)]
pub(super) struct Buffer {
    words: Vec<u32>,
    /// The blocks in which they differ from those of the last render.
    changed: Vec<u32>,
    /// Whether what the device makes differs too.
    shapes: bool,
}

impl Buffer {
    fn block(&self, k: u32) -> &[u32] {
        let first = k as usize * BLOCK;
        &self.words[first..self.words.len().min(first + BLOCK)]
    }
}

/// What the device makes: where the table of scenes is among the words, how many these are, and how many threads make their
/// lists.
#[derive(Clone, Copy, Default)]
pub(super) struct Made {
    pub table: u32,
    pub scenes: u32,
    pub threads: u32,
    pub moves: bool,
}

/// Two buffers, of floats and of words, on the host and on a device.
#[derive(Default)]
pub(crate) struct Buffers {
    floats: Buffer,
    words: Buffer,
    made: Made,
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
    pub(super) fn new<'a>(
        floats: Plan<'a>,
        words: Plan<'a>,
        head: &'a [u32],
        made: Made,
        last: Self,
    ) -> Self {
        let sent = last.sent.into_inner();
        let sent = sent.unwrap_or_else(PoisonError::into_inner);
        // What was never sent is not on the device, and what is not as long has no room there.
        let serves = sent.current
            && floats.length == last.floats.words.len()
            && words.length == last.words.words.len();
        let [of_floats, of_words] = match serves {
            true => [last.floats, last.words],
            false => Default::default(),
        };
        Self {
            floats: floats.fill(&[], of_floats),
            words: words.fill(head, of_words),
            made,
            sent: Mutex::new(Sent {
                lists: sent.lists.filter(|_| serves),
                ..Sent::default()
            }),
        }
    }

    /// The headers of views, and the lists of words behind them.
    pub fn header(&self) -> &[u32] {
        &self.words.words
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
        let lists = sent.lists.get_or_insert_with(|| {
            let lengths = [self.floats.words.len(), self.words.words.len(), 1];
            lengths.map(|length| List::room(client, length.max(1)))
        });
        let lists = lists.clone();
        if !sent.current {
            self.write(client, &lists);
            sent.current = true;
        }
        lists
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

    /// Sends what has changed since the last render, and makes what follows from it.
    fn write(&self, client: &Client, [floats, words, _]: &[List; 3]) {
        let both = [&self.floats, &self.words];
        let numbers = both.map(|b| &b.changed[..]).concat();
        // In parts that any device takes as one list.
        for (part, numbers) in numbers.chunks(AT_ONCE).enumerate() {
            let of_floats = self.floats.changed.len().saturating_sub(part * AT_ONCE);
            let of_floats = of_floats.min(numbers.len());
            let mut data = Vec::with_capacity(numbers.len() * BLOCK);
            for (i, &k) in numbers.iter().enumerate() {
                data.extend(both[usize::from(i >= of_floats)].block(k));
                data.resize((i + 1) * BLOCK, 0);
            }
            let lists = [numbers, &data].map(u32::as_bytes);
            let [numbers, data] = List::send(client, lists);
            launch!(
                client,
                data.length,
                write_blocks(floats, words, &numbers, &data, of_floats as u32)
            );
        }
        let made = self.made;
        if made.threads > 0 && both.iter().any(|b| b.shapes) {
            launch!(
                client,
                made.threads as usize,
                make_lists(
                    floats,
                    words,
                    made.table,
                    made.scenes,
                    made.threads,
                    made.moves
                )
            );
        }
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
