//! Connections of surface points to emitters, delta lights and the environment map, and their derivatives.

use crate::cube::*;

use super::parts::{AREAS, TRIANGLES};
use super::scene::{CLAMP, OF_GROUP, Scene};
use super::sums::{Sums, add_to_light};
use super::surface::{Point, PointGradient};
use super::texture::{sky, sky_backward};
use crate::model::bsdf::Turning;
pub use crate::model::connection::Arrived;
use crate::model::connection::Target;
use crate::model::emitter::LightPoint;
use crate::model::{V2, V3, splat, v2, v3};
use crate::sampling::{Chosen, EmitterLists, EmitterTriangle, Fixed, LightTree, Receiver};

/// Returns the lists of emitters of a scene.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn emitters_of<'a>(scene: &Scene<'a>) -> EmitterLists<'a> {
    EmitterLists::<'a> {
        triangles: scene.emitter_triangles,
        triangle_count: scene.emissive_count,
        lights: scene.lights,
        bits: scene.light_bits,
        brightness: scene.brightness,
        tree: LightTree::<'a> {
            branches: scene.light_branches,
            nodes: scene.light_nodes,
            count: scene.light_node_count,
            places: scene.light_places,
            distant: scene.distant,
            distant_count: scene.distant_count,
            sums: scene.distant_sums,
            axes: scene.distant_axes,
            fixed: Fixed::<'a> {
                chances: scene.fixed,
                sums: scene.fixed_sums,
                count: scene.emitter_count,
            },
        },
        kinds: comptime!(scene.features.of_emitters),
    }
}

/// A chosen group of emitters: its index, its first emitter and the one past its last, and its probability.
#[apply(zeroed!)]
pub struct GroupChoice {
    pub group: u32,
    pub first: u32,
    pub past: u32,
    pub chance: f32,
    /// Whether any of its emitters moves.
    pub moves: bool,
}

/// Chooses a group of emitters for a random number. `grouped` is true if there are several groups. `room` is working
/// memory for the choice of an emitter.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn choose_group(
    scene: &Scene,
    u: f32,
    at: &Receiver,
    room: &mut [u32],
    grouped: bool,
) -> GroupChoice {
    let mut choice = GroupChoice::default();
    choice.chance = 1.0f32;
    let emitters = emitters_of(scene);
    let mut share = 0.0f32;
    if grouped {
        share = emitters.look(at, room);
        let chosen: Chosen = emitters.choose(u, at, share, room);
        choice.group = scene.group_of_emitters[chosen.emitter as usize];
    }
    let row = &scene.of_groups[(OF_GROUP * choice.group) as usize..];
    choice.first = row[0];
    choice.past = choice.first + row[1];
    choice.moves = row[2] != 0;
    if grouped {
        choice.chance = emitters.chance_of_group(choice.first, choice.past, at, share, room);
    }
    choice
}

/// Returns the barycentric weights of all corners from the weights of b and c.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn of_corners(weights: V2) -> V3 {
    v3(1.0 - weights.x - weights.y, weights.x, weights.y)
}

/// Returns the target for emitter `k`: its point with these barycentric weights of corners b and c, or a delta light.
/// The radiance is not set.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn target_of(scene: &Scene, k: u32, weights: V2, x: V3, time: f32, combined: bool) -> Target {
    let emitters = emitters_of(scene);
    let mut target = Target::none();
    if emitters.is_light(k) {
        if comptime!(scene.features.of_emitters.lights) {
            let light = emitters.light(k);
            target = light.target(&light.seen_from(x));
        }
    } else {
        target = target_on(&emitters.triangle(k, time), weights, x);
        target.combined = combined;
        if scene.is_open(scene.emitters[k as usize], of_corners(weights)) {
            target.angle = 0.0f32;
        }
    }
    target
}

/// Returns the target for a point of an emissive triangle, ignoring holes.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn target_on(on: &EmitterTriangle, weights: V2, x: V3) -> Target {
    let corners = of_corners(weights);
    let place = on.a * corners.x + on.b * corners.y + on.c * corners.z;
    let seen = LightPoint::new(place - x, on.normal);
    Target::of_emitter(&seen, place, on.normal, on.area)
}

/// Returns the radiance that a triangle emits at a cosine to its normal, at the point with these barycentric weights.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn emission_at(scene: &Scene, triangle: u32, weights: V3, cosine: f32) -> V3 {
    let mut uv = v2(0.0, 0.0);
    if comptime!(scene.features.glows) {
        uv = scene.uv_at(triangle, weights);
    }
    scene.emission_of(scene.material_of(triangle), uv, cosine)
}

/// Returns the radiance of a point of emitter `k` at a cosine to its normal, or the strength of a delta light.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn radiance_of(scene: &Scene, k: u32, weights: V2, cosine: f32) -> V3 {
    let emitters = emitters_of(scene);
    let mut radiance = v3(0.0, 0.0, 0.0);
    if emitters.is_light(k) {
        if comptime!(scene.features.of_emitters.lights) {
            radiance = emitters.light(k).strength;
        }
    } else {
        let triangle = scene.emitters[k as usize];
        radiance = emission_at(scene, triangle, of_corners(weights), cosine);
    }
    radiance
}

/// Returns light that reaches the camera from one light by a path's point after `bounce` bounces. After the first
/// surface it is scaled down to the limit of indirect light, if there is one.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn limited(scene: &Scene, light: V3, bounce: u32) -> V3 {
    let mut limited = light;
    if comptime!(scene.features.clamp) {
        let largest = light.max_element();
        let limit = scene.settings[CLAMP];
        if bounce > 0 && largest > limit {
            // Light that overflows would become NaN.
            limited = light.min(splat(f32::MAX)) * (limit / min(largest, f32::MAX));
        }
    }
    limited
}

/// Backward pass of light from a fixed point of an emitter, or from a delta light; returns the derivative with
/// respect to the throughput.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn light_backward(
    scene: &Scene,
    sums: &Sums,
    point: &Point,
    k: u32,
    weights: V2,
    target: Target,
    arrived: Arrived,
    throughput: V3,
    time: f32,
    g: V3,
    by: &mut PointGradient,
) -> V3 {
    let mut target = target;
    target.radiance = radiance_of(scene, k, weights, target.facing());
    let found = target.backward(&point.shading, arrived, g, throughput, &mut by.shading);
    let emitters = emitters_of(scene);
    if emitters.is_light(k) {
        if comptime!(scene.features.of_emitters.lights) {
            let light = emitters.light(k);
            let seen = light.seen_from(point.position);
            let by_light = light.backward(&seen, found.angle, found.direction);
            by.position -= by_light.position;
            add_to_light(scene, sums, k, &by_light, found.radiance);
        }
    } else {
        let triangle = scene.emitters[k as usize];
        let on = emitters.triangle(k, time);
        let corners = of_corners(weights);
        if comptime!(sums.of.emission || (sums.of.uvs && scene.features.glows)) {
            let material = scene.material_of(triangle);
            let uv = scene.uv_at(triangle, corners);
            let by_uv = scene.emission_backward(sums, material, uv, found.radiance);
            if scene.glows(material) {
                scene.add_to_uvs(sums, triangle, corners, by_uv);
            }
        }
        if comptime!(sums.of.rays) {
            let seen = LightPoint::new(target.place - point.position, on.normal);
            let by_light = seen.backward(on.normal, on.area, found.angle, found.direction);
            if comptime!(sums.of.objects) && scene.is_wanted(scene.object_of(triangle)) {
                sums.add(triangle, by_light.area, AREAS);
                sums.add_vector(3 * triangle, by_light.normal, TRIANGLES);
                scene.add_to_corners(sums, triangle, corners, by_light.position, time);
            }
            by.position -= by_light.position;
        }
    }
    found.throughput
}

/// Backward pass of light of an environment map along a direction, which is fixed, or turns with the lobes of a polished
/// surface; returns the derivative with respect to the throughput.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn map_backward(
    scene: &Scene,
    sums: &Sums,
    point: &Point,
    target: Target,
    arrived: Arrived,
    throughput: V3,
    g: V3,
    by: &mut PointGradient,
) -> V3 {
    let mut target = target;
    target.radiance = sky(scene, target.direction);
    let shading = point.shading;
    let found = target.backward(&shading, arrived, g, throughput, &mut by.shading);
    if comptime!(scene.features.turns_to_map) {
        let turns = scene.turns_to_map(&shading);
        let mut by_direction = splat(0.0);
        if comptime!(sums.of.sky) || turns {
            by_direction = sky_backward(scene, sums, target.direction, found.radiance);
        }
        // Without derivatives of rays nothing turns the lobes.
        if comptime!(sums.of.rays || sums.of.turns) && turns {
            let light = g.times(throughput).times(target.radiance) * (1.0 / arrived.density);
            let mut lobe = 0u32;
            while lobe < 2 {
                let of_gloss = lobe == 0;
                let turning: Turning = scene.turning(&shading, target.direction, of_gloss);
                shading.turn_backward(
                    target.direction,
                    of_gloss,
                    light,
                    by_direction,
                    &turning,
                    &mut by.shading,
                );
                lobe += 1;
            }
        }
    } else if comptime!(sums.of.sky) {
        sky_backward(scene, sums, target.direction, found.radiance);
    }
    found.throughput
}
