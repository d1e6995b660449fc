//! Vertices at one place.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use rayon::prelude::*;

/// A fast hasher. Keys are the bits of positions, which need no protection from chosen collisions.
#[derive(Default)]
struct Mix(u64);

impl Hasher for Mix {
    fn finish(&self) -> u64 {
        self.0 ^ (self.0 >> 29)
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|&b| self.write_u64(u64::from(b)));
    }

    fn write_u64(&mut self, value: u64) {
        let mixed = (self.0.rotate_left(23) ^ value).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.0 = mixed ^ (mixed >> 32);
    }

    fn write_usize(&mut self, value: usize) {
        self.write_u64(value as u64);
    }
}

/// The vertices of an object, grouped by place.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Weld {
    /// The place of each vertex.
    of_vertex: Vec<u32>,
    /// The number of places.
    count: usize,
}

impl Weld {
    /// Joins the vertices that have the same position.
    pub fn new(positions: &[[f64; 3]]) -> Self {
        // −0 and 0 are the same place.
        let key = |p: &[f64; 3]| p.map(|x| (x + 0.0).to_bits());
        // Two sets of hash values: `once` for values of at least one vertex, `again` for values of several. A vertex
        // whose value is not in `again` is alone.
        let bits = (16 * positions.len()).next_power_of_two().max(64);
        let (mut once, mut again) = (vec![0u64; bits / 64], vec![0u64; bits / 64]);
        let hash = |p: &[f64; 3]| {
            let mut hash = Mix::default();
            key(p).into_iter().for_each(|word| hash.write_u64(word));
            hash.finish() as usize % bits
        };
        let hashes: Vec<usize> = positions.par_iter().map(hash).collect();
        let place_of = |hash: usize| (hash / 64, 1 << (hash % 64));
        for (word, bit) in hashes.iter().copied().map(place_of) {
            again[word] |= once[word] & bit;
            once[word] |= bit;
        }
        let mut several: HashMap<[u64; 3], u32, BuildHasherDefault<Mix>> = HashMap::default();
        let mut count = 0;
        let place = |(p, &hash)| {
            let (word, bit) = place_of(hash);
            let next = count;
            let place = if again[word] & bit == 0 {
                next
            } else {
                *several.entry(key(p)).or_insert(next)
            };
            count += u32::from(place == next);
            place
        };
        let of_vertex = positions.iter().zip(&hashes).map(place).collect();
        Self {
            of_vertex,
            count: count as usize,
        }
    }

    /// The number of places.
    pub fn count(&self) -> usize {
        self.count
    }

    /// The place of a vertex.
    pub fn place(&self, vertex: u32) -> u32 {
        self.of_vertex[vertex as usize]
    }
}
