//! A path from the camera to its end, in a thread of a GPU.
//!
//! Calls are inlined in a kernel, so there is one place that traces a ray, in a loop over the rays of a path:
//! the camera's, those to lights, and those with which the path goes on.

use crate::cube::*;

use super::camera::Beginning;
use super::emitters_along::next_emitter_hit;
use super::hit::{Hit, Ray, see_all, trace};
use super::places::{PathLight, Place, Start, no_point};
use super::records::{
    ESCAPED, MOST_ALONG, Room, SAW_ALONG, SAW_EMITTER, SAW_MAP, SAW_MAP_ALONG, WENT_ON,
    keep_vector, record_at,
};
use crate::model::bsdf::Scatter;
use crate::model::cone::Bend;
use crate::model::connection::{ConeKernel, Target, no_connection};
use crate::model::triangle::uniform_point;
use crate::model::{splat, v2};
use crate::sampling::{Chosen, Dimensions, Receiver};
use crate::trace::{
    CONE, Leaving, NONE, Scene, density_of_map, emitted, emitters_of, leave, map_of, point_at,
    radiance_of, receiver_of, sky, target_of,
};

/// What the next ray of a path is for.
pub(super) const OF_CAMERA: u32 = 0;
pub(super) const TO_EMITTER: u32 = 1;
pub(super) const TO_EMITTERS_ALONG: u32 = 2;
pub(super) const TO_MAP: u32 = 3;
pub(super) const TO_MAP_ALONG: u32 = 4;
pub(super) const ONWARDS: u32 = 5;
pub(super) const ENDED: u32 = 6;

/// Traces a path from its beginning, or with `beside` from a point. `stack` is room for nodes of the tree, `choice` for the
/// choice of an emitter; with `keep` the path's points are left in `records`.
#[cube]
pub(super) fn path_light(
    scene: &Scene,
    stack: &mut [u32],
    choice: &mut [u32],
    records: &mut [u32],
    room: Room,
    path: Beginning,
    start: Start,
    #[comptime] beside: bool,
    #[comptime] keep: bool,
) -> PathLight {
    let numbers = path.numbers;
    let cones = path.cones;
    let time = path.time;
    let first = path.ray;
    let mut seen = PathLight {
        radiance: splat(0.0),
        opacity: 0.0f32,
        depth: 0.0f32,
        normal: splat(0.0),
        object: NONE,
        rays: 0u32,
        looked: 0u32,
        points: 0u32,
    };
    let mut from = Place {
        point: no_point(scene),
        cone: ConeKernel {
            tangent: scene.settings[CONE],
            u: 0.0f32,
            v: 0.0f32,
        },
        share: 0.0f32,
    };
    // The emitter that the path's point is connected to.
    let mut k = NONE.runtime();
    let mut weights = v2(0.0, 0.0);
    let mut throughput = splat(1.0);
    let mut scatter = Scatter {
        direction: splat(0.0),
        weight: splat(0.0),
        local: splat(0.0),
        of_gloss: false,
        u: 0.0f32,
        v: 0.0f32,
    };
    // Random numbers for the emitter that the path's point is connected to, and for that of the next point.
    let mut emitter_u = 0.0f32;
    let mut emitter_v = 0.0f32;
    let mut next_u = path.film.z;
    let mut next_v = path.film.w;
    let mut bounce = 0u32;
    // Where the list of emitters along a direction goes on.
    let mut next = 0u32;
    // What was seen from the path's point, and the bit of the next emitter along a direction.
    let mut bits = 0u32.runtime();
    let mut bit = SAW_ALONG.runtime();
    let mut purpose = OF_CAMERA.runtime();
    let mut origin = first.origin;
    let mut direction = first.direction;
    let mut limit = f32::MAX.runtime();
    let mut light = splat(0.0);
    let bounces = scene.bounces;
    let mut begins = true;
    if beside {
        bounce = start.bounce;
        origin = start.near;
        direction = start.direction;
        limit = -1.0f32;
    }
    while purpose != ENDED {
        let mut hit = Hit {
            t: 0.0f32,
            triangle: NONE,
        };
        if beside {
            if begins {
                hit.triangle = start.triangle;
                begins = false;
            }
        }
        if limit > 0.0 {
            let any = purpose != OF_CAMERA && (purpose != ONWARDS || bounce >= bounces);
            let ray = Ray {
                origin,
                direction,
                time,
                from: 0.0f32,
                limit,
            };
            hit = trace(scene, stack, ray, see_all(), any, false);
            seen.rays += 1;
            if !any {
                seen.looked += 1;
            }
        }
        let missed = hit.triangle == NONE;
        let arrives = purpose == OF_CAMERA || purpose == ONWARDS;
        if arrives {
            if missed {
                // With a map that is gathered at surfaces, rays that go on bring nothing.
                if purpose == OF_CAMERA || comptime!(scene.features.sees_sky) {
                    bits |= ESCAPED;
                    seen.radiance += throughput.times(sky(scene, direction));
                }
                purpose = ENDED;
            } else if purpose == ONWARDS && bounce >= bounces {
                purpose = ENDED;
            } else {
                let near = origin + direction * hit.t;
                let mut emits = true;
                if beside {
                    if purpose == OF_CAMERA {
                        hit.t = start.distance;
                        emits = start.emits;
                    }
                }
                let mut point = point_at(scene, hit.triangle, near, hit.t, direction, time);
                if purpose == OF_CAMERA {
                    if beside {
                        point.shading.pair = start.pair;
                        point.shading.paired = start.paired;
                    }
                    if emits {
                        seen.radiance += emitted(scene, &point);
                    }
                    seen.opacity = 1.0;
                    seen.depth = hit.t;
                    seen.normal = point.shading.geometric;
                    seen.object = point.object;
                } else {
                    bounce += 1;
                }
                emitter_u = next_u;
                emitter_v = next_v;
                if keep {
                    let k = seen.points;
                    if k > 0 {
                        records[record_at(room, k - 1, 11u32)] = bits;
                    }
                    records[record_at(room, k, 0u32)] = hit.triangle;
                    records[record_at(room, k, 1u32)] = hit.t.to_bits();
                    keep_vector(records, room, k, 2u32, origin);
                    keep_vector(records, room, k, 5u32, direction);
                    keep_vector(records, room, k, 8u32, throughput);
                    bits = 0u32;
                    bit = SAW_ALONG;
                }
                seen.points += 1;
                let goes_on = bounce < bounces || comptime!(scene.features.sees_sky);
                let by_scattering = comptime!(scene.features.combined) && point.shading.glossy;
                from.point = point;
                purpose = TO_EMITTER;
                if !point.reflects || comptime!(scene.features.dark) {
                    purpose = ENDED;
                } else {
                    if comptime!(scene.features.cones) {
                        let set = cones.draw(scene.points, Dimensions::of_set(bounce));
                        from.cone.u = set.z;
                        from.cone.v = set.w;
                    }
                    if comptime!(scene.features.emitters) {
                        from.share =
                            emitters_of(scene).look(&receiver_of(&from.point, time), choice);
                    }
                }
                if goes_on || by_scattering || comptime!(scene.features.gathers_map) {
                    let drawn = numbers.draw(scene.points, Dimensions::direction(bounce));
                    let mut lobe = 0.0f32;
                    if point.shading.glossy {
                        lobe = numbers.draw(scene.points, Dimensions::choices(bounce)).x;
                    }
                    scatter = point.shading.sample(drawn.x, drawn.y, lobe);
                    next_u = drawn.z;
                    next_v = drawn.w;
                }
                next = 0u32;
            }
        } else {
            if missed && limit > 0.0 {
                seen.radiance += throughput.times(light);
                if keep {
                    if purpose == TO_EMITTER {
                        bits |= SAW_EMITTER;
                    } else if purpose == TO_EMITTERS_ALONG {
                        bits |= bit;
                    } else if purpose == TO_MAP {
                        bits |= SAW_MAP;
                    } else {
                        bits |= SAW_MAP_ALONG;
                    }
                }
            }
            if purpose == TO_EMITTERS_ALONG {
                // Where bits end the last one stands for all; no light hides behind so many others.
                if bit < (1u32 << MOST_ALONG) {
                    bit *= 2;
                }
            }
            if purpose != TO_EMITTERS_ALONG {
                purpose += 1;
            }
        }
        // The next ray.
        let mut chosen = no_connection(from.point.position);
        let mut target = Target::none();
        let mut p = 1.0f32;
        let mut is_emitter = false;
        let mut along = false;
        if purpose == TO_EMITTER || purpose == TO_EMITTERS_ALONG {
            if comptime!(scene.features.emitters) {
                is_emitter = true;
            } else {
                purpose = TO_MAP;
            }
        }
        if is_emitter {
            let combined = comptime!(scene.features.combined) && from.point.shading.glossy;
            let x = from.point.position;
            let at: Receiver = receiver_of(&from.point, time);
            if purpose == TO_EMITTER {
                let drawn: Chosen = emitters_of(scene).choose(emitter_u, &at, from.share, choice);
                k = drawn.emitter;
                p = drawn.chance;
                weights = uniform_point(drawn.rest, emitter_v);
            } else {
                along = true;
                k = NONE;
                if combined {
                    let found = next_emitter_hit(scene, next, x, scatter.direction, time);
                    k = found.emitter;
                    weights = found.weights;
                    next = k + 1;
                    if k != NONE {
                        p = emitters_of(scene).chance(k, &at, from.share, choice);
                    }
                }
            }
            if k == NONE {
                purpose = TO_MAP;
            } else {
                target = target_of(scene, k, weights, x, time, combined);
            }
        }
        if purpose == TO_MAP || purpose == TO_MAP_ALONG {
            if comptime!(scene.features.gathers_map) {
                let mut towards = scatter.direction;
                if purpose == TO_MAP {
                    let drawn = numbers.draw(scene.points, Dimensions::choices(bounce));
                    towards = map_of(scene).choose(scene.sky_density, drawn.z, drawn.w);
                }
                along = purpose == TO_MAP_ALONG;
                p = density_of_map(scene, towards);
                target = Target::of_map(towards);
            } else {
                purpose = ONWARDS;
            }
        }
        if comptime!(scene.features.emitters || scene.features.gathers_map) {
            let at = from.point;
            chosen = target.connect(&at.shading, at.position, p, along, from.cone);
            if chosen.limit > 0.0 {
                if purpose < TO_MAP {
                    if comptime!(scene.features.emitters) {
                        target.radiance = radiance_of(scene, k, weights, target.facing());
                    }
                } else if comptime!(scene.features.gathers_map) {
                    target.radiance = sky(scene, target.direction);
                }
            }
            light = chosen.reflected.times(target.radiance) * chosen.scale;
        }
        if purpose == ONWARDS {
            let last = bounce >= bounces;
            let mut left = Leaving {
                goes_on: false,
                start: chosen.start,
                bend: Bend {
                    offset: chosen.start,
                    mirrored: false,
                    direction: chosen.start,
                },
                throughput,
                survival: 1.0f32,
            };
            if !last || comptime!(scene.features.sees_sky) {
                let mut u = 0.0f32;
                if comptime!(scene.features.roulette) {
                    u = numbers.draw(scene.points, Dimensions::choices(bounce)).y;
                }
                let mut cone_u = 0.0f32;
                let mut cone_v = 0.0f32;
                if comptime!(scene.features.cones) {
                    let set = cones.draw(scene.points, Dimensions::of_set(bounce));
                    cone_u = set.x;
                    cone_v = set.y;
                }
                left = leave(
                    scene,
                    &from.point,
                    &scatter,
                    throughput,
                    bounce,
                    u,
                    cone_u,
                    cone_v,
                );
            }
            throughput = left.throughput;
            chosen.start = left.start;
            chosen.direction = left.bend.direction;
            chosen.limit = f32::MAX;
            if left.goes_on {
                if keep {
                    bits |= WENT_ON;
                    records[record_at(room, seen.points - 1, 12u32)] = left.survival.to_bits();
                }
            } else {
                purpose = ENDED;
            }
        }
        origin = chosen.start;
        direction = chosen.direction;
        limit = chosen.limit;
    }
    if keep {
        if seen.points > 0 {
            records[record_at(room, seen.points - 1, 11u32)] = bits;
        }
    }
    seen
}
