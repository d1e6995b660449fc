//! Rays and their hits, and eight rays at once.

use glam::Vec3;

use super::simd::{F8, LANES, Lanes, Machine, each_of_three};
use super::wide::{ROUNDING, Ray8, inverse};
use crate::cube::*;

/// No triangle.
pub const NOTHING: u32 = u32::MAX;

/// A ray segment to intersect with triangles, and up to four triangles that it ignores.
#[derive(Clone, Copy, Debug)]
#[repr(C)] // so that the head is read at once
pub struct HitRay {
    pub origin: Vec3,
    pub direction: Vec3,
    pub time: f32,
    /// Hits count if they are farther than `from` and nearer than `limit`.
    pub from: f32,
    pub limit: f32,
    pub unseen: [u32; 4],
}

impl HitRay {
    /// Returns origin, direction, time and `from`.
    #[inline(always)]
    fn head(&self) -> Lanes {
        let ([x, y, z], [u, v, w]) = (self.origin.to_array(), self.direction.to_array());
        [x, y, z, u, v, w, self.time, self.from]
    }

    /// Creates a ray from its origin to a limit that sees all triangles.
    #[inline(always)]
    pub fn new(origin: impl Into<Vec3>, direction: impl Into<Vec3>, time: f32, limit: f32) -> Self {
        Self {
            origin: origin.into(),
            direction: direction.into(),
            time,
            from: 0.0,
            limit,
            unseen: [NOTHING; 4],
        }
    }
}

/// The hit of a ray: a distance, and a triangle or [`NOTHING`].
#[apply(record!)]
pub struct Hit {
    pub t: f32,
    pub triangle: u32,
}

impl Hit {
    pub const NONE: Self = Self {
        t: f32::INFINITY,
        triangle: NOTHING,
    };
}

/// The size of coordinates. Scenes are measured in a unit close to their size.
const SIZE: f32 = 1.0;

/// Eight rays, each starting near the scene: for a distant origin, rounding would be larger than triangles.
#[derive(Clone, Copy)]
pub(super) struct Rays8 {
    pub origin: [Lanes; 3],
    pub direction: [Lanes; 3],
    pub inverse: [Lanes; 3],
    pub less_time: Lanes,
    pub from: Lanes,
    pub limit: Lanes,
    /// The distance by which triangles are enlarged.
    pub margin: Lanes,
    /// The distance from the original origin of each ray to this one.
    pub skipped: Lanes,
}

impl Rays8 {
    pub const NONE: Self = Self {
        origin: [[0.0; LANES]; 3],
        direction: [[0.0; LANES]; 3],
        inverse: [[0.0; LANES]; 3],
        less_time: [0.0; LANES],
        from: [0.0; LANES],
        limit: [0.0; LANES],
        margin: [0.0; LANES],
        skipped: [0.0; LANES],
    };

    /// Fills this with up to eight rays. The remaining lanes repeat the first ray and hit nothing.
    #[inline(always)]
    pub fn fill<M: Machine>(&mut self, machine: M, rays: &[HitRay]) {
        let mut rows = [rays[0].head(); LANES];
        self.limit = [f32::MIN; LANES];
        let mut i = 0;
        while i < rays.len() {
            rows[i] = rays[i].head();
            self.limit[i] = rays[i].limit;
            i += 1;
        }
        let [x, y, z, u, v, w, time, from] = machine.transpose(&rows);
        let all = |a| F8::of(machine, a);
        let load = |lanes: &Lanes| F8::load(machine, lanes);
        let splat = |x| F8::splat(machine, x);
        let zero = splat(0.0);
        let [x, y, z] = each_of_three!(|a| all(a), [x, y, z]);
        let [u, v, w] = each_of_three!(|a| all(a), [u, v, w]);
        let along = zero - x.mul_add(u, y.mul_add(v, z * w));
        let far = splat(16.0 * SIZE).less(along.abs());
        let skipped = far.select(along, zero);
        let [x, y, z] = [
            u.mul_add(skipped, x),
            v.mul_add(skipped, y),
            w.mul_add(skipped, z),
        ];
        let size = x.abs().max(y.abs()).max(z.abs()) + splat(SIZE);
        self.origin = [x.lanes(), y.lanes(), z.lanes()];
        self.direction = [u.lanes(), v.lanes(), w.lanes()];
        self.inverse = each_of_three!(|d| inverse(machine, d).lanes(), [u, v, w]);
        self.less_time = (zero - all(time)).lanes();
        self.from = (all(from) - skipped).lanes();
        // Finite, so that differences are not NaN.
        self.limit = (load(&self.limit) - skipped).min(splat(f32::MAX)).lanes();
        self.margin = (size * splat(ROUNDING)).lanes();
        self.skipped = skipped.lanes();
    }

    /// Returns one of the rays, with each of its numbers in all lanes.
    #[inline(always)]
    pub fn one<M: Machine>(&self, machine: M, i: usize) -> Ray8<M> {
        let splat = |lanes: &Lanes| F8::splat(machine, lanes[i]);
        Ray8 {
            origin: each_of_three!(|x| splat(x), &self.origin),
            direction: each_of_three!(|x| splat(x), &self.direction),
            inverse: each_of_three!(|x| splat(x), &self.inverse),
            less_time: splat(&self.less_time),
            from: splat(&self.from),
        }
    }
}
