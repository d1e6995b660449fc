//! Direct light: connections of surface points to points of emitters and to directions of a map.

use super::surface::Point;
use super::view::View;
use super::walk::{Candidate, LightSample, Sample, SkySample, Work};
use crate::accel::HitRay;
use crate::model::V3;
use crate::model::cone::{lifted, up_to_plane};
use crate::model::emitter::{LightPoint, power_heuristic};
use crate::model::sky::SkyMap;
use crate::model::triangle::{at, uniform_point};

/// A point of a path that is connected to lights.
pub(super) struct Shaded<'a> {
    pub walk: u32,
    pub time: f32,
    pub point: &'a Point,
}

impl Shaded<'_> {
    /// Light that arrives along a direction if nothing is in between.
    #[inline(always)]
    pub(super) fn propose(
        &self,
        (start, direction): (V3, V3),
        limit: f32,
        light: V3,
        sample: Sample,
        work: &mut Work,
    ) {
        // It starts behind the light.
        if limit <= 0.0 {
            return;
        }
        let ray = HitRay::new(start, direction, self.time, limit);
        work.rays.push(ray);
        work.candidates.push(Candidate {
            walk: self.walk,
            light,
            sample,
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
        cone: [f32; 2],
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
        [cone_u, cone_v]: [f32; 2],
        work: &mut Work,
    ) {
        let point = from.point;
        let e = self.scene.emitters.get(emitter);
        let weights = [1.0 - b - c, b, c];
        let light = at(e.corners, weights) + e.velocity * from.time;
        let seen = LightPoint::new(light - point.position, e.normal);
        if seen.facing <= 0.0 || self.scene.is_open(e.triangle, weights) {
            return;
        }
        let direction = seen.direction;
        let reflected = point.shading.evaluate(direction);
        if reflected == V3::ZERO {
            return;
        }
        let outer = point.shading.outer(direction);
        let start = lifted(point.position, outer);
        let bend = self.bend(direction, outer, cone_u, cone_v);
        let limit = up_to_plane(start, bend.direction, e.normal, light);
        let triangle = &self.scene.triangles[e.triangle as usize];
        let angle = seen.solid_angle(triangle.area);
        let density = match combined {
            Some(by_scattering) => {
                let other = point.shading.density(direction) * angle;
                power_heuristic(chance, other, by_scattering)
            }
            None => chance,
        };
        let emission = self.scene.emission(e.triangle as usize, weights);
        let emission = emission.towards(seen.facing);
        let sample = Sample::Light(LightSample {
            triangle: e.triangle,
            weights,
            seen,
            reflected,
            density,
        });
        let light = reflected * emission * (angle / density);
        from.propose((start, bend.direction), limit, light, sample, work);
    }

    /// Light of a map along a direction drawn from it, and along that in which the path goes on.
    #[inline(never)]
    pub(super) fn direct_from_map(
        &self,
        from: &Shaded,
        map: &SkyMap,
        [u, v]: [f32; 2],
        [cone_u, cone_v]: [f32; 2],
        along: V3,
        work: &mut Work,
    ) {
        let shading = &from.point.shading;
        let (drawn, chance) = map.drawn.choose(u, v);
        for (by_scattering, direction, chance) in [
            (false, drawn, chance),
            (true, along, map.drawn.density(along)),
        ] {
            let reflected = shading.evaluate(direction);
            if reflected == V3::ZERO {
                continue;
            }
            let outer = shading.outer(direction);
            let start = lifted(from.point.position, outer);
            let bend = self.bend(direction, outer, cone_u, cone_v);
            let other = shading.density(direction);
            let density = power_heuristic(chance, other, by_scattering);
            let light = reflected * map.at(direction) * (1.0 / density);
            let sample = Sample::Sky(SkySample { direction, density });
            from.propose((start, bend.direction), f32::INFINITY, light, sample, work);
        }
    }
}
