//! Direct light: connections of surface points to points of emitters and to directions of a map.

use super::sky::SkyMap;
use super::surface::Point;
use super::view::View;
use super::walk::{Candidate, LightSample, Sample, SkySample, Work};
use crate::accel::HitRay;
use crate::model::V3;
use crate::model::cone::up_to_plane;
use crate::model::heuristic::power_heuristic;
use crate::model::triangle::at;

/// A point of a path that is connected to lights.
pub(super) struct Receiver<'a> {
    pub walk: u32,
    pub time: f32,
    pub point: &'a Point,
    pub start: V3,
}

impl View {
    /// Light from one point of one emitter, and from those that lie along another direction.
    #[inline(always)]
    pub(super) fn direct_from_emitters(
        &self,
        from: &Receiver,
        [u, v]: [f32; 2],
        cone: [f32; 2],
        along: Option<V3>,
        work: &mut Work,
    ) {
        let emitters = &self.scene.emitters;
        let x = from.point.position;
        let (k, chance, u) = emitters.choose(x, from.time, u, &mut work.chances);
        let root = u.sqrt();
        let bc = [root * (1.0 - v), root * v];
        self.connect(from, (k, bc, chance), along.map(|_| false), cone, work);
        if let Some(direction) = along {
            let mut hits = std::mem::take(&mut work.emitter_hits);
            hits.clear();
            emitters.each_hit(emitters.all(), x, from.time, direction, |hit| {
                hits.push(hit);
            });
            for hit in &hits {
                let k = hit.emitter;
                let chance = emitters.chance(x, from.time, k, &mut work.chances);
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
        from: &Receiver,
        (emitter, [b, c], chance): (usize, [f32; 2], f32),
        combined: Option<bool>,
        [cone_u, cone_v]: [f32; 2],
        work: &mut Work,
    ) {
        let point = from.point;
        let e = self.scene.emitters.get(emitter);
        let weights = [1.0 - b - c, b, c];
        let light = at(e.corners, weights) + e.velocity * from.time;
        let to = light - point.position;
        let squared = to.length_squared().max(f32::MIN_POSITIVE);
        let distance = squared.sqrt();
        let direction = to * (1.0 / distance);
        let facing = -e.normal.dot(direction);
        if facing <= 0.0 {
            return;
        }
        let reflected = point.shading.evaluate(direction);
        if reflected == V3::ZERO {
            return;
        }
        let bend = self.bend(direction, point.shading.geometric, cone_u, cone_v);
        let limit = up_to_plane(from.start, bend.direction, e.normal, light);
        let triangle = &self.scene.triangles[e.triangle as usize];
        let per_area = facing / squared * triangle.area;
        let density = match combined {
            Some(by_scattering) => {
                let other = point.shading.density(direction) * per_area;
                power_heuristic(chance, other, by_scattering)
            }
            None => chance,
        };
        let emission = self.scene.materials[triangle.material as usize].emission();
        work.rays
            .push(HitRay::new(from.start, bend.direction, from.time, limit));
        work.candidates.push(Candidate {
            walk: from.walk,
            light: reflected * emission * (per_area / density),
            sample: Sample::Light(LightSample {
                triangle: e.triangle,
                weights,
                direction,
                distance,
                squared,
                facing,
                reflected,
                density,
            }),
        });
    }

    /// Light of a map along a direction drawn from it, and along that in which the path goes on.
    #[inline(never)]
    pub(super) fn direct_from_map(
        &self,
        from: &Receiver,
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
            let bend = self.bend(direction, shading.geometric, cone_u, cone_v);
            let other = shading.density(direction);
            let density = power_heuristic(chance, other, by_scattering);
            work.rays.push(HitRay::new(
                from.start,
                bend.direction,
                from.time,
                f32::INFINITY,
            ));
            work.candidates.push(Candidate {
                walk: from.walk,
                light: reflected * map.at(direction) * (1.0 / density),
                sample: Sample::Sky(SkySample { direction, density }),
            });
        }
    }
}
