//! Direct light: connections of surface points to emitters, delta lights and directions of a map.

use super::view::Tracer;
use super::walk::{Candidate, LightSample, Work};
use crate::accel::HitRay;
use crate::model::connection::{ConeKernel, Target};
use crate::model::triangle::uniform_point;
use crate::model::{V2, V3, v2};
use crate::trace::{
    Arrived, NONE, Point, density_of_map, map_of, radiance_of, receiver_of, sky, target_of,
};

/// A point of a path that is connected to lights.
pub(super) struct Shaded<'a> {
    pub walk: u32,
    pub time: f32,
    pub point: &'a Point,
    pub cone: ConeKernel,
}

impl Shaded<'_> {
    /// Light that arrives from a target if nothing is in between. It was drawn with a probability or density, or found
    /// by scattering; its radiance is looked up where it counts. The emitter and the weights are what is kept of it.
    #[inline(always)]
    fn connect(
        &self,
        target: &Target,
        (chance, by_scattering): (f32, bool),
        (emitter, weights): (u32, V2),
        radiance: impl FnOnce() -> V3,
        work: &mut Work,
    ) {
        let (shading, position) = (&self.point.shading, self.point.position);
        let found = target.connect(shading, position, chance, by_scattering, self.cone);
        // It starts behind the light, or there is none.
        if found.limit <= 0.0 {
            return;
        }
        let ray = HitRay::new(found.start, found.direction, self.time, found.limit);
        work.rays.push(ray);
        work.candidates.push(Candidate {
            walk: self.walk,
            light: found.reflected * radiance() * found.scale,
            sample: LightSample {
                emitter,
                weights,
                direction: target.direction,
                arrived: Arrived {
                    reflected: found.reflected,
                    density: found.density,
                },
            },
        });
    }
}

impl Tracer<'_> {
    /// Light from one point of one emitter, and from those that lie along another direction.
    #[inline(always)]
    pub(super) fn direct_from_emitters(
        &self,
        from: &Shaded,
        [u, v]: [f32; 2],
        along: Option<V3>,
        work: &mut Work,
    ) {
        let emitters = &self.emitters;
        let at = receiver_of(from.point, from.time);
        let mut room = std::mem::take(&mut work.room);
        let share = emitters.look(&at, &mut room);
        let choice = emitters.choose(u, &at, share, &mut room);
        let place = (choice.emitter, uniform_point(choice.rest, v), choice.chance);
        self.connect(from, place, along.map(|_| false), work);
        if let Some(direction) = along {
            let mut hits = std::mem::take(&mut work.emitter_hits);
            hits.clear();
            let all = &self.scene.emitters;
            all.each_hit_of_all(&at, direction, &mut work.met, |hit| hits.push(hit));
            for hit in &hits {
                let chance = emitters.chance(hit.emitter, &at, share, &mut room);
                let place = (hit.emitter, hit.weights, chance);
                self.connect(from, place, Some(true), work);
            }
            work.emitter_hits = hits;
        }
        work.room = room;
    }

    /// Light from a point of an emitter over its density. `combined` says by which of two strategies it
    /// was found, if there are two.
    #[inline(always)]
    fn connect(
        &self,
        from: &Shaded,
        (k, weights, chance): (u32, V2, f32),
        combined: Option<bool>,
        work: &mut Work,
    ) {
        let (x, time) = (from.point.position, from.time);
        let target = target_of(&self.lists, k, weights, x, time, combined.is_some());
        let drawn = (chance, combined == Some(true));
        let radiance = || radiance_of(&self.lists, k, weights, target.facing());
        from.connect(&target, drawn, (k, weights), radiance, work);
    }

    /// Light of a map along a direction drawn from it, and along that in which the path goes on.
    #[inline(never)]
    pub(super) fn direct_from_map(
        &self,
        from: &Shaded,
        [u, v]: [f32; 2],
        along: V3,
        work: &mut Work,
    ) {
        let drawn = map_of(&self.lists).choose(self.lists.sky_density, u, v);
        for (by_scattering, direction) in [(false, drawn), (true, along)] {
            let target = Target::of_map(direction);
            let drawn = (density_of_map(&self.lists, direction), by_scattering);
            let radiance = || sky(&self.lists, direction);
            from.connect(&target, drawn, (NONE, v2(0.0, 0.0)), radiance, work);
        }
    }
}
