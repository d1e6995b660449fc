//! Back along a path that left records: `kernel/backward` in a kernel of a GPU.

use burn::cubecl::{self, prelude::*};

use super::camera::{Beginning, camera};
use super::layout::{CONE, EMITS, FIRST_SUMS, NONE, OF_MATERIAL, OF_MATERIALS};
use super::light::{
    all_seen_from, chance, choose, choose_direction, density_of_direction, emitter,
    next_emitter_hit, sky,
};
use super::records::jumped;
use super::records::{
    ESCAPED, MOST_ALONG, Room, SAW_ALONG, SAW_EMITTER, SAW_MAP, SAW_MAP_ALONG, WENT_ON, kept,
    kept_vector, record_at,
};
use super::sums::{AREAS, CAMERA, MATERIALS, TRIANGLES, add, add_vector};
use super::surface::{Point, point_at};
use super::surface_backward::{
    PointGradient, add_to_corners, is_wanted, no_point_gradient, point_backward, sky_backward,
};
use super::{Derivatives, Features};
use crate::model::bsdf::Scatter;
use crate::model::camera::CameraGradient;
use crate::model::cone::{bend, bend_backward};
use crate::model::emitter::{LightPoint, power_heuristic};
use crate::model::{Pair, V2, V3, splat, v2, v3};

/// Derivatives of a loss by what a pixel's rays bring back.
#[derive(CubeType, CubeTypeMut, Clone, Copy, Debug)]
#[expand(derive(Clone, Copy))]
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
    }
}

/// Adds the derivatives by the camera of some paths.
#[cube]
pub(super) fn add_camera(
    words: &[u32],
    totals: &[Atomic<u32>],
    scales: &[f32],
    g: &CameraGradient,
) {
    let first = words[FIRST_SUMS + CAMERA];
    add_vector(totals, scales, first, g.eye, CAMERA);
    add_vector(totals, scales, first + 3, g.across, CAMERA);
    add_vector(totals, scales, first + 6, g.upward, CAMERA);
    add_vector(totals, scales, first + 9, g.forward, CAMERA);
    add_vector(totals, scales, first + 12, g.lens.first, CAMERA);
    add_vector(totals, scales, first + 15, g.lens.second, CAMERA);
    add(totals, scales, first + 18, g.per_focus, CAMERA);
}

/// Back over light from a point of an emitter, which stays where it is on it; returns the derivative by the
/// throughput.
#[cube]
pub(super) fn light_backward(
    floats: &[f32],
    words: &[u32],
    totals: &[Atomic<u32>],
    scales: &[f32],
    point: &Point,
    k: u32,
    weights: V2,
    chance: f32,
    combined: bool,
    by_scattering: bool,
    throughput: V3,
    time: f32,
    g: V3,
    by: &mut PointGradient,
    #[comptime] features: Features,
    #[comptime] of: Derivatives,
) -> V3 {
    let e = emitter(floats, words, k, time, features);
    let corners = v3(1.0 - weights.x - weights.y, weights.x, weights.y);
    let light = e.a * corners.x + e.b * corners.y + e.c * corners.z;
    let seen = LightPoint::new(light - point.position, e.normal);
    let direction = seen.direction;
    let angle = seen.solid_angle(e.area);
    let reflected = point.shading.evaluate(direction);
    let mut density = chance;
    if combined {
        let other = point.shading.density(direction) * angle;
        density = power_heuristic(chance, other, by_scattering);
    }
    let scale = angle / density;
    let carried = g.times(throughput);
    if comptime!(of.emission) {
        let at = words[FIRST_SUMS + MATERIALS] + 12 * e.material + 9;
        let by_emission = carried.times(reflected) * scale;
        add_vector(totals, scales, at, by_emission, MATERIALS);
    }
    let by_reflected = carried.times(e.emission) * scale;
    let by_direction = point
        .shading
        .evaluate_backward(direction, by_reflected, &mut by.shading);
    if comptime!(of.rays) {
        let by_angle = carried.times(reflected).dot(e.emission) / density;
        let by_light = seen.backward(e.normal, e.area, by_angle, by_direction);
        if comptime!(of.objects) {
            if is_wanted(words, e.object) {
                let at = words[FIRST_SUMS + AREAS] + e.triangle;
                add(totals, scales, at, by_light.area, AREAS);
                let at = words[FIRST_SUMS + TRIANGLES] + 3 * e.triangle;
                add_vector(totals, scales, at, by_light.normal, TRIANGLES);
                add_to_corners(
                    words,
                    totals,
                    scales,
                    e.triangle,
                    e.object,
                    corners,
                    by_light.position,
                    time,
                    of,
                );
            }
        }
        by.position -= by_light.position;
    }
    g.times(reflected).times(e.emission) * scale
}

/// Back over light of a map along a direction, which is fixed; returns the derivative by the throughput.
#[cube]
pub(super) fn map_backward(
    floats: &[f32],
    words: &[u32],
    totals: &[Atomic<u32>],
    scales: &[f32],
    point: &Point,
    direction: V3,
    by_scattering: bool,
    throughput: V3,
    g: V3,
    by: &mut PointGradient,
    #[comptime] features: Features,
    #[comptime] of: Derivatives,
) -> V3 {
    let shading = point.shading;
    let chance = density_of_direction(floats, words, direction);
    let density = power_heuristic(chance, shading.density(direction), by_scattering);
    let reflected = shading.evaluate(direction);
    let radiance = sky(floats, words, direction, features);
    let scale = 1.0 / density;
    let carried = g.times(throughput) * scale;
    if comptime!(of.sky) {
        let by_sky = carried.times(reflected);
        sky_backward(
            floats, words, totals, scales, direction, by_sky, features, of,
        );
    }
    shading.evaluate_backward(direction, carried.times(radiance), &mut by.shading);
    g.times(reflected).times(radiance) * scale
}

/// Back along a path: adds the derivatives of the light that it brought, times `upstream`.
#[cube]
pub(super) fn path_backward(
    floats: &[f32],
    words: &[u32],
    records: &mut [u32],
    totals: &[Atomic<u32>],
    scales: &[f32],
    room: Room,
    path: Beginning,
    points: u32,
    upstream: Upstream,
    by_camera: &mut CameraGradient,
    #[comptime] features: Features,
    #[comptime] of: Derivatives,
) {
    let g = upstream.radiance;
    let numbers = path.numbers;
    let time = path.time;
    let mut by_throughput = splat(0.0);
    let mut by_origin = splat(0.0);
    let mut by_direction = splat(0.0);
    if points == 0 {
        by_direction = sky_backward(
            floats,
            words,
            totals,
            scales,
            path.ray.direction,
            g,
            features,
            of,
        );
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
        let point = point_at(floats, words, triangle, near, incoming, time, features);
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
            drawn = numbers.direction(words, i, features.sobol);
            if comptime!(features.glossy || features.gathers_map) {
                choices = numbers.choices(words, i, features.sobol);
            }
            scatter = point.shading.sample(drawn.x, drawn.y, choices.x);
        }
        if bits & WENT_ON != 0 {
            let survival = kept(records, room, i, 12u32);
            let mut cone_u = 0.0f32;
            let mut cone_v = 0.0f32;
            if comptime!(features.cones) {
                let set = path.cones.set(words, i, features.sobol);
                cone_u = set.x;
                cone_v = set.y;
            }
            let tangent = floats[CONE];
            let geometric = point.shading.geometric;
            let outer = point.shading.outer(scatter.direction);
            let bent = bend(scatter.direction, outer, tangent, cone_u, cone_v);
            by.position += by_origin;
            let mut by_leaving = by_direction;
            let mut by_after = by_throughput;
            if bits & ESCAPED != 0 {
                let after = throughput.times(scatter.weight) * (1.0 / survival);
                by_after += g.times(sky(floats, words, bent.direction, features));
                let towards = bent.direction;
                by_leaving += sky_backward(
                    floats,
                    words,
                    totals,
                    scales,
                    towards,
                    g.times(after),
                    features,
                    of,
                );
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
        if comptime!(features.emitters) {
            let seen_along = (bits >> 1) & ((1u32 << MOST_ALONG) - 1);
            if bits & SAW_EMITTER != 0 || seen_along != 0 {
                let x = point.position;
                let sum = all_seen_from(floats, words, x, time, features);
                let combined = comptime!(features.combined) && point.shading.glossy;
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
                        let found = next_emitter_hit(floats, words, next, x, way, time, features);
                        k = found.emitter;
                        weights = found.weights;
                        next = k;
                        if k != NONE {
                            next = k + 1;
                            p = chance(floats, words, k, x, time, sum, features);
                        }
                    } else {
                        let mut u = path.film.z;
                        let mut v = path.film.w;
                        if i > 0 {
                            let before = numbers.direction(words, i - 1, features.sobol);
                            u = before.z;
                            v = before.w;
                        }
                        let choice = choose(floats, words, u, x, time, sum, features);
                        let root = choice.rest.sqrt();
                        k = choice.emitter;
                        p = choice.chance;
                        weights = v2(root * (1.0 - v), root * v);
                    }
                    if k != NONE && bits & bit != 0 {
                        by_before += light_backward(
                            floats, words, totals, scales, &point, k, weights, p, combined, along,
                            throughput, time, g, &mut by, features, of,
                        );
                    }
                    bit *= 2;
                    if seen_along == 0 {
                        next = NONE;
                    }
                }
            }
        }
        if comptime!(features.gathers_map) {
            let mut bit = SAW_MAP.runtime();
            while bit <= SAW_MAP_ALONG {
                if bits & bit != 0 {
                    let along = bit == SAW_MAP_ALONG;
                    let mut towards = scatter.direction;
                    if !along {
                        towards = choose_direction(floats, words, choices.z, choices.w);
                    }
                    by_before += map_backward(
                        floats, words, totals, scales, &point, towards, along, throughput, g,
                        &mut by, features, of,
                    );
                }
                bit *= 2;
            }
        }
        by_throughput = by_before;
        if comptime!(of.jumps) {
            jumped(words, records, room, i, &mut by);
        }
        let mut by_t = 0.0f32;
        if i == 0 {
            by_t = upstream.depth;
            by.geometric += upstream.normal;
            if comptime!(of.emission) {
                let row = words[OF_MATERIALS] + OF_MATERIAL as u32 * point.material;
                if point.side > 0.0 && words[row as usize] & EMITS != 0 {
                    let at = words[FIRST_SUMS + MATERIALS] + 12 * point.material + 9;
                    add_vector(totals, scales, at, g, MATERIALS);
                }
            }
        }
        let by_ray = point_backward(
            floats, words, totals, scales, &point, distance, time, &by, by_t, features, of,
        );
        by_origin = by_ray.origin;
        by_direction = by_ray.direction;
    }
    if comptime!(of.camera) {
        camera(floats, features.parallel).ray_backward(
            &path.ray,
            by_origin,
            by_direction,
            by_camera,
        );
    }
}
