//! Direct light: connections of surface points to emitters, delta lights and directions of a map.

use macro_rules_attribute::apply;

use super::view::Tracer;
use super::walk::{Candidate, Level, LightSample, Path, Work};
use crate::accel::{HitRay, stage};
use crate::model::connection::{ConeKernel, Target};
use crate::model::triangle::uniform_point;
use crate::model::{V3, v2};
use crate::sampling::Dimensions;
use crate::trace::{
    Arrived, NONE, Point, density_of_map, map_of, radiance_of, receiver_of, sky, target_of,
};

/// A connection of a point to a light before its ray is traced: its point, how it was drawn, and how likely.
struct Connecting<'a> {
    point: &'a Point,
    path: u32,
    time: f32,
    cone: ConeKernel,
    sample: LightSample,
    chance: f32,
    by_scattering: bool,
    throughput: V3,
}

impl Connecting<'_> {
    /// Adds the ray to a point of an emitter, which counts as found by two strategies if it is `combined`.
    #[inline(always)]
    fn to_emitter(&self, tracer: &Tracer, combined: bool, work: &mut Work) {
        let (k, weights) = (self.sample.emitter, self.sample.weights);
        let (x, time) = (self.point.position, self.time);
        let target = target_of(&tracer.lists, k, weights, x, time, combined);
        self.connect(&target, || radiance_of(&tracer.lists, k, weights), work);
    }

    /// Adds the ray to a target and the light that arrives if nothing is in between; its radiance is looked up where it
    /// counts.
    #[inline(always)]
    fn connect(&self, target: &Target, radiance: impl FnOnce() -> V3, work: &mut Work) {
        let (shading, position) = (&self.point.shading, self.point.position);
        let (chance, by_scattering) = (self.chance, self.by_scattering);
        let found = target.connect(shading, position, chance, by_scattering, self.cone);
        // It starts behind the light, or there is none.
        if found.limit <= 0.0 {
            return;
        }
        let ray = HitRay::new(found.start, found.direction, self.time, found.limit);
        work.rays.push(ray);
        work.candidates.push(Candidate {
            path: self.path,
            light: self.throughput * (found.reflected * radiance() * found.scale),
            sample: LightSample {
                direction: target.direction,
                arrived: Arrived {
                    reflected: found.reflected,
                    density: found.density,
                },
                ..self.sample
            },
        });
    }
}

/// The kernel of the cone of a path's shadow rays.
#[inline(always)]
fn cone_of_shadow(tracer: &Tracer, path: &Path, bounce: u32) -> ConeKernel {
    let numbers = tracer.cone_numbers(path, bounce);
    ConeKernel {
        tangent: tracer.cone,
        u: numbers.z,
        v: numbers.w,
    }
}

/// Light from one point of one emitter, and from those that lie along the direction in which a path goes on.
#[apply(stage!)]
pub(super) fn direct_from_emitters<'a>(
    tracer: &'a Tracer<'a>,
    paths: &'a [Path<'a>],
    level: &'a Level,
    bounce: u32,
    work: &'a mut Work,
) {
    let emitters = &tracer.emitters;
    let mut room = std::mem::take(&mut work.room);
    let mut hits = std::mem::take(&mut work.emitter_hits);
    for lane in 0..level.len {
        let point = &level.points.get(lane);
        if !point.reflects {
            continue;
        }
        let index = level.paths[lane];
        let path = &paths[index as usize];
        let at = receiver_of(point, path.time);
        let share = emitters.look(&at, &mut room);
        let numbers = level.emitters.get(lane);
        let choice = emitters.choose(numbers.x, &at, share, &mut room);
        let weights = uniform_point(choice.rest, numbers.y);
        let mut connecting = Connecting {
            point,
            path: index,
            time: path.time,
            cone: cone_of_shadow(tracer, path, bounce),
            sample: LightSample::of_emitter(lane as u32, choice.emitter, weights),
            chance: choice.chance,
            by_scattering: false,
            throughput: level.throughputs.get(lane),
        };
        let combined = tracer.features.combined && point.shading.glossy;
        connecting.to_emitter(tracer, combined, work);
        if !combined {
            continue;
        }
        connecting.by_scattering = true;
        let direction = level.scatters.get(lane).direction;
        hits.clear();
        let all = &tracer.scene.emitters;
        all.each_hit_of_all(&at, direction, &mut work.met, |hit| hits.push(hit));
        for hit in &hits {
            connecting.chance = emitters.chance(hit.emitter, &at, share, &mut room);
            connecting.sample = LightSample::of_emitter(lane as u32, hit.emitter, hit.weights);
            connecting.to_emitter(tracer, combined, work);
        }
    }
    (work.room, work.emitter_hits) = (room, hits);
}

/// Light of a map along a direction drawn from it, and along that in which the path goes on.
#[apply(stage!)]
pub(super) fn direct_from_map<'a>(
    tracer: &'a Tracer<'a>,
    paths: &'a [Path<'a>],
    level: &'a Level,
    bounce: u32,
    work: &'a mut Work,
) {
    let lists = &tracer.lists;
    for lane in 0..level.len {
        let point = &level.points.get(lane);
        if !point.reflects {
            continue;
        }
        let index = level.paths[lane];
        let path = &paths[index as usize];
        let numbers = path.numbers.draw(Dimensions::choices(bounce));
        let drawn = map_of(lists).choose(lists.sky_density, numbers.z, numbers.w);
        let scattered = level.scatters.get(lane).direction;
        for (by_scattering, direction) in [(false, drawn), (true, scattered)] {
            let connecting = Connecting {
                point,
                path: index,
                time: path.time,
                cone: cone_of_shadow(tracer, path, bounce),
                sample: LightSample::of_emitter(lane as u32, NONE, v2(0.0, 0.0)),
                chance: density_of_map(lists, direction),
                by_scattering,
                throughput: level.throughputs.get(lane),
            };
            let target = Target::of_map(direction);
            connecting.connect(&target, || sky(lists, direction), work);
        }
    }
}
