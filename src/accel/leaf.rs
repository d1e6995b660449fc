//! Eight triangles against one ray in f32.

use glam::Vec3;

use super::simd::{LANES, Lanes, Machine};
use super::triangle::HostTriangle;

/// Up to eight triangles: planes, and in each the lines of the borders as distances, positive inside.
pub(super) struct Leaf {
    pub(super) normal: [Lanes; 3],
    pub(super) plane: Lanes,
    /// a → b, b → c, c → a: directions, and what is added.
    pub(super) lines: [[Lanes; 3]; 3],
    pub(super) offsets: [Lanes; 3],
    pub triangle: [u32; LANES],
    /// The rounding of the lines, beyond that of points.
    pub(super) slack: Lanes,
    /// The triangles that there are, one bit each.
    used: u32,
}

/// Triangles are grown by this share of the largest coordinate near the ray.
pub(super) const ROUNDING: f32 = 4e-7;

/// Hits close to a ray's origin are rounded by this share of [`Ray::rounding`].
const NEAR: f32 = 0.4;

/// A ray in f32, from a point near the triangles.
pub(super) struct Ray {
    pub origin: Vec3,
    pub direction: Vec3,
    pub time: f32,
    /// The largest distance beside it at which triangles matter.
    pub reach: f32,
    /// The distance along it that a squared distance beside it counts as ([`Reach`](super::Reach)).
    pub distance_penalty: f32,
    /// The rounding of coordinates: 33 half units in the last place of the largest.
    pub rounding: f32,
    /// Hits nearer don't count.
    pub from: f32,
}

impl Leaf {
    pub fn new(triangles: &[HostTriangle], list: &[u32]) -> Self {
        let mut leaf = Self {
            normal: [[0.0; LANES]; 3],
            plane: [0.0; LANES],
            lines: [[[0.0; LANES]; 3]; 3],
            offsets: [[0.0; LANES]; 3],
            triangle: [u32::MAX; LANES],
            slack: [0.0; LANES],
            used: (1 << list.len()) - 1,
        };
        for (i, &k) in list.iter().enumerate() {
            let t = &triangles[k as usize];
            leaf.plane[i] = t.normal.dot(t.corners[0]) as f32;
            for (axis, lanes) in leaf.normal.iter_mut().enumerate() {
                lanes[i] = t.normal[axis] as f32;
            }
            for (line, (across, offset)) in t.lines_in_space().into_iter().enumerate() {
                leaf.offsets[line][i] = offset as f32;
                leaf.slack[i] = leaf.slack[i].max(ROUNDING * offset.abs() as f32);
                for (axis, lanes) in leaf.lines[line].iter_mut().enumerate() {
                    lanes[i] = across[axis] as f32;
                }
            }
            leaf.triangle[i] = k;
        }
        leaf
    }

    /// The triangles that a ray may hit before `limit`, one bit each, and distances before which it
    /// doesn't, with what it passes beside them.
    #[inline(always)]
    pub fn test<M: Machine>(
        &self,
        machine: M,
        velocity: Option<&[Lanes; 3]>,
        ray: &Ray,
        limit: f32,
    ) -> (u32, Lanes) {
        let add = |sum: f32, a: f32, b: f32| {
            if M::FUSED {
                a.mul_add(b, sum)
            } else {
                a * b + sum
            }
        };
        // Written out: the compiler does not see through closures over arrays in a loop over lanes.
        macro_rules! inside {
            ($line:literal, $i:ident, $p:ident) => {{
                let [x, y, z] = &self.lines[$line];
                let first = add(self.offsets[$line][$i], x[$i], $p[0]);
                add(add(first, y[$i], $p[1]), z[$i], $p[2])
            }};
        }
        let d = ray.direction.to_array();
        let mut o = ray.origin.to_array().map(|x| [x; LANES]);
        if let Some(velocity) = velocity {
            for (o, v) in o.iter_mut().zip(velocity) {
                for i in 0..LANES {
                    o[i] -= v[i] * ray.time;
                }
            }
        }
        let mut room = [0.0; LANES];
        let mut near = [0.0; LANES];
        for i in 0..LANES {
            let n = [self.normal[0][i], self.normal[1][i], self.normal[2][i]];
            let cosine = add(add(n[0] * d[0], n[1], d[1]), n[2], d[2]);
            let inverse = 1.0 / cosine;
            let above = add(self.plane[i], -n[0], o[0][i]);
            let t = add(add(above, -n[1], o[1][i]), -n[2], o[2][i]) * inverse;
            let p = [
                add(o[0][i], t, d[0]),
                add(o[1][i], t, d[1]),
                add(o[2][i], t, d[2]),
            ];
            let ab = inside!(0, i, p);
            let bc = inside!(1, i, p);
            let ca = inside!(2, i, p);
            let least = smaller(ab, smaller(bc, ca));
            let rounding = add(ray.rounding, ray.rounding, inverse.abs());
            let beside = smaller(least + rounding, 0.0);
            let counted = add(t - rounding, beside * ray.distance_penalty, beside);
            // Not a number is kept, and first: the exact test decides.
            near[i] = larger(counted, f32::MIN);
            let between = smaller(add(t, NEAR, rounding) - ray.from, limit - near[i]);
            room[i] = smaller(between, beside + ray.reach);
        }
        let mask = machine.not_negative(&room) & self.used;
        (mask, near)
    }
}

#[inline(always)]
pub(super) fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
pub(super) fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}
