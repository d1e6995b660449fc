//! A path from the camera to its end, in a thread of a GPU.
//!
//! Calls are inlined in a kernel. So a single place traces rays, in a loop over the rays of a path. A camera or
//! bounce ray leads to a point. A shadow ray adds light. Then the point is connected to the next light, or a bounce
//! ray continues.

use crate::cube::*;

use super::camera::{Beginning, begin};
use super::hit::{Memory, Ray, trace};
use super::records::{
    Arrival, ESCAPED, MAX_BIT_ALONG, OF_BITS, OF_SURVIVAL, Room, SAW_ALONG, SAW_EMITTER, SAW_MAP,
    SAW_MAP_ALONG, WENT_ON,
};
use super::walk::{
    ENDED, OF_CAMERA, ONWARDS, PathLight, Start, TO_EMITTER, TO_EMITTERS_ALONG, TO_MAP,
    TO_MAP_ALONG, Walk,
};
use crate::accel::Hit;
use crate::model::connection::{Target, no_connection};
use crate::model::{splat, v2};
use crate::sampling::EmitterPlace;
use crate::trace::{
    CONE, Faces, NONE, Scene, emitted, emitters_of, leave, limited, map_of, point_at, radiance_of,
    receiver_of, sky, target_of,
};

#[cube]
pub(super) fn light_of_pixel(
    scene: &Scene,
    memory: &mut Memory,
    pixel: u32,
    sample: u32,
) -> PathLight {
    let path = begin(scene, pixel, sample);
    light_of(scene, memory, path, Start::default(), false)
}

/// Returns the light of a path from its beginning, or from the point `start` if `beside`.
#[cube]
pub(super) fn light_of(
    scene: &Scene,
    memory: &mut Memory,
    path: Beginning,
    start: Start,
    #[comptime] beside: bool,
) -> PathLight {
    // No records are stored.
    let mut records = Array::<u32>::new(1usize);
    let none = records.as_mut_slice();
    let room = Room::new(0u32, 1u32, 0u32, 1u32);
    path_light(scene, memory, none, room, path, start, beside, false)
}

/// Traces a path from its beginning, or from the point `start` if `beside`. With `keep`, its points are stored in
/// `records`.
#[cube]
pub(super) fn path_light(
    scene: &Scene,
    memory: &mut Memory,
    records: &mut [u32],
    room: Room,
    path: Beginning,
    start: Start,
    #[comptime] beside: bool,
    #[comptime] keep: bool,
) -> PathLight {
    let mut light = PathLight::default();
    light.object = NONE;
    let mut walk = Walk::default();
    walk.purpose = OF_CAMERA;
    walk.throughput = splat(1.0);
    walk.cone.tangent = scene.settings[CONE];
    walk.next_emitter = v2(path.film.z, path.film.w);
    walk.bit = SAW_ALONG;
    if beside {
        walk.bounce = start.bounce;
        walk.origin = start.at.near;
        walk.direction = start.at.direction;
        walk.limit = -1.0f32;
    } else {
        walk.origin = path.ray.origin;
        walk.direction = path.ray.direction;
        walk.limit = f32::MAX;
    }
    let mut begins = true;
    while walk.purpose != ENDED {
        let mut hit = Hit {
            t: 0.0f32,
            triangle: NONE,
        };
        if beside {
            if begins {
                hit.triangle = start.at.triangle;
                begins = false;
            }
        }
        if walk.limit > 0.0 {
            let any = !walk.arrives() || walk.is_last(scene);
            let ray = Ray {
                origin: walk.origin,
                direction: walk.direction,
                time: path.time,
                limit: walk.limit,
            };
            hit = trace(scene, memory, ray, Faces::default(), any, false);
            light.rays += 1;
            if !any {
                light.looked += 1;
            }
        }
        // These conditions are not nested, since a value that a branch sets is merged at the end of each condition around it.
        let missed = hit.triangle == NONE;
        let looked = walk.arrives();
        let arrives = looked && !missed && !walk.is_last(scene);
        if !looked {
            take_light(&mut walk, &mut light, missed, keep);
        }
        if looked && missed {
            // If surfaces gather the light of the map, escaping bounce rays add only the waiting light.
            if walk.purpose == OF_CAMERA || comptime!(scene.features.sees_sky) {
                walk.bits |= ESCAPED;
                let sky = walk.throughput.times(sky(scene, walk.direction));
                light.seen.radiance += limited(scene, sky, walk.bounce);
            }
            if comptime!(scene.features.gathers_map) {
                if walk.waits {
                    walk.bits |= SAW_MAP_ALONG;
                    light.seen.radiance += walk.waiting;
                }
            }
        }
        walk.purpose = select(looked && !arrives, ENDED, walk.purpose);
        if arrives {
            arrive(scene, &path, &start, &hit, &mut walk, &mut light, beside);
            if keep {
                keep_arrival(records, room, &hit, &mut walk, light.points);
            }
            light.points += 1;
            look_around(scene, memory, &path, &mut walk);
        }
        connect(scene, memory, &path, &mut walk);
        let is_dark = walk.is_last(scene) && comptime!(!scene.features.sees_sky);
        walk.purpose = select(is_dark, ENDED, walk.purpose);
        if walk.purpose == ONWARDS {
            go_on(scene, records, room, &path, &mut walk, light.points, keep);
        }
    }
    if keep {
        if light.points > 0 {
            records[room.at(light.points - 1, OF_BITS)] = walk.bits;
        }
    }
    light
}

/// Adds the light of a shadow ray. The next ray leads to the next light.
#[cube]
fn take_light(walk: &mut Walk, light: &mut PathLight, missed: bool, #[comptime] keep: bool) {
    if missed && walk.limit > 0.0 {
        light.seen.radiance += walk.light;
        if keep {
            if walk.purpose == TO_EMITTER {
                walk.bits |= SAW_EMITTER;
            } else if walk.purpose == TO_EMITTERS_ALONG {
                walk.bits |= walk.bit;
            } else if walk.purpose == TO_MAP {
                walk.bits |= SAW_MAP;
            } else {
                walk.bits |= SAW_MAP_ALONG;
            }
        }
    }
    if walk.purpose == TO_EMITTERS_ALONG {
        // The last bit stands for all further emitters; no light hides behind so many others.
        if walk.bit < (1u32 << MAX_BIT_ALONG) {
            walk.bit *= 2;
        }
    } else {
        walk.purpose += 1;
    }
}

/// Computes the surface point that the path's ray hit.
#[cube]
fn arrive(
    scene: &Scene,
    path: &Beginning,
    start: &Start,
    hit: &Hit,
    walk: &mut Walk,
    light: &mut PathLight,
    #[comptime] beside: bool,
) {
    let near = walk.origin + walk.direction * hit.t;
    let mut distance = hit.t;
    let mut emits = true;
    if beside {
        if walk.purpose == OF_CAMERA {
            distance = start.at.distance;
            emits = start.emits;
        }
    }
    let mut point = point_at(
        scene,
        hit.triangle,
        near,
        distance,
        walk.direction,
        path.time,
    );
    if walk.purpose == OF_CAMERA {
        if beside {
            point.shading.pair = start.pair;
            point.shading.paired = start.paired;
            point.shading.mirrored = start.mirrored;
        }
        if emits {
            light.seen.radiance += emitted(scene, &point);
        }
        light.see(scene, &point, distance);
    } else {
        walk.bounce += 1;
    }
    walk.point = point;
}

/// Stores the point that the path reached, and the bits of lights visible from the point before.
#[cube]
fn keep_arrival(records: &mut [u32], room: Room, hit: &Hit, walk: &mut Walk, points: u32) {
    if points > 0 {
        records[room.at(points - 1, OF_BITS)] = walk.bits;
    }
    let arrival = Arrival {
        triangle: hit.triangle,
        distance: hit.t,
        origin: walk.origin,
        incoming: walk.direction,
        throughput: walk.throughput,
    };
    room.keep_arrival(records, points, &arrival);
    walk.bits = 0u32;
    walk.bit = SAW_ALONG;
}

/// Prepares the choice of an emitter at the path's point, and samples the BSDF direction.
#[cube]
fn look_around(scene: &Scene, memory: &mut Memory, path: &Beginning, walk: &mut Walk) {
    walk.emitter = walk.next_emitter;
    walk.waits = false;
    walk.next = 0u32;
    walk.purpose = TO_EMITTER;
    if !walk.point.reflects || comptime!(scene.features.dark) {
        walk.purpose = ENDED;
    } else {
        let cone = path.cone(scene, walk.bounce);
        walk.cone.u = cone.z;
        walk.cone.v = cone.w;
        if comptime!(scene.features.emitters) {
            let at = receiver_of(&walk.point, path.time);
            walk.share = emitters_of(scene).look(&at, memory.choice.as_mut_slice());
        }
    }
    let goes_on = walk.bounce < scene.bounces || comptime!(scene.features.sees_sky);
    if goes_on || walk.looks_along(scene) || comptime!(scene.features.gathers_map) {
        let drawn = path.direction(scene, walk.bounce);
        let mut lobe = 0.0f32;
        if walk.point.shading.glossy {
            lobe = path.choices(scene, walk.bounce).x;
        }
        walk.scatter = walk.point.shading.sample(drawn.x, drawn.y, lobe);
        walk.next_emitter = v2(drawn.z, drawn.w);
    }
}

/// Returns the next emitter to which the path's point is connected, if there is one.
#[cube]
fn next_emitter(
    scene: &Scene,
    memory: &mut Memory,
    path: &Beginning,
    walk: &mut Walk,
) -> EmitterPlace {
    let emitters = emitters_of(scene);
    let at = receiver_of(&walk.point, path.time);
    let choice = memory.choice.as_mut_slice();
    let mut place = EmitterPlace::none();
    if walk.purpose == TO_EMITTER {
        let drawn = walk.emitter;
        place = emitters.choose_place(drawn.x, drawn.y, &at, walk.share, choice);
    } else if walk.looks_along(scene) {
        let way = walk.scatter.direction;
        place = emitters.place_along(walk.next, way, &at, walk.share, choice);
        walk.next = place.emitter + 1;
    }
    place
}

/// Sets the shadow ray to the next light. If no lights remain, the path continues.
#[cube]
fn connect(scene: &Scene, memory: &mut Memory, path: &Beginning, walk: &mut Walk) {
    let mut place = EmitterPlace::none();
    let mut target = Target::none();
    let mut chance = 1.0f32;
    if walk.purpose == TO_EMITTER || walk.purpose == TO_EMITTERS_ALONG {
        if comptime!(scene.features.emitters) {
            place = next_emitter(scene, memory, path, walk);
            if place.emitter == NONE {
                walk.purpose = TO_MAP;
            } else {
                let combined = walk.looks_along(scene);
                let x = walk.point.position;
                chance = place.chance;
                target = target_of(scene, place.emitter, place.weights, x, path.time, combined);
            }
        } else {
            walk.purpose = TO_MAP;
        }
    }
    if walk.purpose == TO_MAP || walk.purpose == TO_MAP_ALONG {
        if comptime!(scene.features.gathers_map) {
            let mut towards = walk.scatter.direction;
            if walk.purpose == TO_MAP {
                let drawn = path.choices(scene, walk.bounce);
                towards = map_of(scene).choose(scene.sky_density, drawn.z, drawn.w);
            }
            chance = map_of(scene).density(scene.sky_density, towards);
            target = Target::of_map(towards);
        } else {
            walk.purpose = ONWARDS;
        }
    }
    let mut chosen = no_connection(walk.point.position);
    if comptime!(scene.features.emitters || scene.features.gathers_map) {
        let along = walk.purpose == TO_EMITTERS_ALONG || walk.purpose == TO_MAP_ALONG;
        let x = walk.point.position;
        chosen = target.connect(&walk.point.shading, x, chance, along, walk.cone);
        if chosen.limit > 0.0 {
            if walk.purpose < TO_MAP {
                if comptime!(scene.features.emitters) {
                    target.radiance =
                        radiance_of(scene, place.emitter, place.weights, target.facing());
                }
            } else if comptime!(scene.features.gathers_map) {
                target.radiance = sky(scene, target.direction);
            }
        }
        let arrived = chosen.reflected.times(target.radiance) * chosen.scale;
        walk.light = limited(scene, walk.throughput.times(arrived), walk.bounce);
    }
    walk.origin = chosen.start;
    walk.direction = chosen.direction;
    walk.limit = chosen.limit;
    if comptime!(scene.features.gathers_map) {
        if walk.purpose == TO_MAP_ALONG && walk.limit > 0.0 && walk.goes_straight_on(scene) {
            walk.waits = true;
            walk.waiting = walk.light;
            walk.limit = -1.0f32;
        }
    }
}

/// Sets the bounce ray in the sampled direction, or ends the path.
#[cube]
fn go_on(
    scene: &Scene,
    records: &mut [u32],
    room: Room,
    path: &Beginning,
    walk: &mut Walk,
    points: u32,
    #[comptime] keep: bool,
) {
    let mut u = 0.0f32;
    if comptime!(scene.features.roulette) {
        u = path.choices(scene, walk.bounce).y;
    }
    let cone = path.cone(scene, walk.bounce);
    let left = leave(
        scene,
        &walk.point,
        &walk.scatter,
        walk.throughput,
        walk.bounce,
        u,
        cone.x,
        cone.y,
    );
    walk.purpose = select(left.goes_on, ONWARDS, ENDED);
    walk.throughput = left.throughput;
    walk.origin = left.start;
    walk.direction = left.bend.direction;
    walk.limit = f32::MAX;
    if keep {
        if left.goes_on {
            walk.bits |= WENT_ON;
            records[room.at(points - 1, OF_SURVIVAL)] = left.survival.to_bits();
        }
    }
}
