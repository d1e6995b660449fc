//! The surface where a field is zero, by marching tetrahedra on those cells of a lattice that it passes.

use std::collections::{HashMap, HashSet};
use std::hash::{BuildHasherDefault, Hasher};

use glam::DVec3;
use rayon::prelude::*;

use super::mesh::TriangleMesh;

/// The most cells along an axis, so that those at a surface fit into the memory.
pub(super) const MAX_CELLS: u32 = 1 << 10;

/// A cube of `cells`³ cells with edges of the length `step`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lattice {
    pub corner: DVec3,
    pub step: f64,
    pub cells: u32,
}

/// A fast hasher for places in the lattice.
#[derive(Default)]
pub(super) struct Mix(u64);

impl Hasher for Mix {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|&b| self.write_u64(u64::from(b)));
    }

    fn write_u64(&mut self, value: u64) {
        let mixed = (self.0 ^ value).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.0 = mixed ^ (mixed >> 32);
    }
}

type Map<V> = HashMap<u64, V, BuildHasherDefault<Mix>>;
type Set = HashSet<u64, BuildHasherDefault<Mix>>;

/// A place in the lattice in one number.
fn key([x, y, z]: [u32; 3]) -> u64 {
    (u64::from(z) << 42) | (u64::from(y) << 21) | u64::from(x)
}

fn place(key: u64) -> [u32; 3] {
    [0, 21, 42].map(|shift| (key >> shift) as u32 & 0x1f_ffff)
}

/// The corner of a cell whose number has the axes as bits: 1 is x, 2 is y, 4 is z.
fn corner_of([x, y, z]: [u32; 3], corner: u32) -> [u32; 3] {
    [x + (corner & 1), y + (corner >> 1 & 1), z + (corner >> 2)]
}

/// The paths from corner 0 to corner 7 of a cell along its edges: each is a tetrahedron (Kuhn 1960), and those of
/// neighboring cells fit. The flag tells whether the corners are in positive order.
const TETRAHEDRA: [([u32; 4], bool); 6] = [
    ([0, 1, 3, 7], true),
    ([0, 1, 5, 7], false),
    ([0, 2, 6, 7], true),
    ([0, 2, 3, 7], false),
    ([0, 4, 5, 7], true),
    ([0, 4, 6, 7], false),
];

impl Lattice {
    fn point(&self, at: [u32; 3]) -> DVec3 {
        let [x, y, z] = at.map(f64::from);
        self.corner + DVec3::new(x, y, z) * self.step
    }

    /// The surface between the places where `field` is above 0 and where it is not: closed, oriented with the front
    /// towards lower values, and manifold at edges and vertices, without faces that cross. Cells are divided where the
    /// field, which changes by at most `slope` per unit of length, may be 0. Outside of the lattice and on its border
    /// the field counts as negative.
    pub fn surface(&self, slope: f64, field: impl Fn(DVec3) -> f64 + Sync) -> TriangleMesh {
        let candidates = self.candidates(slope, &field);
        let (cells, values) = self.straddling(candidates, &field);
        self.march(&cells, &values)
    }

    /// The cells of the finest level through which the surface may pass.
    fn candidates(&self, slope: f64, field: &(impl Fn(DVec3) -> f64 + Sync)) -> Vec<[u32; 3]> {
        let mut size = (self.cells / 16).max(1).next_power_of_two();
        let along = self.cells.div_ceil(size);
        let mut cells: Vec<[u32; 3]> = (0..along.pow(3))
            .map(|i| [i % along, i / along % along, i / along / along].map(|x| x * size))
            .collect();
        while size > 1 {
            let reach = slope * self.step * f64::from(size) * 0.75f64.sqrt();
            let middle = DVec3::splat(self.step * f64::from(size) / 2.0);
            let half = size / 2;
            cells = cells
                .into_par_iter()
                .filter(|&cell| {
                    let value = field(self.point(cell) + middle);
                    let border = cell.iter().any(|&x| x == 0 || x + size >= self.cells);
                    value.is_nan() || value.abs() <= reach || (border && value > 0.0)
                })
                .flat_map_iter(|cell| {
                    (0..8).map(move |c| {
                        let [x, y, z] = corner_of([0; 3], c);
                        [cell[0] + x * half, cell[1] + y * half, cell[2] + z * half]
                    })
                })
                .filter(|cell| cell.iter().all(|&x| x < self.cells))
                .collect();
            size = half;
        }
        cells
    }

    /// The cells among candidates that have corners on both sides, and all others that the surface reaches from
    /// them, with the values at corners.
    fn straddling(
        &self,
        candidates: Vec<[u32; 3]>,
        field: &(impl Fn(DVec3) -> f64 + Sync),
    ) -> (Vec<u64>, Map<f64>) {
        let mut values = Map::<f64>::default();
        let mut seen: Set = candidates.iter().copied().map(key).collect();
        let mut pending = candidates;
        let mut cells = Vec::new();
        while !pending.is_empty() {
            let corners = pending
                .iter()
                .flat_map(|&c| (0..8).map(move |i| corner_of(c, i)));
            let mut missing: Vec<u64> = corners
                .map(key)
                .filter(|corner| !values.contains_key(corner))
                .collect();
            missing.par_sort_unstable();
            missing.dedup();
            let value = |&corner: &u64| {
                let at = place(corner);
                let value = field(self.point(at));
                let border = at.iter().any(|&x| x == 0 || x == self.cells);
                // The least value that is still outside.
                let outside = -1e-3 * self.step;
                let most = self.step * f64::from(self.cells);
                let value = if value.is_nan() { outside } else { value };
                let value = if border { value.min(outside) } else { value };
                value.clamp(-most, most)
            };
            let found: Vec<f64> = missing.par_iter().map(value).collect();
            values.extend(missing.into_iter().zip(found));
            let mut reached = Vec::new();
            for cell in pending {
                let bits = (0..8).fold(0u32, |bits, c| {
                    bits | u32::from(values[&key(corner_of(cell, c))] > 0.0) << c
                });
                if bits == 0 || bits == 255 {
                    continue;
                }
                cells.push(key(cell));
                self.reach(cell, bits, &mut seen, &mut reached);
            }
            pending = reached;
        }
        cells.sort_unstable();
        (cells, values)
    }

    /// Adds the neighbors of a cell behind its sides with corners inside and outside.
    fn reach(&self, cell: [u32; 3], bits: u32, seen: &mut Set, reached: &mut Vec<[u32; 3]>) {
        /// The corners with 0 along each axis.
        const LOW: [u32; 3] = [0b0101_0101, 0b0011_0011, 0b0000_1111];
        for (axis, &low) in LOW.iter().enumerate() {
            for (side, up) in [(low, false), (!low & 255, true)] {
                if bits & side == 0 || bits & side == side {
                    continue;
                }
                let mut next = cell;
                next[axis] = match up {
                    true => cell[axis] + 1,
                    false => cell[axis].wrapping_sub(1),
                };
                if next[axis] < self.cells && seen.insert(key(next)) {
                    reached.push(next);
                }
            }
        }
    }

    /// Makes the surface in all cells.
    fn march(&self, cells: &[u64], values: &Map<f64>) -> TriangleMesh {
        let value = |at: [u32; 3]| values[&key(at)];
        let cells = cells.iter().map(|&cell| place(cell));
        let surface = Crossings::new(cells, |at| value(at) > 0.0);
        let vertex = |&[start, end]: &[[u32; 3]; 2]| {
            let (a, b) = (value(start), value(end));
            let part = (a / (a - b)).clamp(LEAST_PART, 1.0 - LEAST_PART);
            self.point(start).lerp(self.point(end), part).to_array()
        };
        TriangleMesh {
            positions: surface.edges.iter().map(vertex).collect(),
            faces: surface.faces,
        }
    }
}

/// The part of an edge between its ends and a vertex on it, so that no face loses its area.
pub(crate) const LEAST_PART: f64 = 0.02;

/// A surface between the corners of a lattice that are inside and those that are not, by marching tetrahedra. Its front shows
/// the corners that are not inside.
#[derive(Default)]
pub(crate) struct Crossings {
    /// The ends of the lattice's edge on which each vertex lies. One of them is inside.
    pub edges: Vec<[[u32; 3]; 2]>,
    pub faces: Vec<[u32; 3]>,
}

impl Crossings {
    /// Makes the faces in all cells.
    pub fn new(cells: impl Iterator<Item = [u32; 3]>, inside: impl Fn([u32; 3]) -> bool) -> Self {
        let mut surface = Self::default();
        let mut vertices = Map::<u32>::default();
        for cell in cells {
            let within: [bool; 8] = std::array::from_fn(|c| inside(corner_of(cell, c as u32)));
            let edges = &mut surface.edges;
            let mut vertex = |[p, q]: [u32; 2]| {
                let (low, high) = (p & q, p | q);
                let start = corner_of(cell, low);
                // The direction of the edge fits below the place: edges start at even numbers of a finer lattice.
                let [x, y, z] = corner_of([0; 3], high ^ low);
                let name = key([2 * start[0] + x, 2 * start[1] + y, 2 * start[2] + z]);
                *vertices.entry(name).or_insert_with(|| {
                    edges.push([start, corner_of(cell, high)]);
                    edges.len() as u32 - 1
                })
            };
            for (corners, positive) in TETRAHEDRA {
                let polygon = outline(corners, positive, |c| within[c as usize]);
                let Some((points, count)) = polygon else {
                    continue;
                };
                let [a, b, c] = [points[0], points[1], points[2]].map(&mut vertex);
                surface.faces.push([a, b, c]);
                if count == 4 {
                    let d = vertex(points[3]);
                    surface.faces.push([a, c, d]);
                }
            }
        }
        surface
    }
}

/// The edges at which the surface passes through a tetrahedron, in order around its front, and their number.
fn outline(
    corners: [u32; 4],
    mut positive: bool,
    inside: impl Fn(u32) -> bool,
) -> Option<([[u32; 2]; 4], usize)> {
    // Corners inside come first; each exchange turns the order.
    let mut sorted = corners;
    let mut count = 0;
    for i in 0..4 {
        if inside(sorted[i]) {
            if i != count {
                sorted.swap(i, count);
                positive = !positive;
            }
            count += 1;
        }
    }
    let [a, b, c, d] = sorted;
    let mut points = match count {
        1 => [[a, b], [a, c], [a, d], [a, d]],
        2 => [[a, c], [a, d], [b, d], [b, c]],
        3 => [[a, d], [b, d], [c, d], [c, d]],
        _ => return None,
    };
    let length = if count == 2 { 4 } else { 3 };
    if !positive {
        points[..length].reverse();
    }
    Some((points, length))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn balls_and_tori_have_their_shape() {
        let lattice = Lattice {
            corner: DVec3::splat(-1.5),
            step: 3.0 / 50.0,
            cells: 50,
        };
        let ball = lattice.surface(1.0, |p| 1.0 - p.length());
        let found = ball.statistics().expect("a mesh");
        assert!(found.is_solid() && found.genus == Some(0) && found.crossings == 0);
        let volume = 4.0 / 3.0 * std::f64::consts::PI;
        assert!((found.volume / volume - 1.0).abs() < 2e-3, "{found:?}");
        let torus = lattice.surface(1.0, |p| 0.3 - (p.truncate().length() - 1.0).hypot(p.z));
        let found = torus.statistics().expect("a mesh");
        assert!(found.is_solid() && found.genus == Some(1) && found.components == 1);
    }

    #[test]
    fn bodies_are_closed_at_the_border() {
        let lattice = Lattice {
            corner: DVec3::splat(-1.0),
            step: 0.1,
            cells: 20,
        };
        for field in [|_: DVec3| 1.0, |p: DVec3| p.x, |_: DVec3| f64::INFINITY] {
            let found = lattice.surface(1.0, field).statistics().expect("a mesh");
            assert!(found.is_solid() && found.volume > 3.0, "{found:?}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        /// Noise without any smoothness gives a closed manifold mesh without crossings too.
        #[test]
        fn noise_gives_manifold_meshes(seed: u64, share in 0.1..0.9f64) {
            let lattice = Lattice { corner: DVec3::ZERO, step: 1.0, cells: 8 };
            let noise = |p: DVec3| {
                let mut mix = Mix(seed);
                p.to_array().iter().for_each(|x| mix.write_u64((x * 2.0) as u64 + 1));
                (mix.finish() >> 11) as f64 / (1u64 << 53) as f64 - share
            };
            let mesh = lattice.surface(1e9, noise);
            let found = mesh.statistics().expect("a mesh");
            prop_assert!(found.is_solid() && found.crossings == 0, "{:?}", found);
        }
    }
}
