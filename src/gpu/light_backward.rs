//! Back over light that arrives at a point of a path.

use burn::cubecl::{self, prelude::*};

use super::corners::uv_at;
use super::layout::{EMISSIVE_COUNT, FIRST_SUMS, LIGHT_BITS, WANTED};
use super::light::{delta_light, emitter, is_light, map_of, sky};
use super::reading::Scene;
use super::shadow_rays::target_of;
use super::sums::{AREAS, LIGHTS, OF_LIGHT, TRIANGLES, Totals};
use super::surface::Point;
use super::surface_backward::{PointGradient, add_to_corners, is_wanted, sky_backward};
use super::texture::EMISSION;
use super::texture_backward::{add_to_uvs, colour_backward};
use crate::model::connection::Target;
use crate::model::delta_light::DeltaGradient;
use crate::model::emitter::LightPoint;
use crate::model::{V2, V3, v3};

/// Back over light from a point of an emitter, which stays where it is on it, or from a light without extent; returns
/// the derivative by the throughput.
#[cube]
pub(super) fn light_backward(
    scene: &Scene,
    sums: &Totals,
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
) -> V3 {
    let shading = point.shading;
    let target: Target = target_of(scene, k, weights, point.position, time, combined);
    let reflected = shading.evaluate(target.direction);
    let density = target.divisor(&shading, chance, by_scattering);
    let by_target = target.backward(&shading, reflected, density, g, throughput, &mut by.shading);
    if is_light(scene, k) {
        if comptime!(scene.features.lights) {
            let light = delta_light(scene, k);
            let seen = light.seen_from(point.position);
            let by_light = light.backward(&seen, by_target.angle, by_target.direction);
            by.position -= by_light.position;
            if comptime!(sums.of.lights) {
                add_to_light(scene, sums, k, &by_light, by_target.radiance);
            }
        }
    } else {
        let e = emitter(scene, k, time);
        let corners = v3(1.0 - weights.x - weights.y, weights.x, weights.y);
        if comptime!(sums.of.emission || (sums.of.uvs && scene.features.glows)) {
            let glows = comptime!(scene.features.glows);
            let uv = uv_at(scene, e.triangle, corners, glows);
            let by_uv = colour_backward(
                scene,
                sums,
                e.material,
                EMISSION,
                uv,
                by_target.radiance,
                glows,
                sums.of.emission,
            );
            add_to_uvs(scene, sums, e.triangle, corners, by_uv);
        }
        if comptime!(sums.of.rays) {
            let seen = LightPoint::new(target.place - point.position, e.normal);
            let by_light = seen.backward(e.normal, e.area, by_target.angle, by_target.direction);
            if comptime!(sums.of.objects) {
                if is_wanted(scene, e.object) {
                    let at = scene.header[FIRST_SUMS + AREAS] + e.triangle;
                    sums.add(at, by_light.area, AREAS);
                    let at = scene.header[FIRST_SUMS + TRIANGLES] + 3 * e.triangle;
                    sums.add_vector(at, by_light.normal, TRIANGLES);
                    add_to_corners(
                        scene,
                        sums,
                        e.triangle,
                        e.object,
                        corners,
                        by_light.position,
                        time,
                    );
                }
            }
            by.position -= by_light.position;
        }
    }
    by_target.throughput
}

/// Adds the derivatives by a light without extent, if they are asked for.
#[cube]
pub(super) fn add_to_light(
    scene: &Scene,
    sums: &Totals,
    k: u32,
    by: &DeltaGradient,
    by_strength: V3,
) {
    let i = k - scene.header[EMISSIVE_COUNT];
    if scene.words[(scene.header[LIGHT_BITS] + i) as usize] & WANTED != 0 {
        let first = scene.header[FIRST_SUMS + LIGHTS] + OF_LIGHT as u32 * i;
        sums.add_vector(first, by.position, LIGHTS);
        sums.add_vector(first + 3, by.axis, LIGHTS);
        sums.add_vector(first + 6, by_strength, LIGHTS);
        sums.add(first + 9, by.cos_inner, LIGHTS);
        sums.add(first + 10, by.cos_outer, LIGHTS);
    }
}

/// Back over light of a map along a direction, which is fixed; returns the derivative by the throughput.
#[cube]
pub(super) fn map_backward(
    scene: &Scene,
    sums: &Totals,
    point: &Point,
    direction: V3,
    by_scattering: bool,
    throughput: V3,
    g: V3,
    by: &mut PointGradient,
) -> V3 {
    let shading = point.shading;
    let chance = map_of(scene).density(scene.floats, direction);
    let mut target = Target::of_map(direction);
    target.radiance = sky(scene, direction);
    let reflected = shading.evaluate(direction);
    let density = target.divisor(&shading, chance, by_scattering);
    let by_target = target.backward(&shading, reflected, density, g, throughput, &mut by.shading);
    if comptime!(sums.of.sky) {
        sky_backward(scene, sums, direction, by_target.radiance);
    }
    by_target.throughput
}
