//! Computes the nearest triangle that a ray hits.

use super::HostTriangle;
use super::rays::{Hit, HitRay, NOTHING, Rays8};
use super::simd::{F8, LANES, Lanes, Machine};
use super::wide::{Grown, Leaf, Node, Ray8, Visitor, Wide};
use crate::model::texture::Masks;
use crate::model::v3;

/// The index of each lane.
const LANE: Lanes = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];

impl Leaf {
    /// Returns the distances at which a ray hits the triangles before a limit, or the limit for triangles that it does
    /// not hit.
    #[inline(always)]
    fn distances<M: Machine, const SELECT: bool>(
        &self,
        machine: M,
        velocity: Option<&[Lanes; 3]>,
        ray: &NearRay<M>,
        limit: F8<M>,
    ) -> F8<M> {
        let planes = self.planes(machine, velocity, &ray.eight);
        let slack = F8::load(machine, &self.slack);
        let mut hit = planes.hit(ray.below, slack, ray.eight.from, limit);
        if SELECT {
            let mut seen = [1.0; LANES];
            for (seen, k) in seen.iter_mut().zip(&self.triangle) {
                *seen = if ray.of.unseen.contains(k) { 0.0 } else { 1.0 };
            }
            hit = hit.and(F8::splat(machine, 0.0).less(F8::load(machine, &seen)));
        }
        hit.select(planes.t, limit)
    }
}

/// A ray during traversal.
#[derive(Clone, Copy)]
struct NearRay<'a, M: Machine> {
    of: &'a HitRay,
    skipped: f32,
    eight: Ray8<M>,
    limit: f32,
    /// A negative number: how far outside of a triangle a hit may lie.
    below: F8<M>,
    grown: Grown<M>,
}

impl<'a, M: Machine> NearRay<'a, M> {
    /// Returns one of the rays of a block.
    #[inline(always)]
    fn new(machine: M, (all, eights): (&'a [HitRay], &[Rays8]), k: u8) -> Self {
        let (k, of) = (usize::from(k), &all[usize::from(k)]);
        let (rays, i) = (&eights[k / LANES], k % LANES);
        let eight = rays.one(machine, i);
        Self {
            of,
            skipped: rays.skipped[i],
            eight,
            limit: rays.limit[i],
            below: F8::splat(machine, -rays.margin[i]),
            grown: eight.grown(machine, rays.margin[i]),
        }
    }
}

/// Holes of triangles, through which rays pass.
#[derive(Clone, Copy)]
pub(super) struct Pierced<'a> {
    pub masks: Masks<'a>,
    pub triangles: &'a [HostTriangle],
}

impl Pierced<'_> {
    /// Returns whether a ray passes through a hole where it meets a triangle.
    #[inline(always)]
    fn passes<M: Machine>(&self, ray: &NearRay<M>, t: f32, k: u32) -> bool {
        let place = self.masks.masked[k as usize];
        if place == NOTHING {
            return false;
        }
        let triangle = &self.triangles[k as usize];
        let HitRay {
            origin,
            direction,
            time,
            ..
        } = *ray.of;
        let point = (origin + direction * (ray.skipped + t)).as_dvec3();
        let at_rest = point - triangle.velocity * f64::from(time);
        let [x, y, z] = triangle.weights(at_rest).map(|w| w as f32);
        self.masks.open_at(place, v3(x, y, z))
    }
}

impl Wide {
    /// Computes the nearest triangle that each listed ray of a block hits, or with `ANY` any triangle, which takes less
    /// time. With `SELECT`, rays ignore their `unseen` triangles. With `HOLES`, they pass through holes.
    #[inline(always)]
    pub fn hits_alone<M: Machine, const ANY: bool, const SELECT: bool, const HOLES: bool>(
        &self,
        machine: M,
        block: (&[HitRay], &[Rays8]),
        list: &[u8],
        hits: &mut [Hit],
        pierced: Option<Pierced>,
    ) {
        if !HOLES && self.nodes.is_empty() {
            for &k in list {
                let ray = NearRay::new(machine, block, k);
                hits[usize::from(k)] = match self.velocities {
                    None => self.hit_of_few::<M, SELECT, false>(machine, &ray),
                    Some(_) => self.hit_of_few::<M, SELECT, true>(machine, &ray),
                };
            }
            return;
        }
        for &k in list {
            let ray = NearRay::new(machine, block, k);
            let mut nearest = Nearest::<M, ANY, SELECT, HOLES> {
                wide: self,
                machine,
                hit: Hit {
                    t: ray.limit,
                    triangle: NOTHING,
                },
                ray,
                pierced,
            };
            self.traverse(&mut nearest);
            hits[usize::from(k)] = Hit {
                t: nearest.hit.t + ray.skipped,
                ..nearest.hit
            };
        }
    }

    /// Tests all triangles: first for the nearest of each lane, then for the nearest of these.
    #[inline(always)]
    fn hit_of_few<M: Machine, const SELECT: bool, const MOVES: bool>(
        &self,
        machine: M,
        ray: &NearRay<M>,
    ) -> Hit {
        // Indices of triangles are stored as floats, so that the same masks select indices and distances.
        let mut best = F8::splat(machine, ray.limit);
        let mut which = F8::splat(machine, -1.0);
        let mut number = F8::load(machine, &LANE);
        let step = F8::splat(machine, LANES as f32);
        for (slot, leaf) in self.leaves.iter().enumerate() {
            let velocity = match &self.velocities {
                Some(velocities) if MOVES => Some(&velocities[slot]),
                _ => None,
            };
            let found = leaf.distances::<M, SELECT>(machine, velocity, ray, best);
            which = found.less(best).select(number, which);
            best = found;
            number = number + step;
        }
        let t = best.least();
        let others = F8::splat(machine, t).less(best).bits();
        let lane = (!others).trailing_zeros() as usize % LANES;
        let triangle = which.lanes()[lane];
        Hit {
            t: t + ray.skipped,
            triangle: if triangle < 0.0 {
                NOTHING
            } else {
                triangle as u32
            },
        }
    }
}

/// The nearest hit so far, while a ray traverses the tree.
struct Nearest<'a, M: Machine, const ANY: bool, const SELECT: bool, const HOLES: bool> {
    wide: &'a Wide,
    machine: M,
    ray: NearRay<'a, M>,
    hit: Hit,
    pierced: Option<Pierced<'a>>,
}

impl<M: Machine, const ANY: bool, const SELECT: bool, const HOLES: bool> Visitor
    for Nearest<'_, M, ANY, SELECT, HOLES>
{
    #[inline(always)]
    fn limit(&self) -> f32 {
        self.hit.t
    }

    #[inline(always)]
    fn enter(&self, node: &Node, _near: f32) -> (u32, Lanes) {
        (self.ray.eight).enter(self.machine, node, &self.ray.grown, self.hit.t)
    }

    #[inline(always)]
    fn leaf(&mut self, index: usize) -> bool {
        let (leaf, hit) = (&self.wide.leaves[index], &mut self.hit);
        let velocity = self.wide.velocity(index);
        let limit = F8::splat(self.machine, hit.t);
        let found = leaf.distances::<M, SELECT>(self.machine, velocity, &self.ray, limit);
        let mut mask = found.less(limit).bits();
        let found = found.lanes();
        while mask != 0 {
            let i = mask.trailing_zeros() as usize % LANES;
            mask &= mask - 1;
            if HOLES
                && let Some(pierced) = &self.pierced
                && pierced.passes(&self.ray, found[i], leaf.triangle[i])
            {
                continue;
            }
            if found[i] < hit.t {
                hit.t = found[i];
                hit.triangle = leaf.triangle[i];
            }
        }
        !(ANY && hit.triangle != NOTHING)
    }
}
