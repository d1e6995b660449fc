//! Back along a path that left records: `kernel/backward` in a kernel of a GPU.

use crate::cube::*;

use super::camera::{Beginning, camera, middle_of};
use super::emitter_choice::{chance, choose, next_emitter_hit, site};
use super::layout::{CONE, EMITS, FIRST_SUMS, NONE, OF_MATERIAL, OF_MATERIALS};
use super::light::Site;
use super::light::{map_of, sky};
use super::light_backward::{light_backward, map_backward};
use super::reading::Scene;
use super::records::jumped;
use super::records::{
    ESCAPED, MOST_ALONG, Room, SAW_ALONG, SAW_EMITTER, SAW_MAP, SAW_MAP_ALONG, WENT_ON, kept,
    kept_vector, record_at,
};
use super::sums::{CAMERA, MATERIALS, Totals};
use super::surface::point_at;
use super::surface_backward::{no_point_gradient, point_backward, sky_backward};
use super::texture::{EMISSION, texture_of};
use crate::model::bsdf::Scatter;
use crate::model::camera::CameraGradient;
use crate::model::cone::{bend, bend_backward};
use crate::model::triangle::uniform_point;
use crate::model::{Pair, V3, splat, v2};
use crate::sampling::Dimensions;

/// Derivatives of a loss by what a pixel's rays bring back.
#[apply(record!)]
pub(super) struct Upstream {
    pub radiance: V3,
    pub opacity: f32,
    pub depth: f32,
    pub normal: V3,
}

#[cube]
pub(super) fn no_camera_gradient() -> CameraGradient {
    let zero = splat(0.0f32.runtime());
    CameraGradient {
        eye: zero,
        across: zero,
        upward: zero,
        forward: zero,
        lens: Pair {
            first: zero,
            second: zero,
        },
        per_focus: 0.0f32.runtime(),
        filter: 0.0f32.runtime(),
    }
}

/// Adds the derivatives by the camera of some paths.
#[cube]
pub(super) fn add_camera(scene: &Scene, sums: &Totals, g: &CameraGradient) {
    let first = scene.header[FIRST_SUMS + CAMERA];
    sums.add_vector(first, g.eye, CAMERA);
    sums.add_vector(first + 3, g.across, CAMERA);
    sums.add_vector(first + 6, g.upward, CAMERA);
    sums.add_vector(first + 9, g.forward, CAMERA);
    sums.add_vector(first + 12, g.lens.first, CAMERA);
    sums.add_vector(first + 15, g.lens.second, CAMERA);
    sums.add(first + 18, g.per_focus, CAMERA);
    sums.add(first + 19, g.filter, CAMERA);
}

/// Back along a path: adds the derivatives of the light that it brought, times `upstream`.
#[cube]
pub(super) fn path_backward(
    scene: &Scene,
    records: &mut [u32],
    sums: &Totals,
    room: Room,
    path: Beginning,
    pixel: u32,
    points: u32,
    upstream: Upstream,
    by_camera: &mut CameraGradient,
) {
    let g = upstream.radiance;
    let numbers = path.numbers;
    let time = path.time;
    let mut by_throughput = splat(0.0);
    let mut by_origin = splat(0.0);
    let mut by_direction = splat(0.0);
    if points == 0 {
        by_direction = sky_backward(scene, sums, path.ray.direction, g);
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
        let point = point_at(scene, triangle, near, incoming, time);
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
            let geometric = point.shading.geometric;
            let outer = point.shading.outer(scatter.direction);
            let bent = bend(scatter.direction, outer, tangent, cone_u, cone_v);
            by.position += by_origin;
            let mut by_leaving = by_direction;
            let mut by_after = by_throughput;
            if bits & ESCAPED != 0 {
                let after = throughput.times(scatter.weight) * (1.0 / survival);
                by_after += g.times(sky(scene, bent.direction));
                let towards = bent.direction;
                by_leaving += sky_backward(scene, sums, towards, g.times(after));
            }
            let by_survivor = by_after * (1.0 / survival);
            by_before += by_survivor.times(scatter.weight);
            let by_axis = bend_backward(
                &bent,
                scatter.direction,
                geometric,
                by_leaving,
                &mut by.geometric,
            );
            let by_weight = by_survivor.times(throughput);
            point
                .shading
                .sample_backward(&scatter, by_weight, by_axis, &mut by.shading);
        }
        // Light that arrived.
        if comptime!(scene.features.emitters) {
            let seen_along = (bits >> 1) & ((1u32 << MOST_ALONG) - 1);
            if bits & SAW_EMITTER != 0 || seen_along != 0 {
                let x = point.position;
                let normal = point.shading.geometric;
                let at: Site = site(scene, x, normal, time);
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
                            p = chance(scene, k, &at);
                        }
                    } else {
                        let mut u = path.film.z;
                        let mut v = path.film.w;
                        if i > 0 {
                            let before = numbers.draw(scene.points, Dimensions::direction(i - 1));
                            u = before.z;
                            v = before.w;
                        }
                        let choice = choose(scene, u, &at);
                        k = choice.emitter;
                        p = choice.chance;
                        weights = uniform_point(choice.rest, v);
                    }
                    if k != NONE && bits & bit != 0 {
                        by_before += light_backward(
                            scene, sums, &point, k, weights, p, combined, along, throughput, time,
                            g, &mut by,
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
                        towards = map_of(scene).choose(scene.floats, choices.z, choices.w);
                    }
                    by_before +=
                        map_backward(scene, sums, &point, towards, along, throughput, g, &mut by);
                }
                bit *= 2;
            }
        }
        by_throughput = by_before;
        if comptime!(sums.of.jumps) {
            jumped(scene.header, records, room, i, &mut by);
        }
        let mut by_t = 0.0f32;
        if i == 0 {
            by_t = upstream.depth;
            by.geometric += upstream.normal;
            let row = (scene.header[OF_MATERIALS] + OF_MATERIAL as u32 * point.material) as usize;
            if point.side > 0.0 && scene.words[row] & EMITS != 0 {
                let mut constant = true;
                if comptime!(scene.features.glows) {
                    if scene.words[texture_of(scene, point.material, EMISSION)] != NONE {
                        constant = false;
                        by.emission = g;
                    }
                }
                if comptime!(sums.of.emission) {
                    if constant {
                        let at = scene.header[FIRST_SUMS + MATERIALS] + 12 * point.material + 9;
                        sums.add_vector(at, g, MATERIALS);
                    }
                }
            }
        }
        let by_ray = point_backward(scene, sums, &point, distance, time, &by, by_t);
        by_origin = by_ray.origin;
        by_direction = by_ray.direction;
    }
    if comptime!(sums.of.camera) {
        camera(scene).ray_backward(
            &path.ray,
            middle_of(scene, pixel),
            by_origin,
            by_direction,
            by_camera,
        );
    }
}
