//! Direct light: connections of surface points to emitters, delta lights and directions of an environment map, and the
//! environment that rays escape to.

use std::ops::Range;

use macro_rules_attribute::apply;

use super::eights::{self, Eight, brought};
use super::walk::{Candidate, Connecting, Level, LightSample, PathBlock, Waiting, Walk, Way, Work};
use crate::accel::{HitRay, NOTHING, stage};
use crate::lanes::{LANES, Record};
use crate::model::bsdf::Scatter;
use crate::model::connection::{ConeKernel, Connection, Target};
use crate::model::{V2, V3, v2};
use crate::sampling::{Chosen, EmitterTriangle, Receiver};
use crate::trace::{Arrived, NONE, limited, map_of, radiance_of, sky, target_of};

impl Connecting {
    /// Connects the point to a target.
    #[inline(always)]
    fn connect(
        &self,
        of: &PathBlock,
        level: &Level,
        target: &Target,
        radiance: impl FnOnce() -> V3,
        work: &mut Work,
    ) {
        let point = level.points.get(self.lane);
        let numbers = level.cones.get(self.lane);
        let cone = ConeKernel {
            tangent: of.cone,
            u: numbers.z,
            v: numbers.w,
        };
        let (x, chance) = (point.position, self.chance);
        let connection = target.connect(&point.shading, x, chance, self.by_scattering, cone);
        // Otherwise the shadow ray would start behind the light, or there is no connection.
        if connection.limit > 0.0 {
            let throughput = level.throughputs.get(self.lane);
            let light = brought(&connection, radiance(), throughput);
            self.push(of, level, &connection, target.direction, light, work);
        }
    }

    /// Adds the shadow ray of a connection, and the light that arrives if no occluder is in between.
    #[inline(always)]
    fn push(
        &self,
        of: &PathBlock,
        level: &Level,
        connection: &Connection,
        direction: V3,
        light: V3,
        work: &mut Work,
    ) {
        let (path, time) = (level.paths[self.lane], of.time(level, self.lane));
        let ray = HitRay::new(
            connection.start,
            connection.direction,
            time,
            connection.limit,
        );
        work.rays.push(ray);
        work.candidates.push(Candidate { path, light });
        if of.kept.levels {
            work.samples.push(LightSample {
                lane: self.lane as u32,
                emitter: self.emitter,
                weights: self.weights,
                direction,
                arrived: Arrived {
                    reflected: connection.reflected,
                    density: connection.density,
                },
            });
        }
    }
}

/// Adds connections to one point of one emitter, and to the emitters along the direction in which a path continues.
#[apply(stage!)]
pub(super) fn direct_from_emitters<'a>(
    of: &'a PathBlock<'a>,
    level: &'a Level,
    work: &'a mut Work,
) {
    let lists = &of.lists;
    for first in (0..level.len()).step_by(LANES) {
        let lanes = first..level.len().min(first + LANES);
        let points = level.points.lanes(first);
        let mut times = [0.0; LANES];
        for lane in lanes.clone() {
            times[lane % LANES] = of.time(level, lane);
        }
        let at = Eight::<Receiver> {
            position: points.position,
            normal: points.shading.geometric,
            time: times,
        };
        let matt = level.matt[first / LANES];
        let chosen = choose_emitters(of, level, lanes.clone(), matt, &at, work);
        let weights = eights::uniform_points(chosen.rest, level.emitters.lanes(first).y);
        let mut emitters = lanes.clone().map(|i| chosen.emitter[i % LANES]);
        if matt && !lists.features.holes && emitters.all(|k| !of.emitters.is_light(k)) {
            connect_matt(of, level, lanes, (&chosen, &weights), &times, work);
            continue;
        }
        let mut next = 0;
        for lane in lanes {
            let point = level.points.get(lane);
            if !point.reflects {
                continue;
            }
            let own = Chosen::get(&chosen, lane);
            let mut connecting = Connecting {
                lane,
                emitter: own.emitter,
                weights: V2::get(&weights, lane),
                chance: own.chance,
                by_scattering: false,
            };
            loop {
                let (k, weights) = (connecting.emitter, connecting.weights);
                let combined = of.features.combined && point.shading.glossy;
                let (x, time) = (point.position, times[lane % LANES]);
                let target = target_of(lists, k, weights, x, time, combined);
                let radiance = || radiance_of(lists, k, weights, target.facing());
                connecting.connect(of, level, &target, radiance, work);
                let Some(along) = work.along.get(next).filter(|a| a.lane == lane) else {
                    break;
                };
                next += 1;
                connecting = *along;
            }
        }
    }
}

/// Chooses an emitter for each of some lanes. The emitters along the directions in which glossy paths continue are
/// stored in `work.along`, with their probabilities.
#[inline(always)]
fn choose_emitters(
    of: &PathBlock,
    level: &Level,
    lanes: Range<usize>,
    matt: bool,
    at: &Eight<Receiver>,
    work: &mut Work,
) -> Eight<Chosen> {
    let (emitters, kinds) = (&of.emitters, of.emitters.kinds);
    let mut chosen = Eight::<Chosen>::default();
    work.along.clear();
    let are_few = !kinds.by_sums;
    if are_few {
        let few = &mut work.few[..emitters.tree.fixed.count as usize];
        if kinds.by_solid_angle {
            eights::look(emitters, at, few);
        } else {
            for (few, &chance) in few.iter_mut().zip(emitters.tree.fixed.chances) {
                *few = [chance; LANES];
            }
        }
        chosen = eights::choose(level.emitters.lanes(lanes.start).x, few);
    }
    if are_few && (matt || !of.features.combined) {
        return chosen;
    }
    let mut room = std::mem::take(&mut work.room);
    for lane in lanes {
        let point = level.points.get(lane);
        let glossy = of.features.combined && point.shading.glossy;
        if !point.reflects || (are_few && !glossy) {
            continue;
        }
        let own = Receiver::get(at, lane);
        let mut share = 0.0;
        if are_few {
            let few = &work.few[..emitters.tree.fixed.count as usize];
            for (room, few) in room.iter_mut().zip(few) {
                *room = few[lane % LANES].to_bits();
            }
        } else {
            share = emitters.look(&own, &mut room);
            let u = level.emitters.get(lane).x;
            let choice = emitters.choose(u, &own, share, &mut room);
            choice.set(&mut chosen, lane);
        }
        let Scatter {
            direction, weight, ..
        } = level.scatters.get(lane);
        // Glass loses some directions ([`Scatter::weight`]).
        if glossy && !weight.is_zero() {
            let (met, along) = (&mut work.met, &mut work.along);
            (of.scene.emitters).each_hit_of_all(&own, direction, met, |hit| {
                along.push(Connecting {
                    lane,
                    emitter: hit.emitter,
                    weights: hit.weights,
                    chance: emitters.chance(hit.emitter, &own, share, &mut room),
                    by_scattering: true,
                });
            });
        }
    }
    work.room = room;
    chosen
}

/// Up to this number of emitting triangles, a loop over all of them selects those that the lanes chose.
const PASSED: u32 = 8;

/// Connects matt surfaces to points of triangles, for all lanes at once.
#[inline(always)]
fn connect_matt(
    of: &PathBlock,
    level: &Level,
    lanes: Range<usize>,
    (chosen, weights): (&Eight<Chosen>, &Eight<V2>),
    times: &Eight<f32>,
    work: &mut Work,
) {
    let points = level.points.lanes(lanes.start);
    let (lists, emitters) = (&of.lists, &of.emitters);
    // The triangle that each lane chose, and the radiance that its front emits at the chosen point.
    let mut on = Eight::<EmitterTriangle>::default();
    let passed = emitters.triangle_count <= PASSED;
    if passed {
        on = eights::chosen_triangles(emitters, chosen.emitter, *times);
    }
    let mut radiances = Eight::<V3>::default();
    for lane in lanes.clone() {
        let k = chosen.emitter[lane % LANES];
        if !passed {
            let triangle = emitters.triangle(k, times[lane % LANES]);
            triangle.set(&mut on, lane);
        }
        let radiance = radiance_of(lists, k, V2::get(weights, lane), 1.0);
        radiance.set(&mut radiances, lane);
    }
    let cones = (of.cone, *level.cones.lanes(lanes.start));
    let (directions, connections) = if of.features.cones {
        eights::connect::<true>(*points, on, *weights, chosen.chance, cones)
    } else {
        eights::connect::<false>(*points, on, *weights, chosen.chance, cones)
    };
    let lights = eights::lights(
        connections,
        radiances,
        *level.throughputs.lanes(lanes.start),
    );
    for lane in lanes {
        if !points.reflects[lane % LANES] || connections.limit[lane % LANES] <= 0.0 {
            continue;
        }
        let connecting = Connecting {
            lane,
            emitter: chosen.emitter[lane % LANES],
            weights: V2::get(weights, lane),
            chance: chosen.chance[lane % LANES],
            by_scattering: false,
        };
        let (connection, direction) = (
            Connection::get(&connections, lane),
            V3::get(&directions, lane),
        );
        let light = V3::get(&lights, lane);
        connecting.push(of, level, &connection, direction, light, work);
    }
}

/// Adds light of an environment map along a direction drawn from it, and along the direction in which the path
/// continues. If the path is sure to continue, the next ray shows whether the map is visible in that direction.
#[apply(stage!)]
pub(super) fn direct_from_map<'a>(
    of: &'a PathBlock<'a>,
    level: &'a Level,
    last: bool,
    work: &'a mut Work,
) {
    let lists = &of.lists;
    let surely_on = !last && !of.plays(last) && !of.features.cones;
    for lane in 0..level.len() {
        if !level.points.get(lane).reflects {
            continue;
        }
        let numbers = level.choices.get(lane);
        let drawn = map_of(lists).choose(lists.sky_density, numbers.z, numbers.w);
        let scatter = level.scatters.get(lane);
        for (by_scattering, direction) in [(false, drawn), (true, scatter.direction)] {
            if by_scattering && scatter.weight.is_zero() {
                continue;
            }
            let connecting = Connecting {
                lane,
                emitter: NONE,
                weights: v2(0.0, 0.0),
                chance: map_of(lists).density(lists.sky_density, direction),
                by_scattering,
            };
            let target = Target::of_map(direction);
            let before = work.rays.len();
            connecting.connect(of, level, &target, || sky(lists, direction), work);
            if by_scattering && surely_on && work.rays.len() > before {
                work.rays.truncate(before);
                work.waiting.extend(work.candidates.pop().map(|c| Waiting {
                    lane: lane as u32,
                    light: c.light,
                    sample: work.samples.pop(),
                }));
            }
        }
    }
}

/// Adds the light of the map that waits for the next rays, for those rays that hit nothing.
pub(super) fn see_map(level: &mut Level, list: &mut [Walk], work: &Work) {
    let mut rays = work.lanes.iter().zip(&work.hits);
    for waiting in &work.waiting {
        // Both lists are in the order of lanes.
        let own = rays.find(|(lane, _)| **lane == waiting.lane);
        if own.is_some_and(|(_, hit)| hit.triangle == NOTHING) {
            let path = level.paths[waiting.lane as usize];
            list[path as usize].light.radiance += waiting.light;
            level.lights.extend(waiting.sample);
        }
    }
}

/// Adds the light of the environment for rays that hit nothing.
#[apply(stage!)]
pub(super) fn escape<'a>(
    of: &'a PathBlock<'a>,
    level: &'a mut Level,
    list: &'a mut [Walk],
    work: &'a Work,
) {
    for (&lane, hit) in work.lanes.iter().zip(&work.hits) {
        if hit.triangle == NOTHING {
            let lane = lane as usize;
            let left = level.leavings.get(lane);
            let light = left.throughput * sky(&of.lists, left.bend.direction);
            let light = limited(&of.lists, light, of.bounce);
            list[level.paths[lane] as usize].light.radiance += light;
            level.ways[lane] = Way::Escaped;
        }
    }
}

/// Limits the indirect light of all connections.
pub(super) fn limit_lights(of: &PathBlock, work: &mut Work) {
    let lights = work.candidates.iter_mut().map(|c| &mut c.light);
    for light in lights.chain(work.waiting.iter_mut().map(|w| &mut w.light)) {
        *light = limited(&of.lists, *light, of.bounce);
    }
}
