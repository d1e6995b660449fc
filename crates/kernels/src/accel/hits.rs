//! Hits of rays: the nearest triangle, or whether a ray hits any.
//!
//! Triangles are intersected in f32, eight at a time. Each is enlarged by the rounding of coordinates, so that no ray
//! passes through a seam and outlines are off by no more than rounding.

use pulp::Arch;

use super::hierarchy::Hierarchy;
use super::nearest::Pierced;
use super::rays::{Hit, HitRay, Rays8};
use super::shaft::{EIGHTS, Shaft};
use super::simd::{LANES, Machine, Task, dispatch};
use super::wide::Wide;
use crate::host::Holes;

/// The number of rays that are prepared at once.
const BLOCK: usize = 64;

impl Hierarchy {
    /// Computes the hit of each ray: the nearest triangle, or with `ANY` any triangle, which takes less time. With
    /// `SELECT`, rays ignore their `unseen` triangles. Scenes without holes have a traversal of their own.
    #[inline(always)]
    pub fn hits<const ANY: bool, const SELECT: bool>(
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
