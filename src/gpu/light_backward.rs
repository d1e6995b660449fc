//! Back over light that arrives at a point of a path: `kernel/backward` and `kernel/delta_lights` in a kernel of a GPU.

use burn::cubecl::{self, prelude::*};

use super::corners::uv_at;
use super::layout::{EMISSIVE_COUNT, FIRST_SUMS, LIGHT_BITS, WANTED};
use super::light::{delta_light, density_of_direction, emitter, sky};
use super::shadow_rays::{Target, target_of};
use super::sums::{AREAS, LIGHTS, OF_LIGHT, TRIANGLES, add, add_vector};
use super::surface::Point;
use super::surface_backward::{PointGradient, add_to_corners, is_wanted, sky_backward};
use super::texture::EMISSION;
use super::texture_backward::{add_to_uvs, colour_backward};
use super::{Derivatives, Features};
use crate::model::delta_light::DeltaGradient;
use crate::model::emitter::{LightPoint, power_heuristic};
use crate::model::{V2, V3, v3};

/// Back over light from a point of an emitter, which stays where it is on it, or from a light without extent; returns
/// the derivative by the throughput.
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
    let target: Target = target_of(floats, words, k, weights, point.position, time, features);
    let direction = target.direction;
    let reflected = point.shading.evaluate(direction);
    let mut density = chance;
    if combined && !target.is_light {
        let other = point.shading.density(direction) * target.angle;
        density = power_heuristic(chance, other, by_scattering);
    }
    let scale = target.angle / density;
    let carried = g.times(throughput);
    let by_reflected = carried.times(target.radiance) * scale;
    let by_direction = point
        .shading
        .evaluate_backward(direction, by_reflected, &mut by.shading);
    let by_angle = carried.times(reflected).dot(target.radiance) / density;
    let by_radiance = carried.times(reflected) * scale;
    if target.is_light {
        if comptime!(features.lights) {
            let light = delta_light(floats, words, k);
            let seen = light.seen_from(point.position);
            let by_light = light.backward(&seen, by_angle, by_direction);
            by.position -= by_light.position;
            if comptime!(of.lights) {
                add_to_light(words, totals, scales, k, &by_light, by_radiance);
            }
        }
    } else {
        let e = emitter(floats, words, k, time, features);
        let corners = v3(1.0 - weights.x - weights.y, weights.x, weights.y);
        if comptime!(of.emission || (of.uvs && features.glows)) {
            let glows = comptime!(features.glows);
            let uv = uv_at(floats, words, e.triangle, corners, glows);
            let by_uv = colour_backward(
                floats,
                words,
                totals,
                scales,
                e.material,
                EMISSION,
                uv,
                by_radiance,
                glows,
                of.emission,
            );
            add_to_uvs(
                words, totals, scales, e.triangle, corners, by_uv, features, of,
            );
        }
        if comptime!(of.rays) {
            let seen = LightPoint::new(target.place - point.position, e.normal);
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
    }
    g.times(reflected).times(target.radiance) * scale
}

/// Adds the derivatives by a light without extent, if they are asked for.
#[cube]
pub(super) fn add_to_light(
    words: &[u32],
    totals: &[Atomic<u32>],
    scales: &[f32],
    k: u32,
    by: &DeltaGradient,
    by_strength: V3,
) {
    let i = k - words[EMISSIVE_COUNT];
    if words[(words[LIGHT_BITS] + i) as usize] & WANTED != 0 {
        let first = words[FIRST_SUMS + LIGHTS] + OF_LIGHT as u32 * i;
        add_vector(totals, scales, first, by.position, LIGHTS);
        add_vector(totals, scales, first + 3, by.axis, LIGHTS);
        add_vector(totals, scales, first + 6, by_strength, LIGHTS);
        add(totals, scales, first + 9, by.cos_inner, LIGHTS);
        add(totals, scales, first + 10, by.cos_outer, LIGHTS);
    }
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
