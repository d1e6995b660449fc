//! Connectivity of triangles, on the host.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use rayon::prelude::*;

/// The connectivity of triangles, on the host: neighbors, objects, closed surfaces.
#[derive(Clone, Debug, Default)]
pub struct Topology {
    /// The object of each triangle.
    pub object: Vec<u32>,
    /// The material of each triangle, an index into the scene's flattened materials.
    pub material: Vec<u32>,
    /// Whether the object of each triangle is closed.
    pub closed: Vec<bool>,
    /// Triangles of the same object that share a welded vertex.
    pub neighbors: Neighbors,
    /// The side of each triangle that rays can see: for a closed object +1 for n·d > 0 or −1 for n·d < 0, d the
    /// direction of the ray; for an open object 0, which is both sides.
    pub visible_side: Vec<f64>,
}

/// The triangles that share a vertex: the place (welded vertex) of each corner, and the triangles at each place. The
/// size is linear in the triangles, however many of them share one place.
#[derive(Clone, Debug)]
pub struct Neighbors {
    corners: Vec<[u32; 3]>,
    /// The start of each place in `list`, and the end of the last.
    starts: Vec<usize>,
    list: Vec<u32>,
}

impl Default for Neighbors {
    fn default() -> Self {
        Self {
            corners: Vec::new(),
            starts: vec![0],
            list: Vec::new(),
        }
    }
}

impl Neighbors {
    /// Creates triangles without neighbors.
    #[cfg(test)]
    pub fn none(triangles: usize) -> Self {
        let mut neighbors = Self::default();
        let corners = (0..triangles as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]);
        neighbors.push_object(corners.collect(), 3 * triangles);
        neighbors
    }

    /// Returns the neighbors of a triangle. Some may occur more than once.
    pub fn of(&self, triangle: u32) -> impl Iterator<Item = u32> {
        let at = |p: u32| &self.list[self.starts[p as usize]..self.starts[p as usize + 1]];
        let around = self.corners[triangle as usize].into_iter().flat_map(at);
        around.copied().filter(move |&k| k != triangle)
    }

    /// Returns whether two triangles share a vertex.
    pub fn are(&self, k: u32, l: u32) -> bool {
        let (p, q) = (self.corners[k as usize], self.corners[l as usize]);
        k != l && p.iter().any(|v| q.contains(v))
    }

    /// Adds an object's triangles. `corners` has the place of each corner, `places` is the number of places.
    fn push_object(&mut self, mut corners: Vec<[u32; 3]>, places: usize) {
        let (first, base) = (self.corners.len() as u32, self.list.len());
        let mut starts = vec![0usize; places + 1];
        for &p in corners.iter().flatten() {
            starts[p as usize + 1] += 1;
        }
        for p in 0..places {
            starts[p + 1] += starts[p];
        }
        let mut next = starts.clone();
        self.list.resize(base + 3 * corners.len(), 0);
        for (k, w) in corners.iter().enumerate() {
            for &p in w {
                self.list[base + next[p as usize]] = first + k as u32;
                next[p as usize] += 1;
            }
        }
        let shift = self.starts.len() as u32 - 1;
        self.starts.extend(starts[1..].iter().map(|s| base + s));
        corners.iter_mut().flatten().for_each(|p| *p += shift);
        self.corners.extend(corners);
    }
}

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
    pub(crate) fn count(&self) -> usize {
        self.count
    }

    /// The place of a vertex.
    pub(crate) fn place(&self, vertex: u32) -> u32 {
        self.of_vertex[vertex as usize]
    }
}

impl Topology {
    /// Adds an object's faces, welded by position. The object is closed if every welded edge has two faces of opposite
    /// direction.
    pub fn push_object(&mut self, weld: &Weld, faces: &[[u32; 3]], materials: &[u32]) {
        let object = self.object.last().map_or(0, |o| o + 1);
        let welded = &weld.of_vertex;
        let corners: Vec<[u32; 3]> = faces
            .iter()
            .map(|f| f.map(|i| welded[i as usize]))
            .collect();

        // Each edge must occur once in each direction: then the sorted edges and the sorted reversed edges are the
        // same.
        let directed = |turned: bool| {
            let mut edges: Vec<u64> = corners
                .iter()
                .flat_map(|w| {
                    [0, 1, 2].map(|i| {
                        let (p, q) = (u64::from(w[i]), u64::from(w[(i + 1) % 3]));
                        if turned { (q << 32) | p } else { (p << 32) | q }
                    })
                })
                .collect();
            edges.par_sort_unstable();
            edges
        };
        let edges = directed(false);
        let once = edges.windows(2).all(|e| e[0] != e[1]);
        let loops = corners
            .iter()
            .any(|w| w[0] == w[1] || w[1] == w[2] || w[2] == w[0]);
        let closed = !faces.is_empty() && once && !loops && edges == directed(true);

        self.neighbors.push_object(corners, weld.count);
        let n = faces.len();
        self.object.extend(std::iter::repeat_n(object, n));
        self.material.extend_from_slice(&materials[..n]);
        self.closed.extend(std::iter::repeat_n(closed, n));
        self.visible_side.extend(std::iter::repeat_n(0.0, n));
    }
}
