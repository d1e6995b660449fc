//! Direct light: connections of surface points to points of emitters and to directions of a map.

use super::surface::Point;
use super::view::View;
use super::walk::{Candidate, LightSample, Sample, SkySample, Work};
use crate::accel::HitRay;
use crate::model::V3;
use crate::model::connection::{ConeKernel, Connection, Target};
use crate::model::emitter::LightPoint;
use crate::model::sky::SkyMap;
use crate::model::triangle::{at, uniform_point};

/// A point of a path that is connected to lights.
pub(super) struct Shaded<'a> {
    pub walk: u32,
    pub time: f32,
    pub point: &'a Point,
}

impl Shaded<'_> {
    /// Light that arrives from a target if nothing is in between. It was drawn with a probability or density, or found
    /// by scattering; its radiance is looked up where it counts, and `sample` is what is kept of it.
    #[inline(always)]
    pub(super) fn connect(
        &self,
        target: &Target,
        (chance, by_scattering): (f32, bool),
        cone: ConeKernel,
        radiance: impl FnOnce() -> V3,
        sample: impl FnOnce(&Connection) -> Sample,
        work: &mut Work,
    ) {
        let (shading, position) = (&self.point.shading, self.point.position);
        let found = target.connect(shading, position, chance, by_scattering, cone);
        // It starts behind the light, or there is none.
        if found.limit <= 0.0 {
            return;
        }
        let ray = HitRay::new(found.start, found.direction, self.time, found.limit);
        work.rays.push(ray);
        work.candidates.push(Candidate {
            walk: self.walk,
            light: found.reflected * radiance() * found.scale,
            sample: sample(&found),
        });
    }
}

impl View {
    /// Light from one point of one emitter, and from those that lie along another direction.
    #[inline(always)]
    pub(super) fn direct_from_emitters(
        &self,
        from: &Shaded,
        [u, v]: [f32; 2],
        cone: ConeKernel,
        along: Option<V3>,
        work: &mut Work,
    ) {
        let emitters = &self.scene.emitters;
        let at = from.point.receiver(from.time);
        let (k, chance, u) = emitters.choose(&at, u, &mut work.chances);
        if let Some(light) = emitters.light(k) {
            self.connect_delta(from, (light, chance), cone, work);
        } else {
            let on = uniform_point(u, v);
            let place = (k, [on.x, on.y], chance);
            self.connect(from, place, along.map(|_| false), cone, work);
        }
        if let Some(direction) = along {
            let mut hits = std::mem::take(&mut work.emitter_hits);
            hits.clear();
            emitters.each_hit_of_all(&at, direction, &mut work.met, |hit| hits.push(hit));
            for hit in &hits {
                let k = hit.emitter;
                let chance = emitters.chance(&at, k, &mut work.chances);
                self.connect(from, (k, hit.weights, chance), Some(true), cone, work);
            }
            work.emitter_hits = hits;
        }
    }

    /// Light from a point of an emitter over its density. `combined` says by which of two strategies it
    /// was found, if there are two.
    #[inline(always)]
    fn connect(
        &self,
        from: &Shaded,
        (emitter, [b, c], chance): (usize, [f32; 2], f32),
        combined: Option<bool>,
        cone: ConeKernel,
        work: &mut Work,
    ) {
        let e = self.scene.emitters.get(emitter);
        let weights = [1.0 - b - c, b, c];
        let place = at(e.corners, weights) + e.velocity * from.time;
        let seen = LightPoint::new(place - from.point.position, e.normal);
        if seen.facing <= 0.0 || self.scene.is_open(e.triangle, weights) {
            return;
        }
        let area = self.scene.triangles[e.triangle as usize].area;
        let target = Target {
            combined: combined.is_some(),
            ..Target::of_emitter(&seen, place, e.normal, area)
        };
        let radiance = || {
            let emission = self.scene.emission(e.triangle as usize, weights);
            emission.towards(seen.facing)
        };
        let sample = |found: &Connection| {
            Sample::Light(LightSample {
                triangle: e.triangle,
                weights,
                seen,
                reflected: found.reflected,
                density: found.density,
            })
        };
        let drawn = (chance, combined == Some(true));
        from.connect(&target, drawn, cone, radiance, sample, work);
    }

    /// Light of a map along a direction drawn from it, and along that in which the path goes on.
    #[inline(never)]
    pub(super) fn direct_from_map(
        &self,
        from: &Shaded,
        map: &SkyMap,
        [u, v]: [f32; 2],
        cone: ConeKernel,
        along: V3,
        work: &mut Work,
    ) {
        let (drawn, chance) = map.drawn.choose(u, v);
        for (by_scattering, direction, chance) in [
            (false, drawn, chance),
            (true, along, map.drawn.density(along)),
        ] {
            let target = Target::of_map(direction);
            let radiance = || map.at(direction);
            let sample = |found: &Connection| {
                Sample::Sky(SkySample {
                    direction,
                    reflected: found.reflected,
                    density: found.density,
                })
            };
            let drawn = (chance, by_scattering);
            from.connect(&target, drawn, cone, radiance, sample, work);
        }
    }
}
