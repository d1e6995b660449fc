//! The content of a buffer of a scene's lists on the host, in blocks: where lists begin, and what has changed since the
//! last render.

use std::collections::HashMap;

use rayon::prelude::*;

use softray_kernels::cube::*;

/// Number of words in a block.
pub(super) const BLOCK: usize = 1024;
/// Lists begin at multiples of this number of words, which kernels may load at once.
const FOUR: usize = 4;

/// Lists of 32-bit numbers, one after another, each stored once.
#[derive(Default)]
pub(super) struct Plan<'a> {
    /// The start of each list, the list, and whether lists that the device makes depend on it.
    lists: Vec<(usize, &'a [u32], bool)>,
    pub length: usize,
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
    pub words: Vec<u32>,
    /// The start and the length of each list.
    places: Vec<[usize; 2]>,
    /// The blocks that differ from the last render.
    pub changed: Vec<u32>,
    /// Whether the device must make its lists again, because a list that they depend on has changed.
    pub shapes: bool,
}

impl Buffer {
    pub fn block(&self, k: u32) -> &[u32] {
        let first = k as usize * BLOCK;
        &self.words[first..self.words.len().min(first + BLOCK)]
    }
}
