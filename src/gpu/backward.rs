//! Back along a path that left records, in a thread of a GPU.

use crate::cube::*;

use super::camera::{Beginning, camera};
use super::emitters_along::next_emitter_hit;
use super::records::jumped;
use super::records::{
    ESCAPED, MOST_ALONG, Room, SAW_ALONG, SAW_EMITTER, SAW_MAP, SAW_MAP_ALONG, WENT_ON, kept,
    kept_vector, record_at,
};
use crate::model::bsdf::Scatter;
use crate::model::camera::CameraGradient;
use crate::model::cone::bend;
use crate::model::connection::Target;
use crate::model::triangle::uniform_point;
use crate::model::{splat, v2};
use crate::sampling::{Chosen, Dimensions, Receiver};
use crate::trace::{
    Arrived, CONE, EMITS, NONE, Point, RayGradient, Scene, Seen, Sums, density_of_map,
    emission_backward, emitters_of, glows, leave_backward, light_backward, map_backward, map_of,
    middle_of, no_point_gradient, point_at, point_backward, receiver_of, sky_backward, target_of,
};

/// Light of a target that was drawn with a density, or found by scattering.
#[cube]
fn arrived(point: &Point, target: &Target, chance: f32, by_scattering: bool) -> Arrived {
    Arrived {
        reflected: point.shading.evaluate(target.direction),
        density: target.divisor(&point.shading, chance, by_scattering),
    }
}

/// Back along a path: adds the derivatives of the light that it brought, times `upstream`.
#[cube]
pub(super) fn path_backward(
    scene: &Scene,
    records: &mut [u32],
    choice: &mut [u32],
    sums: &Sums,
    room: Room,
    path: Beginning,
    pixel: u32,
    points: u32,
    upstream: Seen,
    by_camera: &mut CameraGradient,
) {
    let g = upstream.radiance;
    let numbers = path.numbers;
    let time = path.time;
    let mut by_throughput = splat(0.0);
    let mut by_ray = RayGradient {
        origin: splat(0.0),
        direction: splat(0.0),
    };
    if points == 0 {
        by_ray.direction = sky_backward(scene, sums, path.ray.direction, g);
    }
    let mut left = points;
    while left > 0 {
        left -= 1;
        let i = left;
        let triangle = records[record_at(room, i, 0u32)];
        let distance = kept(records, room, i, 1u32);
        let origin = kept_vector(records, room, i, 2u32);
        let incoming = kept_vector(records, room, i, 5u32);
        let throughput = kept_vector(records, room, i, 8u32);
        let bits = records[record_at(room, i, 11u32)];
        let near = origin + incoming * distance;
        let point = point_at(scene, triangle, near, distance, incoming, time);
        let mut by = no_point_gradient();
        let mut by_before = splat(0.0);
        // The way on, and the light that it ended in.
        let mut drawn = path.film;
        let mut choices = path.film;
        let mut scatter = Scatter {
            direction: splat(0.0),
            weight: splat(0.0),
            local: splat(0.0),
            of_gloss: false,
            u: 0.0f32,
            v: 0.0f32,
        };
        if bits != 0 {
            drawn = numbers.draw(scene.points, Dimensions::direction(i));
            if comptime!(scene.features.glossy || scene.features.gathers_map) {
                choices = numbers.draw(scene.points, Dimensions::choices(i));
            }
            scatter = point.shading.sample(drawn.x, drawn.y, choices.x);
        }
        if bits & WENT_ON != 0 {
            let survival = kept(records, room, i, 12u32);
            let mut cone_u = 0.0f32;
            let mut cone_v = 0.0f32;
            if comptime!(scene.features.cones) {
                let set = path.cones.draw(scene.points, Dimensions::of_set(i));
                cone_u = set.x;
                cone_v = set.y;
            }
            let tangent = scene.settings[CONE];
            let outer = point.shading.outer(scatter.direction);
            let bent = bend(scatter.direction, outer, tangent, cone_u, cone_v);
            by_before += leave_backward(
                scene,
                sums,
                &point,
                &scatter,
                &bent,
                survival,
                bits & ESCAPED != 0,
                throughput,
                by_throughput,
                by_ray,
                g,
                &mut by,
            );
        }
        // Light that arrived.
        if comptime!(scene.features.emitters) {
            let seen_along = (bits >> 1) & ((1u32 << MOST_ALONG) - 1);
            if bits & SAW_EMITTER != 0 || seen_along != 0 {
                let x = point.position;
                let at: Receiver = receiver_of(&point, time);
                let emitters = emitters_of(scene);
                let share = emitters.look(&at, choice);
                let combined = comptime!(scene.features.combined) && point.shading.glossy;
                let mut next = 0u32;
                let mut bit = SAW_EMITTER.runtime();
                // The emitter that was drawn, then those along the way on.
                while bit < (2u32 << MOST_ALONG) && next != NONE {
                    let along = bit >= SAW_ALONG;
                    let mut k = 0u32;
                    let mut weights = v2(0.0, 0.0);
                    let mut p = 1.0f32;
                    if along {
                        let way = scatter.direction;
                        let found = next_emitter_hit(scene, next, x, way, time);
                        k = found.emitter;
                        weights = found.weights;
                        next = k;
                        if k != NONE {
                            next = k + 1;
                            p = emitters.chance(k, &at, share, choice);
                        }
                    } else {
                        let mut u = path.film.z;
                        let mut v = path.film.w;
                        if i > 0 {
                            let before = numbers.draw(scene.points, Dimensions::direction(i - 1));
                            u = before.z;
                            v = before.w;
                        }
                        let drawn: Chosen = emitters.choose(u, &at, share, choice);
                        k = drawn.emitter;
                        p = drawn.chance;
                        weights = uniform_point(drawn.rest, v);
                    }
                    if k != NONE && bits & bit != 0 {
                        let target: Target = target_of(scene, k, weights, x, time, combined);
                        let arrived: Arrived = arrived(&point, &target, p, along);
                        by_before += light_backward(
                            scene, sums, &point, k, weights, target, arrived, throughput, time, g,
                            &mut by,
                        );
                    }
                    bit *= 2;
                    if seen_along == 0 {
                        next = NONE;
                    }
                }
            }
        }
        if comptime!(scene.features.gathers_map) {
            let mut bit = SAW_MAP.runtime();
            while bit <= SAW_MAP_ALONG {
                if bits & bit != 0 {
                    let along = bit == SAW_MAP_ALONG;
                    let mut towards = scatter.direction;
                    if !along {
                        towards = map_of(scene).choose(scene.sky_density, choices.z, choices.w);
                    }
                    let target = Target::of_map(towards);
                    let p = density_of_map(scene, towards);
                    let arrived: Arrived = arrived(&point, &target, p, along);
                    by_before +=
                        map_backward(scene, sums, &point, target, arrived, throughput, g, &mut by);
                }
                bit *= 2;
            }
        }
        by_throughput = by_before;
        if comptime!(sums.of.jumps) {
            jumped(scene.bounces, records, room, i, &mut by);
        }
        let mut by_t = 0.0f32;
        if i == 0 {
            by_t = upstream.depth;
            by.geometric += upstream.normal;
            if point.side > 0.0 && scene.bits_of(point.material) & EMITS != 0 {
                if glows(scene, point.material) {
                    by.emission = g;
                } else {
                    emission_backward(scene, sums, point.material, point.uv, g);
                }
            }
        }
        by_ray = point_backward(scene, sums, &point, time, &by, by_t);
    }
    if comptime!(sums.of.camera) {
        camera(scene).ray_backward(
            &path.ray,
            middle_of(scene, pixel),
            by_ray.origin,
            by_ray.direction,
            by_camera,
        );
    }
}
