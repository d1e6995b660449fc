//! Hard hits of rays: the nearest triangle, or whether there is any.
//!
//! Triangles are intersected in f32, eight at a time, each grown by what coordinates are rounded by: so no ray
//! slips through a seam, and outlines are off by no more than rounding.

use glam::Vec3;
use pulp::Arch;

use super::HostTriangle;
use super::hierarchy::Hierarchy;
use super::simd::{F8, LANES, Lanes, Machine, Task, dispatch};
use super::wide::{Grown, Leaf, Planes8, ROUNDING, Ray8, Visitor, Wide};
use crate::cube::*;
use crate::model::texture::Masks;
use crate::model::v3;
use crate::scene::Holes;

/// No triangle.
pub(crate) const NOTHING: u32 = u32::MAX;

/// A ray that looks for triangles: a segment of it, and up to four triangles that it does not see.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HitRay {
    pub origin: Vec3,
    pub direction: Vec3,
    pub time: f32,
    /// Hits count if they are farther than `from` and nearer than `limit`.
    pub from: f32,
    pub limit: f32,
    pub unseen: [u32; 4],
}

impl HitRay {
    #[inline(always)]
    fn eight<M: Machine>(&self, machine: M) -> Ray8<M> {
        Ray8::new(machine, self.origin, self.direction, self.time, self.from)
    }

    /// From its origin to a limit, seeing all triangles.
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

/// A hit of a ray: a distance, and a triangle or [`NOTHING`].
#[apply(record!)]
pub(crate) struct Hit {
    pub t: f32,
    pub triangle: u32,
}

impl Hit {
    const NONE: Self = Self {
        t: f32::INFINITY,
        triangle: NOTHING,
    };
}

/// The size of coordinates: scenes are measured in a unit near their size.
const SIZE: f32 = 1.0;

/// The numbers of lanes.
const LANE: Lanes = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];

impl Leaf {
    /// Distances at which a ray hits the triangles before a limit; the limit where it does not. Triangles grow by
    /// a margin, less than which is `below`.
    #[inline(always)]
    fn distances<M: Machine, const SELECT: bool>(
        &self,
        machine: M,
        velocity: Option<&[Lanes; 3]>,
        (ray, ray8, below): (&HitRay, &Ray8<M>, F8<M>),
        limit: F8<M>,
    ) -> F8<M> {
        let Planes8 { t, least, .. } = self.planes(machine, velocity, ray8);
        // Not a number counts as no hit: all comparisons with it are false.
        let outside = below - F8::load(machine, &self.slack);
        let mut hit = outside
            .less(least)
            .and(ray8.from.less(t))
            .and(t.less(limit));
        if SELECT {
            let mut seen = [1.0; LANES];
            for (seen, k) in seen.iter_mut().zip(&self.triangle) {
                *seen = if ray.unseen.contains(k) { 0.0 } else { 1.0 };
            }
            hit = hit.and(F8::splat(machine, 0.0).less(F8::load(machine, &seen)));
        }
        hit.select(t, limit)
    }
}

/// Holes of triangles, which rays pass.
#[derive(Clone, Copy)]
pub(crate) struct Pierced<'a> {
    masks: Masks<'a>,
    triangles: &'a [HostTriangle],
}

impl Pierced<'_> {
    /// Whether a ray passes a triangle that it meets at a distance.
    #[inline(always)]
    fn passes(&self, ray: &HitRay, t: f32, k: u32) -> bool {
        let place = self.masks.masked[k as usize];
        if place == NOTHING {
            return false;
        }
        let triangle = &self.triangles[k as usize];
        let point = (ray.origin + ray.direction * t).as_dvec3();
        let at_rest = point - triangle.velocity * f64::from(ray.time);
        let [x, y, z] = triangle.weights(at_rest).map(|w| w as f32);
        self.masks.open_at(place, v3(x, y, z))
    }
}

impl Wide {
    /// The nearest triangle that a ray hits; with `ANY` any, which takes less time. `SELECT` leaves out
    /// the ray's unseen triangles, `HOLES` holes.
    #[inline(always)]
    fn hit<M: Machine, const ANY: bool, const SELECT: bool, const HOLES: bool>(
        &self,
        machine: M,
        ray: &HitRay,
        pierced: Option<Pierced>,
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
        let mut hit = if HOLES || !self.nodes.is_empty() {
            self.hit_by_boxes::<M, ANY, SELECT, HOLES>(machine, &near, margin, pierced)
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
        let ray8 = ray.eight(machine);
        let below = F8::splat(machine, -margin);
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
            let found = leaf.distances::<M, SELECT>(machine, velocity, (ray, &ray8, below), best);
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
    fn hit_by_boxes<M: Machine, const ANY: bool, const SELECT: bool, const HOLES: bool>(
        &self,
        machine: M,
        ray: &HitRay,
        margin: f32,
        pierced: Option<Pierced>,
    ) -> Hit {
        let ray8 = ray.eight(machine);
        let mut nearest = Nearest::<M, ANY, SELECT, HOLES> {
            wide: self,
            machine,
            ray,
            ray8: &ray8,
            grown: ray8.grown(machine, margin),
            below: F8::splat(machine, -margin),
            hit: Hit {
                t: ray.limit,
                triangle: NOTHING,
            },
            pierced,
        };
        if HOLES && self.nodes.is_empty() {
            let _ = (0..self.leaves.len()).all(|leaf| nearest.leaf(leaf));
        } else {
            self.traverse(machine, &ray8, &mut nearest);
        }
        nearest.hit
    }
}

/// The nearest hit so far, while a ray goes through the tree.
struct Nearest<'a, M: Machine, const ANY: bool, const SELECT: bool, const HOLES: bool> {
    wide: &'a Wide,
    machine: M,
    ray: &'a HitRay,
    ray8: &'a Ray8<M>,
    grown: Grown<M>,
    /// Less than 0: how far outside of a triangle a hit may lie.
    below: F8<M>,
    hit: Hit,
    pierced: Option<Pierced<'a>>,
}

impl<M: Machine, const ANY: bool, const SELECT: bool, const HOLES: bool> Visitor<M>
    for Nearest<'_, M, ANY, SELECT, HOLES>
{
    #[inline(always)]
    fn limit(&self) -> f32 {
        self.hit.t
    }

    #[inline(always)]
    fn grown(&self, _near: f32) -> Grown<M> {
        self.grown
    }

    #[inline(always)]
    fn leaf(&mut self, index: usize) -> bool {
        let (leaf, hit) = (&self.wide.leaves[index], &mut self.hit);
        let velocity = self.wide.velocity(index);
        let limit = F8::splat(self.machine, hit.t);
        let of_ray = (self.ray, self.ray8, self.below);
        let found = leaf.distances::<M, SELECT>(self.machine, velocity, of_ray, limit);
        let mut mask = found.less(limit).bits();
        let found = found.lanes();
        while mask != 0 {
            let i = mask.trailing_zeros() as usize % LANES;
            mask &= mask - 1;
            if HOLES
                && let Some(pierced) = &self.pierced
                && pierced.passes(self.ray, found[i], leaf.triangle[i])
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

impl Hierarchy {
    /// The hit of each ray: the nearest triangle, or with `ANY` any, which takes less time. `SELECT` leaves out the ray's
    /// unseen triangles. Scenes without holes have a traversal of their own.
    #[inline(always)]
    pub(crate) fn hits<const ANY: bool, const SELECT: bool>(
        &self,
        arch: Arch,
        holes: Option<&Holes>,
        rays: &[HitRay],
        hits: &mut Vec<Hit>,
    ) {
        hits.clear();
        hits.resize(rays.len(), Hit::NONE);
        let (wide, triangles) = (&self.wide, self.triangles.as_slice());
        let pierced = holes.map(|holes| Pierced {
            masks: holes.masks(),
            triangles,
        });
        if pierced.is_some() {
            let task = Hits::<ANY, SELECT, true> {
                wide,
                rays,
                hits,
                pierced,
            };
            dispatch(arch, task);
        } else {
            let task = Hits::<ANY, SELECT, false> {
                wide,
                rays,
                hits,
                pierced,
            };
            dispatch(arch, task);
        }
    }
}

/// [`Hierarchy::hits`] as a task.
struct Hits<'a, const ANY: bool, const SELECT: bool, const HOLES: bool> {
    wide: &'a Wide,
    rays: &'a [HitRay],
    hits: &'a mut [Hit],
    pierced: Option<Pierced<'a>>,
}

impl<const ANY: bool, const SELECT: bool, const HOLES: bool> Task for Hits<'_, ANY, SELECT, HOLES> {
    type Output = ();

    #[inline(always)]
    fn run<M: Machine>(self, machine: M) {
        for (ray, hit) in self.rays.iter().zip(self.hits) {
            *hit = (self.wide).hit::<M, ANY, SELECT, HOLES>(machine, ray, self.pierced);
        }
    }
}
