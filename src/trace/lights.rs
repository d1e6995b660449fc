//! Lights that surface points are connected to: emitters, delta lights and the map of the environment, and their
//! derivatives.

use crate::cube::*;

use super::parts::{AREAS, TRIANGLES};
use super::scene::{OF_GROUP, Scene};
use super::sums::{Sums, add_to_light};
use super::surface::{Point, PointGradient};
use super::texture::{sky, sky_backward};
pub(crate) use crate::model::connection::Arrived;
use crate::model::connection::Target;
use crate::model::emitter::LightPoint;
use crate::model::{V2, V3, v2, v3};
use crate::sampling::{Chosen, EmitterLists, EmitterTriangle, Fixed, LightTree, Receiver};

/// The emitters.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn emitters_of<'a>(scene: &Scene<'a>) -> EmitterLists<'a> {
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

/// A group of emitters that was chosen, the first and the one past the last of them, and its probability.
#[apply(zeroed!)]
pub(crate) struct GroupChoice {
    pub group: u32,
    pub first: u32,
    pub past: u32,
    pub chance: f32,
    /// Whether any of them moves.
    pub moves: bool,
}

/// Chooses a group for a random number; `grouped` says whether there are several. `room` is that of a choice of an
/// emitter.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn choose_group(
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

/// The weights of all corners, from those of b and c.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn of_corners(weights: V2) -> V3 {
    v3(1.0 - weights.x - weights.y, weights.x, weights.y)
}

/// The point of an emitter with these weights of its corners b and c, or a delta light; without its radiance.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn target_of(
    scene: &Scene,
    k: u32,
    weights: V2,
    x: V3,
    time: f32,
    combined: bool,
) -> Target {
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

/// The point of a triangle that emits, without holes.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn target_on(on: &EmitterTriangle, weights: V2, x: V3) -> Target {
    let corners = of_corners(weights);
    let place = on.a * corners.x + on.b * corners.y + on.c * corners.z;
    let seen = LightPoint::new(place - x, on.normal);
    Target::of_emitter(&seen, place, on.normal, on.area)
}

/// What a triangle emits at a cosine to its normal, at the point with these weights of its corners.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn emission_at(scene: &Scene, triangle: u32, weights: V3, cosine: f32) -> V3 {
    let mut uv = v2(0.0, 0.0);
    if comptime!(scene.features.glows) {
        uv = scene.uv_at(triangle, weights);
    }
    scene.emission_of(scene.material_of(triangle), uv, cosine)
}

/// The radiance of that point at a cosine to the emitter's normal, or what a delta light brings.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn radiance_of(scene: &Scene, k: u32, weights: V2, cosine: f32) -> V3 {
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

/// Back over light from a point of an emitter, which stays where it is on it, or from a delta light; returns the
/// derivative by the throughput.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn light_backward(
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

/// Back over light of a map along a direction, which is fixed; returns the derivative by the throughput.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn map_backward(
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
    let found = target.backward(&point.shading, arrived, g, throughput, &mut by.shading);
    if comptime!(sums.of.sky) {
        sky_backward(scene, sums, target.direction, found.radiance);
    }
    found.throughput
}
