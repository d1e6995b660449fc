//! Direct light: connections of surface points to emitters, delta lights and directions of a map.

use std::ops::Range;

use macro_rules_attribute::apply;

use super::eights::{self, Eight};
use super::view::Tracer;
use super::walk::{Along, Candidate, Level, LightSample, Path, Work};
use crate::accel::{HitRay, stage};
use crate::lanes::{LANES, Record};
use crate::model::connection::{ConeKernel, Connection, Target};
use crate::model::{V2, V3, v2};
use crate::sampling::{Chosen, Dimensions, EmitterTriangle, Receiver};
use crate::trace::{
    Arrived, NONE, Point, density_of_map, is_light, map_of, radiance_of, sky, target_of,
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
    keep: bool,
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
        });
        if self.keep {
            work.samples.push(LightSample {
                direction: target.direction,
                arrived: Arrived {
                    reflected: found.reflected,
                    density: found.density,
                },
                ..self.sample
            });
        }
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
    keep: bool,
    work: &'a mut Work,
) {
    let lists = &tracer.lists;
    let simple = tracer.cone == 0.0 && !lists.features.holes;
    for first in (0..level.len).step_by(LANES) {
        let lanes = first..level.len.min(first + LANES);
        let points = level.points.lanes(first);
        let mut times = [0.0; LANES];
        for lane in lanes.clone() {
            times[lane % LANES] = paths[level.paths[lane] as usize].time;
        }
        let at = eights::receivers(points, times);
        let matt = eights::are_matt(points, lanes.len());
        let chosen = choose_emitters(tracer, level, lanes.clone(), matt, &at, work);
        let numbers = level.emitters.lanes(first);
        let weights = eights::uniform_points(chosen.rest, numbers.y);
        let are_triangles = lanes
            .clone()
            .all(|i| !is_light(lists, chosen.emitter[i % LANES]));
        if simple && matt && are_triangles {
            connect_matt(tracer, paths, level, lanes, (&chosen, &weights), keep, work);
            continue;
        }
        let mut along = 0;
        for lane in lanes {
            let point = &level.points.get(lane);
            if !point.reflects {
                continue;
            }
            let index = level.paths[lane];
            let path = &paths[index as usize];
            let own = Chosen::get(&chosen, lane);
            let weights = V2::get(&weights, lane);
            let combined = tracer.features.combined && point.shading.glossy;
            let mut connecting = Connecting {
                point,
                path: index,
                time: path.time,
                cone: cone_of_shadow(tracer, path, bounce),
                sample: LightSample::of_emitter(lane as u32, own.emitter, weights),
                chance: own.chance,
                by_scattering: false,
                throughput: level.throughputs.get(lane),
                keep,
            };
            connecting.to_emitter(tracer, combined, work);
            connecting.by_scattering = true;
            while let Some(found) = work.along.get(along).filter(|a| a.lane == lane as u32) {
                along += 1;
                connecting.chance = found.chance;
                let (k, weights) = (found.emitter, found.weights);
                connecting.sample = LightSample::of_emitter(lane as u32, k, weights);
                connecting.to_emitter(tracer, combined, work);
            }
        }
    }
}

/// Chooses an emitter for each of some lanes; those along the directions in which glossy paths go on are left in
/// `work.along`, with their probabilities.
#[inline(always)]
fn choose_emitters(
    tracer: &Tracer,
    level: &Level,
    lanes: Range<usize>,
    matt: bool,
    at: &Eight<Receiver>,
    work: &mut Work,
) -> Eight<Chosen> {
    let (emitters, kinds) = (&tracer.emitters, tracer.emitters.kinds);
    let mut chosen = Eight::<Chosen>::default();
    let mut room = std::mem::take(&mut work.room);
    let few = &mut work.few[..];
    work.along.clear();
    let are_few = !kinds.by_tree && !kinds.by_sums;
    if are_few {
        let few = &mut few[..emitters.tree.fixed.count as usize];
        if kinds.by_solid_angle {
            eights::look(emitters, at, few);
        } else {
            for (few, &chance) in few.iter_mut().zip(emitters.tree.fixed.chances) {
                *few = [chance; LANES];
            }
        }
        chosen = eights::choose(level.emitters.lanes(lanes.start).x, few);
    }
    if are_few && (matt || !tracer.features.combined) {
        work.room = room;
        return chosen;
    }
    for lane in lanes {
        let point = level.points.get(lane);
        if !point.reflects {
            continue;
        }
        let own = Receiver::get(at, lane);
        let mut share = 0.0;
        if are_few {
            for (room, few) in room.iter_mut().zip(&work.few) {
                *room = few[lane % LANES].to_bits();
            }
        } else {
            share = emitters.look(&own, &mut room);
            let u = level.emitters.get(lane).x;
            let choice = emitters.choose(u, &own, share, &mut room);
            choice.set(&mut chosen, lane);
        }
        if tracer.features.combined && point.shading.glossy {
            let direction = level.scatters.get(lane).direction;
            let (met, along) = (&mut work.met, &mut work.along);
            (tracer.scene.emitters).each_hit_of_all(&own, direction, met, |hit| {
                along.push(Along {
                    lane: lane as u32,
                    emitter: hit.emitter,
                    weights: hit.weights,
                    chance: emitters.chance(hit.emitter, &own, share, &mut room),
                });
            });
        }
    }
    work.room = room;
    chosen
}

/// Connects matt surfaces to points of triangles, all lanes at once.
#[inline(always)]
fn connect_matt(
    tracer: &Tracer,
    paths: &[Path],
    level: &Level,
    lanes: Range<usize>,
    (chosen, weights): (&Eight<Chosen>, &Eight<V2>),
    keep: bool,
    work: &mut Work,
) {
    let mut on = Eight::<EmitterTriangle>::default();
    for lane in lanes.clone() {
        let time = paths[level.paths[lane] as usize].time;
        let triangle = tracer.emitters.triangle(chosen.emitter[lane % LANES], time);
        triangle.set(&mut on, lane);
    }
    let points = level.points.lanes(lanes.start);
    let (directions, found) = eights::connect(*points, on, *weights, chosen.chance);
    for lane in lanes {
        let found = Connection::get(&found, lane);
        // It starts behind the light, or there is none.
        if found.limit <= 0.0 || !points.reflects[lane % LANES] {
            continue;
        }
        let path = level.paths[lane];
        let time = paths[path as usize].time;
        let ray = HitRay::new(found.start, found.direction, time, found.limit);
        work.rays.push(ray);
        let (k, weights) = (chosen.emitter[lane % LANES], V2::get(weights, lane));
        let radiance = radiance_of(&tracer.lists, k, weights);
        work.candidates.push(Candidate {
            path,
            light: level.throughputs.get(lane) * (found.reflected * radiance * found.scale),
        });
        if keep {
            work.samples.push(LightSample {
                lane: lane as u32,
                emitter: k,
                weights,
                direction: V3::get(&directions, lane),
                arrived: Arrived {
                    reflected: found.reflected,
                    density: found.density,
                },
            });
        }
    }
}

/// Light of a map along a direction drawn from it, and along that in which the path goes on.
#[apply(stage!)]
pub(super) fn direct_from_map<'a>(
    tracer: &'a Tracer<'a>,
    paths: &'a [Path<'a>],
    level: &'a Level,
    bounce: u32,
    keep: bool,
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
                keep,
            };
            let target = Target::of_map(direction);
            connecting.connect(&target, || sky(lists, direction), work);
        }
    }
}
