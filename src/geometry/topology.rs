//! Connectivity of triangles, on the host.

use rayon::prelude::*;

use softray_kernels::host::Weld;

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

impl Topology {
    /// Adds an object's faces, welded by position. The object is closed if every welded edge has two faces of opposite
    /// direction.
    pub fn push_object(&mut self, weld: &Weld, faces: &[[u32; 3]], materials: &[u32]) {
        let object = self.object.last().map_or(0, |o| o + 1);
        let corners: Vec<[u32; 3]> = faces.iter().map(|f| f.map(|i| weld.place(i))).collect();

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

        self.neighbors.push_object(corners, weld.count());
        let n = faces.len();
        self.object.extend(std::iter::repeat_n(object, n));
        self.material.extend_from_slice(&materials[..n]);
        self.closed.extend(std::iter::repeat_n(closed, n));
        self.visible_side.extend(std::iter::repeat_n(0.0, n));
    }
}
