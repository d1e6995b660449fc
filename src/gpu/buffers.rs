//! The lists of scenes in two buffers, one of floats and one of words, which stay on the device from render to
//! render. Only blocks that have changed since the last render are sent.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use burn::backend::StreamId;
use burn::tensor::Device;

use softray_kernels::accel::Parts;
use softray_kernels::cube::*;

use super::device::{List, launch};
use super::made::make_lists;
use super::nodes::make_nodes;
use super::placed::{Placing, Reading, Row, ViewPlaces};
use super::plan::{BLOCK, Buffer, Plan};

/// Maximum number of blocks in one transfer: 64 MiB.
const AT_ONCE: usize = 1 << 14;

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

/// Returns a number that no buffers have.
fn next_number() -> u64 {
    static LAST: AtomicU64 = AtomicU64::new(0);
    1 + LAST.fetch_add(1, Ordering::Relaxed)
}

/// The buffers of floats and of words, on the host and on a device.
#[derive(Default)]
pub(crate) struct Buffers {
    /// Distinguishes them from the buffers of other renders.
    number: u64,
    floats: Buffer,
    words: Buffer,
    made: Made,
    /// The tensors that the device places into its lists after these were sent. The host's copy then differs.
    placing: Option<Placing>,
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
    /// The longest move of a vertex ([`Placing::place`]).
    moved: Option<Reading>,
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
        let [mut of_floats, of_words] = match serves {
            true => [last.floats, last.words],
            false => Default::default(),
        };
        if let Some(placing) = last.placing.filter(|_| serves) {
            // No list has these numbers.
            let ranges = placing.ranges.into_iter();
            ranges.for_each(|range| of_floats.words[range].fill(u32::MAX));
        }
        Self {
            number: next_number(),
            floats: floats.fill(&[], of_floats),
            words: words.fill(head, of_words),
            made,
            placing: None,
            sent: Mutex::new(Sent {
                lists: sent.lists.filter(|_| serves),
                ..Sent::default()
            }),
        }
    }

    pub fn number(&self) -> u64 {
        self.number
    }

    /// Returns the buffers again, or `None` if they have another number or are not on the device. The device places
    /// tensors into them, and replaces lists that begin at given places among the words.
    pub fn again(
        mut self,
        number: u64,
        row: &Row,
        views: &[ViewPlaces],
        others: &[(u32, &[u32])],
    ) -> Option<Self> {
        let sent = self.sent.get_mut();
        let sent = sent.unwrap_or_else(PoisonError::into_inner);
        if !std::mem::take(&mut sent.current) || self.number != number {
            return None;
        }
        self.number = next_number();
        sent.streams.clear();
        for buffer in [&mut self.floats, &mut self.words] {
            buffer.changed.clear();
            buffer.shapes = false;
        }
        let mut replaced = Vec::new();
        for &(start, list) in others {
            for (place, &word) in (start..).zip(list) {
                self.words.words[place as usize] = word;
                replaced.push([place, word]);
            }
        }
        self.placing = Placing::new(row, views, self.header(), replaced);
        Some(self)
    }

    /// Lets the device place tensors into its lists after they were sent.
    pub fn place(&mut self, row: &Row, views: &[ViewPlaces]) {
        self.placing = Placing::new(row, views, self.header(), Vec::new());
    }

    /// Takes the longest move of a vertex when the device placed tensors.
    pub fn moved(&self) -> Option<Reading> {
        let mut sent = self.sent.lock().unwrap_or_else(PoisonError::into_inner);
        sent.moved.take()
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
            sent.moved = self.write(client, &lists);
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

    /// Sends the blocks that have changed since the last render, places tensors, and remakes the lists that depend on
    /// both.
    fn write(&self, client: &Client, [floats, words, _]: &[List; 3]) -> Option<Reading> {
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
        let placing = self.placing.as_ref();
        let moved = placing.map(|placing| placing.place(client, floats, words));
        let made = &self.made;
        let moves = placing.is_some_and(|placing| placing.moves);
        if made.threads > 0 && (moves || both.iter().any(|b| b.shapes)) {
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
        moved
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
