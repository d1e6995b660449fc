//! A path from the camera to its end, in a thread of a GPU.
//!
//! Each turn of the loop traces the ray to the next point, connects the point to lights by shadow rays, and makes the
//! bounce ray. So a point is not kept from one turn to the next.

use softray_kernels::cube::*;

use super::camera::{Beginning, begin};
use super::gather::gather;
use super::hit::{Memory, trace};
use super::records::{Arrival, ESCAPED, OF_BITS, OF_SURVIVAL, Room, SAW_MAP_ALONG, WENT_ON};
use super::walk::{PathLight, PathVertex, Start, Walk, may_look_along};
use softray_kernels::accel::Hit;
use softray_kernels::model::{splat, v2};
use softray_kernels::trace::{Faces, NONE, Scene, emitted, leave, limited, point_at, sky};

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
    walk.throughput = splat(1.0);
    walk.origin = path.ray.origin;
    walk.direction = path.ray.direction;
    walk.next_emitter = v2(path.film.z, path.film.w);
    if beside {
        walk.bounce = start.bounce;
        walk.origin = start.at.near;
        walk.direction = start.at.direction;
    }
    let mut is_first = true;
    let mut goes_on = true;
    while goes_on {
        // After the last bounce, a ray only tests whether it reaches the environment.
        let mut is_last = false;
        if comptime!(scene.features.sees_sky) {
            is_last = !is_first && walk.bounce >= scene.bounces;
        }
        let mut hit = Hit {
            t: 0.0f32,
            triangle: NONE,
        };
        if beside {
            hit.triangle = start.at.triangle;
        }
        if !is_first || !beside {
            let ray = walk.ray(path.time);
            hit = trace(scene, memory, ray, Faces::default(), is_last, false, false);
            light.rays += 1;
            light.looked += select(is_last, 0u32, 1u32);
        }
        let missed = hit.triangle == NONE;
        if missed {
            escape(scene, records, room, &walk, &mut light, is_first, keep);
        }
        goes_on = !missed && !is_last;
        if goes_on {
            let mut vertex = arrive(
                scene, &path, &start, &hit, &mut walk, &mut light, is_first, beside,
            );
            if keep {
                keep_arrival(records, room, &hit, &walk, light.points);
            }
            light.points += 1;
            if comptime!(may_look_along(&scene.features)) {
                if vertex.reflects {
                    sample_direction(scene, &path, &mut walk, &mut vertex);
                }
            }
            gather(
                scene,
                memory,
                &path,
                &mut walk,
                &mut vertex,
                &mut light,
                keep,
            );
            goes_on = vertex.reflects
                && (walk.bounce < scene.bounces || comptime!(scene.features.sees_sky));
            if goes_on {
                goes_on = go_on(scene, &path, &mut walk, &mut vertex);
            }
            if keep {
                let own = light.points - 1;
                records[room.at(own, OF_BITS)] = vertex.bits;
                records[room.at(own, OF_SURVIVAL)] = vertex.survival.to_bits();
            }
        }
        is_first = false;
    }
    light
}

/// Adds the light of the environment that a path's ray reaches, and stores its bits for the point before.
#[cube]
fn escape(
    scene: &Scene,
    records: &mut [u32],
    room: Room,
    walk: &Walk,
    light: &mut PathLight,
    is_first: bool,
    #[comptime] keep: bool,
) {
    let mut bits = 0u32;
    // If surfaces gather the light of the map, escaping bounce rays add only the waiting light.
    if is_first || comptime!(scene.features.sees_sky) {
        bits |= ESCAPED;
        let sky = walk.throughput.times(sky(scene, walk.direction));
        light.seen.radiance += limited(scene, sky, walk.bounce);
    }
    if comptime!(scene.features.gathers_map) {
        if walk.waits {
            bits |= SAW_MAP_ALONG;
            light.seen.radiance += walk.waiting;
        }
    }
    if keep {
        if light.points > 0 {
            records[room.at(light.points - 1, OF_BITS)] |= bits;
        }
    }
}

/// Returns the surface point that the path's ray hit. Counts the bounce, and for the first point adds the emission and
/// what is seen.
#[cube]
fn arrive(
    scene: &Scene,
    path: &Beginning,
    start: &Start,
    hit: &Hit,
    walk: &mut Walk,
    light: &mut PathLight,
    is_first: bool,
    #[comptime] beside: bool,
) -> PathVertex {
    let near = walk.origin + walk.direction * hit.t;
    let mut distance = hit.t;
    let mut emits = true;
    if beside {
        if is_first {
            distance = start.at.distance;
            emits = start.emits;
        }
    }
    if !is_first {
        walk.bounce += 1;
    }
    let mut vertex = PathVertex::default();
    vertex.point = point_at(
        scene,
        hit.triangle,
        near,
        distance,
        walk.direction,
        path.time,
        walk.bounce,
    );
    vertex.reflects = vertex.point.reflects && comptime!(!scene.features.dark);
    vertex.emitter = walk.next_emitter;
    walk.waits = false;
    if is_first {
        if beside {
            vertex.point.shading.pair = start.pair;
            vertex.point.shading.paired = start.paired;
            vertex.point.shading.mirrored = start.mirrored;
        }
        if emits {
            light.seen.radiance += emitted(scene, &vertex.point);
        }
        light.see(scene, &vertex.point, distance);
    }
    vertex
}

/// Stores the point that the path reached.
#[cube]
fn keep_arrival(records: &mut [u32], room: Room, hit: &Hit, walk: &Walk, points: u32) {
    let arrival = Arrival {
        triangle: hit.triangle,
        distance: hit.t,
        origin: walk.origin,
        incoming: walk.direction,
        throughput: walk.throughput,
    };
    room.keep_arrival(records, points, &arrival);
}

/// Samples the BSDF direction at a point, and the numbers for the emitter of the next point.
#[cube]
fn sample_direction(scene: &Scene, path: &Beginning, walk: &mut Walk, vertex: &mut PathVertex) {
    let drawn = path.direction(scene, walk.bounce);
    let mut lobe = 0.0f32;
    if comptime!(scene.features.glossy) {
        if vertex.point.shading.glossy {
            lobe = path.choices(scene, walk.bounce).x;
        }
    }
    vertex.scatter = vertex.point.shading.sample(drawn.x, drawn.y, lobe);
    walk.next_emitter = v2(drawn.z, drawn.w);
}

/// Makes the bounce ray in the sampled direction. Returns whether the path goes on.
#[cube]
fn go_on(scene: &Scene, path: &Beginning, walk: &mut Walk, vertex: &mut PathVertex) -> bool {
    if comptime!(!may_look_along(&scene.features)) {
        sample_direction(scene, path, walk, vertex);
    }
    let mut u = 0.0f32;
    if comptime!(scene.features.roulette) {
        u = path.choices(scene, walk.bounce).y;
    }
    let left = leave(
        scene,
        &vertex.point,
        &vertex.scatter,
        walk.throughput,
        walk.bounce,
        u,
        vertex.cones.x,
        vertex.cones.y,
    );
    walk.throughput = left.throughput;
    walk.origin = left.start;
    walk.direction = left.bend.direction;
    vertex.survival = left.survival;
    vertex.bits |= select(left.goes_on, comptime!(WENT_ON), 0u32);
    left.goes_on
}
