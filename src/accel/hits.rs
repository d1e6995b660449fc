//! Hard hits of rays: the nearest triangle, or whether there is any.
//!
//! Triangles are intersected in f32, eight at a time, each grown by what coordinates are rounded by: so no ray
//! slips through a seam, and outlines are off by no more than rounding.

use glam::Vec3;

use super::simd::{F8, LANES, Lanes, Machine};
use super::wide::{Leaf, ROUNDING};
use super::wide::{Node, Wide, safe_inverse};

/// No triangle.
pub(crate) const NOTHING: u32 = u32::MAX;

/// A ray that looks for triangles: a segment of it, and up to four triangles that it does not see.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HitRay {
    pub origin: Vec3,
    pub direction: Vec3,
    /// Time in the shutter.
    pub time: f32,
    /// Hits count if they are farther than `from` and nearer than `limit`.
    pub from: f32,
    pub limit: f32,
    pub unseen: [u32; 4],
}

impl HitRay {
    /// From its origin to a limit, seeing all triangles.
    #[inline(always)]
    pub fn new(origin: Vec3, direction: Vec3, time: f32, limit: f32) -> Self {
        Self {
            origin,
            direction,
            time,
            from: 0.0,
            limit,
            unseen: [NOTHING; 4],
        }
    }
}

/// A hit of a ray: a distance, and a triangle or [`NOTHING`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hit {
    pub t: f32,
    pub triangle: u32,
}

/// The size of coordinates: scenes are measured in a unit near their size.
const SIZE: f32 = 1.0;

/// The numbers of lanes.
const LANE: Lanes = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];

/// A ray, each of its numbers eight times.
#[derive(Clone, Copy)]
struct Ray8<M: Machine> {
    origin: [F8<M>; 3],
    direction: [F8<M>; 3],
    from: F8<M>,
    /// Less than 0: how far outside of a triangle a hit may lie.
    margin: F8<M>,
}

impl<M: Machine> Ray8<M> {
    #[inline(always)]
    fn new(machine: M, ray: &HitRay, margin: f32) -> Self {
        let splat = |x| F8::splat(machine, x);
        Self {
            origin: ray.origin.to_array().map(splat),
            direction: ray.direction.to_array().map(splat),
            from: splat(ray.from),
            margin: splat(-margin),
        }
    }
}

impl Leaf {
    /// Distances at which a ray hits the triangles before a limit, the limit where it does not.
    #[inline(always)]
    fn distances<M: Machine, const SELECT: bool>(
        &self,
        machine: M,
        velocity: Option<&[Lanes; 3]>,
        of_ray: (&HitRay, &Ray8<M>),
        limit: F8<M>,
    ) -> F8<M> {
        let (ray, ray8) = of_ray;
        let load = |lanes: &Lanes| F8::load(machine, lanes);
        let mut o = ray8.origin;
        if let Some(velocity) = velocity {
            let time = F8::splat(machine, -ray.time);
            for (o, v) in o.iter_mut().zip(velocity) {
                *o = load(v).mul_add(time, *o);
            }
        }
        let d = ray8.direction;
        let dot = |n: &[Lanes; 3], v: &[F8<M>; 3], last: F8<M>| {
            let [x, y, z] = n;
            load(x).mul_add(v[0], load(y).mul_add(v[1], load(z).mul_add(v[2], last)))
        };
        let zero = F8::splat(machine, 0.0);
        let cosine = dot(&self.normal, &d, zero);
        let above = load(&self.plane) - dot(&self.normal, &o, zero);
        let t = above.div(cosine);
        let p = [
            t.mul_add(d[0], o[0]),
            t.mul_add(d[1], o[1]),
            t.mul_add(d[2], o[2]),
        ];
        let [ab, bc, ca] = &self.lines;
        let [a, b, c] = &self.offsets;
        let least = dot(ab, &p, load(a)).min(dot(bc, &p, load(b)).min(dot(ca, &p, load(c))));
        // Not a number counts as no hit: all comparisons with it are false.
        let hit = (ray8.margin - load(&self.slack)).less(least);
        let mut hit = hit.and(ray8.from.less(t)).and(t.less(limit));
        if SELECT {
            let mut seen = [1.0; LANES];
            for (seen, k) in seen.iter_mut().zip(&self.triangle) {
                *seen = if ray.unseen.contains(k) { 0.0 } else { 1.0 };
            }
            hit = hit.and(zero.less(load(&seen)));
        }
        hit.select(t, limit)
    }
}

/// A ray as boxes are intersected with it, each number eight times.
struct Boxes8<M: Machine> {
    /// The ray's origin, moved by the margin so that boxes grow by it on both sides.
    low: [F8<M>; 3],
    high: [F8<M>; 3],
    inverse: [F8<M>; 3],
    from: F8<M>,
}

impl<M: Machine> Boxes8<M> {
    #[inline(always)]
    fn new(machine: M, ray: &HitRay, margin: f32) -> Self {
        let splat = |x| F8::splat(machine, x);
        Self {
            low: ray.origin.to_array().map(|o| splat(o + margin)),
            high: ray.origin.to_array().map(|o| splat(o - margin)),
            inverse: ray
                .direction
                .to_array()
                .map(|d| splat(safe_inverse(d.into()))),
            from: splat(ray.from),
        }
    }

    /// The children that the ray enters before a limit, one bit each, and where.
    #[inline(always)]
    fn enter(&self, machine: M, node: &Node, limit: f32) -> (u32, F8<M>) {
        let (mut near, mut far) = (self.from, F8::splat(machine, limit));
        for axis in 0..3 {
            let t0 = (F8::load(machine, &node.min[axis]) - self.low[axis]) * self.inverse[axis];
            let t1 = (F8::load(machine, &node.max[axis]) - self.high[axis]) * self.inverse[axis];
            near = near.max(t0.min(t1));
            far = far.min(t0.max(t1));
        }
        let missed = far.less(near).bits();
        (!missed & ((1 << node.count) - 1), near)
    }
}

impl Wide {
    /// The nearest triangle that a ray hits; with `ANY` any, which takes less time. `SELECT` leaves out
    /// the ray's unseen triangles.
    #[inline(always)]
    pub fn hit<M: Machine, const ANY: bool, const SELECT: bool>(
        &self,
        machine: M,
        ray: &HitRay,
    ) -> Hit {
        // A distant origin would round by more than triangles are large: begin where the ray is nearest
        // to the origin of coordinates.
        let along = -ray.origin.dot(ray.direction);
        let size = 16.0 * SIZE;
        let far = along * along > size * size;
        let skipped = if far { along } else { 0.0 };
        let near = HitRay {
            origin: ray.origin + ray.direction * skipped,
            from: ray.from - skipped,
            // Not infinite, so that differences are numbers.
            limit: (ray.limit - skipped).min(f32::MAX),
            ..*ray
        };
        let margin = ROUNDING * (SIZE + near.origin.abs().max_element());
        let mut hit = if !self.nodes.is_empty() {
            self.hit_by_boxes::<M, ANY, SELECT>(machine, &near, margin)
        } else if self.velocities.is_none() {
            self.hit_of_few::<M, SELECT, false>(machine, &near, margin)
        } else {
            self.hit_of_few::<M, SELECT, true>(machine, &near, margin)
        };
        hit.t += skipped;
        hit
    }

    /// All triangles, the nearest of each lane first.
    #[inline(always)]
    fn hit_of_few<M: Machine, const SELECT: bool, const MOVES: bool>(
        &self,
        machine: M,
        ray: &HitRay,
        margin: f32,
    ) -> Hit {
        let ray8 = Ray8::new(machine, ray, margin);
        // Numbers of triangles as floats, so that they are chosen by the same masks as distances.
        let mut best = F8::splat(machine, ray.limit);
        let mut which = F8::splat(machine, -1.0);
        let mut number = F8::load(machine, &LANE);
        let step = F8::splat(machine, LANES as f32);
        for (slot, leaf) in self.leaves.iter().enumerate() {
            let velocity = match &self.velocities {
                Some(velocities) if MOVES => Some(&velocities[slot]),
                _ => None,
            };
            let found = leaf.distances::<M, SELECT>(machine, velocity, (ray, &ray8), best);
            which = found.less(best).select(number, which);
            best = found;
            number = number + step;
        }
        let t = best.least();
        let others = F8::splat(machine, t).less(best).bits();
        let lane = (!others).trailing_zeros() as usize % LANES;
        let triangle = which.lanes()[lane];
        Hit {
            t,
            triangle: if triangle < 0.0 {
                NOTHING
            } else {
                triangle as u32
            },
        }
    }

    #[inline(always)]
    fn hit_by_boxes<M: Machine, const ANY: bool, const SELECT: bool>(
        &self,
        machine: M,
        ray: &HitRay,
        margin: f32,
    ) -> Hit {
        let ray8 = Ray8::new(machine, ray, margin);
        let boxes = Boxes8::new(machine, ray, margin);
        let mut hit = Hit {
            t: ray.limit,
            triangle: NOTHING,
        };
        let mut stack = [(0u32, 0f32); 64];
        let mut spilled: Vec<(u32, f32)> = Vec::new();
        let mut len = 1;
        stack[0] = (0, f32::NEG_INFINITY);
        loop {
            let (index, near) = if len > 0 {
                len -= 1;
                stack[len]
            } else if let Some(top) = spilled.pop() {
                top
            } else {
                break;
            };
            if near > hit.t {
                continue;
            }
            let at = index as usize / 2;
            if index % 2 == 1 {
                let leaf = &self.leaves[at];
                let velocity = self.velocities.as_ref().map(|v| &v[at]);
                let limit = F8::splat(machine, hit.t);
                let found = leaf.distances::<M, SELECT>(machine, velocity, (ray, &ray8), limit);
                let mut mask = found.less(limit).bits();
                let found = found.lanes();
                while mask != 0 {
                    let i = mask.trailing_zeros() as usize % LANES;
                    mask &= mask - 1;
                    if found[i] < hit.t {
                        hit.t = found[i];
                        hit.triangle = leaf.triangle[i];
                    }
                }
                if ANY && hit.triangle != NOTHING {
                    return hit;
                }
                continue;
            }
            let node = &self.nodes[at];
            let (mask, nears) = boxes.enter(machine, node, hit.t);
            if mask == 0 {
                continue;
            }
            let nears = nears.lanes();
            if len + LANES > stack.len() {
                // Deep trees go on in memory; what was on the stack is taken later.
                spilled.extend_from_slice(&stack[..len]);
                len = 0;
            }
            node.stack_children(mask, &nears, &mut stack, &mut len);
        }
        hit
    }
}
