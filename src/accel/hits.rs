//! Hard hits of rays: the nearest triangle, or whether there is any.
//!
//! Triangles are intersected in f32, eight at a time, each grown by what coordinates are rounded by: so no ray
//! slips through a seam, and outlines are off by no more than rounding.

use glam::Vec3;
use pulp::Arch;

use super::HostTriangle;
use super::hierarchy::Hierarchy;
use super::nearest::NearRay;
use super::rays::Rays8;
use super::shaft::{EIGHTS, Shaft};
use super::simd::{LANES, Lanes, Machine, Task, dispatch};
use super::wide::Wide;
use crate::cube::*;
use crate::model::texture::Masks;
use crate::model::v3;
use crate::scene::Holes;

/// Rays that are made ready at once.
const BLOCK: usize = 64;

/// No triangle.
pub(crate) const NOTHING: u32 = u32::MAX;

/// A ray that looks for triangles: a segment of it, and up to four triangles that it does not see.
#[derive(Clone, Copy, Debug)]
#[repr(C)] // so that the head is read at once
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
    /// Origin, direction, time, and where it begins.
    #[inline(always)]
    pub(super) fn head(&self) -> Lanes {
        let ([x, y, z], [u, v, w]) = (self.origin.to_array(), self.direction.to_array());
        [x, y, z, u, v, w, self.time, self.from]
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

/// Holes of triangles, which rays pass.
#[derive(Clone, Copy)]
pub(crate) struct Pierced<'a> {
    masks: Masks<'a>,
    triangles: &'a [HostTriangle],
}

impl Pierced<'_> {
    /// Whether a ray passes a triangle that it meets at a distance.
    #[inline(always)]
    pub(super) fn passes<M: Machine>(&self, ray: &NearRay<M>, t: f32, k: u32) -> bool {
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
        let (wide, pierced) = (self.wide, self.pierced);
        let mut eights = [Rays8::NONE; BLOCK / LANES];
        for (rays, hits) in self.rays.chunks(BLOCK).zip(self.hits.chunks_mut(BLOCK)) {
            let eights = &mut eights[..rays.len().div_ceil(LANES)];
            for (eight, rays) in eights.iter_mut().zip(rays.chunks(LANES)) {
                eight.fill(machine, rays);
            }
            let (mut alone, mut count) = ([0u8; BLOCK], 0);
            for (k, eights) in eights.chunks_mut(EIGHTS).enumerate() {
                let first = k * EIGHTS * LANES;
                let past = rays.len().min(first + EIGHTS * LANES);
                if !SELECT
                    && !HOLES
                    && past >= first + LANES
                    && let Some(shaft) = Shaft::around(machine, eights, wide.grain)
                {
                    wide.hits_in::<M, ANY>(machine, shaft, eights, &mut hits[first..past]);
                    continue;
                }
                for i in first..past {
                    alone[count] = i as u8;
                    count += 1;
                }
            }
            let list = &alone[..count];
            wide.hits_alone::<M, ANY, SELECT, HOLES>(machine, (rays, eights), list, hits, pierced);
        }
    }
}
