//! Points of surfaces that rays hit: `kernel/surface` in a kernel of a GPU.

use crate::cube::*;

use super::corners::{Corners, corners_of, normal_at, normal_rows, tilt_at, uv_at};
use super::layout::{
    COLOUR_ROWS, COLOURS, COMPENSATED, EMITS, GLOSSY, MODEL, NONE, OF_MATERIAL, OF_MATERIALS,
    OF_TRIANGLE, OF_TRIANGLES, REFLECTS, SURFACE_STRIDE, SURFACES, VELOCITIES,
};
use super::reading::Scene;
use super::texture::{EMISSION, colour};
use crate::model::bsdf::Shading;
use crate::model::triangle::weights_at;
use crate::model::{Pair, V2, V3, splat};

/// A point that a ray hit.
#[apply(record!)]
pub(super) struct Point {
    pub position: V3,
    pub shading: Shading,
    /// What it emits towards the ray's origin.
    pub emission: V3,
    pub reflects: bool,
    pub triangle: u32,
    pub material: u32,
    pub object: u32,
    /// 1 if the ray came from the triangle's front, else −1.
    pub side: f32,
    /// Weights of the triangle's corners.
    pub weights: V3,
    pub uv: V2,
}

/// The displacement of an object at a time in the shutter.
#[cube]
pub(super) fn displacement(scene: &Scene, object: u32, time: f32) -> V3 {
    let mut shift = splat(0.0);
    if comptime!(scene.features.moves) {
        shift = scene.vector(scene.header[VELOCITIES] + 3 * object) * time;
    }
    shift
}

/// What a triangle of a material emits from its front, at the point with these weights of its corners.
#[cube]
pub(super) fn emission_at(scene: &Scene, triangle: u32, material: u32, weights: V3) -> V3 {
    let glows = comptime!(scene.features.glows);
    let uv = uv_at(scene, triangle, weights, glows);
    colour(scene, material, EMISSION, uv, glows)
}

/// The point of a triangle, about there, seen along a direction.
#[cube]
pub(super) fn point_at(scene: &Scene, triangle: u32, near: V3, direction: V3, time: f32) -> Point {
    let row = (scene.header[OF_TRIANGLES] + OF_TRIANGLE as u32 * triangle) as usize;
    let material = scene.words[row];
    let object = scene.words[row + 1];
    let at = scene.header[SURFACES] + SURFACE_STRIDE as u32 * triangle;
    let a = scene.vector(at);
    let b = scene.vector(at + 3);
    let c = scene.vector(at + 6);
    let front = scene.vector(at + 9);
    let plane = scene.floats[at as usize + 12];
    let area = scene.floats[at as usize + 13];
    let shift = displacement(scene, object, time);
    // Back onto the plane: how far off it is was rounded by the ray's length.
    let off = front.dot(near - shift) - plane;
    let at_rest = near - shift - front * off;
    let mut side = 1.0f32;
    if front.dot(direction) >= 0.0 {
        side = -1.0f32;
    }
    let geometric = front * side;
    let weights = weights_at(a, b, c, front, area, at_rest);
    let mut smooth = false;
    if comptime!(scene.features.smooth) {
        smooth = scene.words[normal_rows(scene, triangle)] != NONE;
    }
    let mut normal = normal_at(scene, triangle, weights, geometric);
    let textured = comptime!(scene.features.textured);
    let uv = uv_at(scene, triangle, weights, textured);
    if comptime!(scene.features.tilted) {
        let front = normal * side;
        let at = tilt_at(scene, triangle, material, weights, uv, front);
        if at.exists {
            normal = at.tilt.tilted() * side;
            smooth = true;
        }
    }
    let bits = scene.words[(scene.header[OF_MATERIALS] + OF_MATERIAL as u32 * material) as usize];
    let mut diffuse = colour(scene, material, 0u32, uv, textured);
    if comptime!(scene.features.tinted) {
        let rows = (scene.header[COLOUR_ROWS] + 3 * triangle) as usize;
        if scene.words[rows] != NONE {
            let corners: Corners = corners_of(scene, scene.header[COLOURS], rows, 3u32);
            diffuse = diffuse.times(corners.at(weights));
        }
    }
    let mut specular = splat(0.0);
    let mut exponent = 0.0f32;
    let mut glossy = false;
    if comptime!(scene.features.glossy) {
        if bits & GLOSSY != 0 {
            glossy = true;
            specular = colour(scene, material, 1u32, uv, textured);
            exponent = colour(scene, material, 2u32, uv, textured).x;
        }
    }
    let mut model = 0u32;
    let mut compensated = false;
    if comptime!(scene.features.models.facets()) {
        model = (bits / MODEL) % 8;
        compensated = bits & COMPENSATED != 0;
    }
    let mut emission = splat(0.0);
    if side > 0.0 && bits & EMITS != 0 {
        emission = colour(scene, material, EMISSION, uv, scene.features.glows);
    }
    Point {
        position: at_rest + shift,
        shading: Shading {
            geometric,
            normal,
            incoming: direction,
            diffuse,
            specular,
            exponent,
            glossy,
            smooth,
            model,
            compensated,
            inside: side < 0.0,
            models: comptime!(scene.features.models),
            pair: Pair {
                first: normal,
                second: normal,
            },
            paired: false,
        },
        emission,
        reflects: bits & REFLECTS != 0,
        triangle,
        material,
        object,
        side,
        weights,
        uv,
    }
}
