//! The lists of scenes in two buffers, one of floats and one of words, which stay on the device from render to
//! render. Only blocks that have changed since the last render are sent.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use burn::backend::StreamId;
use burn::tensor::Device;
use rayon::prelude::*;

use crate::accel::Parts;
use crate::cube::*;

use super::device::{List, launch};
use super::made::make_lists;
use super::nodes::make_nodes;

/// Number of words in a block.
const BLOCK: usize = 1024;
/// Lists begin at multiples of this number of words, which kernels may load at once.
const FOUR: usize = 4;
/// Maximum number of blocks in one transfer: 64 MiB.
const AT_ONCE: usize = 1 << 14;

/// Lists of 32-bit numbers, one after another, each stored once.
#[derive(Default)]
pub(super) struct Plan<'a> {
    /// The start of each list, the list, and whether lists that the device makes depend on it.
    lists: Vec<(usize, &'a [u32], bool)>,
    length: usize,
    /// The starts of lists by their addresses and lengths.
    known: HashMap<(*const u32, usize), u32>,
}

impl<'a> Plan<'a> {
    /// Returns where a list begins, and adds the list if it is new.
    pub fn place<T: CubeElement>(&mut self, list: &'a [T], shapes: bool) -> u32 {
        let list: &[u32] = u32::from_bytes(T::as_bytes(list));
        let key = (list.as_ptr(), list.len());
        if let Some(&start) = self.known.get(&key) {
            return start;
        }
        let start = self.length.next_multiple_of(FOUR);
        self.lists.push((start, list, shapes));
        self.length = start + list.len();
        self.known.insert(key, start as u32);
        start as u32
    }

    /// Reserves `words` words in blocks of their own, which the device writes and the host never sends.
    pub fn room(&mut self, words: usize) -> u32 {
        let start = self.length.next_multiple_of(BLOCK);
        self.length = (start + words).next_multiple_of(BLOCK);
        start as u32
    }

    /// Creates a plan with `words` words reserved ahead of all lists.
    pub fn after(words: usize) -> Self {
        Self {
            length: words,
            ..Self::default()
        }
    }

    /// Writes `head` and all lists into a buffer, and determines which blocks differ from the last render. If lists have
    /// changed in size, all do, since the device may have written where a list now is.
    pub fn fill(mut self, head: &'a [u32], last: Buffer) -> Buffer {
        self.lists.insert(0, (0, head, false));
        let places = self.lists.iter().map(|l| [l.0, l.1.len()]).collect();
        let alike = last.words.len() == self.length && last.places == places;
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
            places,
        }
    }
}

/// The content of a buffer on the host.
#[derive(Default)]
pub(super) struct Buffer {
    words: Vec<u32>,
    /// The start and the length of each list.
    places: Vec<[usize; 2]>,
    /// The blocks that differ from the last render.
    changed: Vec<u32>,
    /// Whether the device must make its lists again, because a list that they depend on has changed.
    shapes: bool,
}

impl Buffer {
    fn block(&self, k: u32) -> &[u32] {
        let first = k as usize * BLOCK;
        &self.words[first..self.words.len().min(first + BLOCK)]
    }
}

/// The lists that the device makes: the start of the table of scenes among the words, the number of scenes, and the
/// number of threads that make their lists.
#[derive(Default)]
pub(super) struct Made {
    pub table: u32,
    pub scenes: u32,
    pub threads: u32,
    /// For each launch, the largest number of parts of a scene's tree over triangles and of its tree over edges.
    pub levels: Vec<[u32; 2]>,
    pub moves: bool,
}

impl Made {
    /// Adds a scene's trees over triangles and over edges. The launch of level k of the former makes level k − 1 of the
    /// latter, since leaves of edges must be made before.
    pub fn add_levels(&mut self, trees: [&Parts; 2]) {
        for (tree, parts) in trees.into_iter().enumerate() {
            let levels = parts.levels.windows(2).map(|first| first[1] - first[0]);
            for (level, count) in levels.enumerate() {
                let launch = level + tree;
                if self.levels.len() <= launch {
                    self.levels.resize(launch + 1, [0; 2]);
                }
                let most = &mut self.levels[launch][tree];
                *most = count.max(*most);
            }
        }
    }
}

/// The buffers of floats and of words, on the host and on a device.
#[derive(Default)]
pub(crate) struct Buffers {
    floats: Buffer,
    words: Buffer,
    made: Made,
    sent: Mutex<Sent>,
}

/// The lists on a device: floats, words, and a placeholder for kernels without a list of pixels.
#[derive(Default)]
struct Sent {
    lists: Option<[List; 3]>,
    /// Whether the lists hold the data of this render. Otherwise they hold the data of the last render.
    current: bool,
    /// The streams whose launches read the lists.
    streams: Vec<StreamId>,
}

impl Buffers {
    /// Creates buffers from lists, with `head` at the start of the words. The buffers of the last render are reused
    /// if they were sent and have the same lengths.
    pub(super) fn new<'a>(
        floats: Plan<'a>,
        words: Plan<'a>,
        head: &'a [u32],
        made: Made,
        last: Self,
    ) -> Self {
        let sent = last.sent.into_inner();
        let sent = sent.unwrap_or_else(PoisonError::into_inner);
        // Unsent buffers are not on the device, and buffers of another length have no space there for the lists.
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

    /// Returns the words: the headers of views, then the lists.
    pub fn header(&self) -> &[u32] {
        &self.words.words
    }

    /// Returns the length of the longer buffer.
    pub fn longest(&self) -> usize {
        self.floats.words.len().max(self.words.words.len())
    }

    /// Returns the lists on the device. The first call sends them: only the changed blocks if the last buffers are
    /// reused.
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

    /// Returns the streams whose launches read the lists.
    fn streams(&self) -> Vec<StreamId> {
        let sent = self.sent.lock().unwrap_or_else(PoisonError::into_inner);
        sent.streams.clone()
    }

    /// Drops the lists on the device, because a failed launch may have left them with undefined content.
    pub fn forget(&self) {
        *self.sent.lock().unwrap_or_else(PoisonError::into_inner) = Sent::default();
    }

    /// Sends the blocks that have changed since the last render, and remakes the lists that depend on them.
    fn write(&self, client: &Client, [floats, words, _]: &[List; 3]) {
        let both = [&self.floats, &self.words];
        let numbers = both.map(|b| &b.changed[..]).concat();
        // Each part fits into one list on any device.
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
        let made = &self.made;
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
            // The threads of `make_lists` have made the first level of trees over triangles.
            for (level, &[most, of_edges]) in made.levels.iter().enumerate().skip(1) {
                launch!(
                    client,
                    (made.scenes * (most + of_edges)) as usize,
                    make_nodes(
                        floats,
                        words,
                        made.table,
                        made.scenes,
                        level as u32,
                        most,
                        of_edges,
                        made.moves
                    )
                );
            }
        }
    }
}

/// Writes blocks into the two lists. The first `of_floats` blocks belong to the floats.
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

/// The buffers of the last render with a cache, one entry per group of views. They are reused on the same device if
/// no graph holds them and all launches that read them are in the stream of this thread. Changes are then written
/// after these launches.
#[derive(Clone, Default)]
pub(crate) struct LastBuffers(Arc<Mutex<Vec<Last>>>);

/// The device and the buffers of a group.
type Last = (Device, Arc<Buffers>);

impl LastBuffers {
    fn lock(&self) -> MutexGuard<'_, Vec<Last>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes the buffers of all groups. Buffers that cannot be reused are replaced by empty ones.
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

    /// Stores the buffers of a render that has succeeded.
    pub fn keep(&self, device: &Device, buffers: impl Iterator<Item = Arc<Buffers>>) {
        *self.lock() = buffers.map(|buffers| (device.clone(), buffers)).collect();
    }
}
