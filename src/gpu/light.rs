//! Emitters, lights without extent and the environment.

use crate::cube::*;

use super::layout::{
    DIRECTIONAL, EMISSIVE_COUNT, LIGHT_BITS, LIGHTS, NONE, OF_EMITTERS, OF_LIGHT, OF_TRIANGLE,
    OF_TRIANGLES, SKY, SKY_CHANCES, SKY_COLUMNS, SKY_HEIGHT, SKY_ROWS, SKY_WIDTH, SPOT,
    SURFACE_STRIDE, SURFACES,
};
use super::reading::Scene;
use super::surface::displacement;
use crate::model::delta_light::DeltaLight;
use crate::model::sky::Map;
use crate::model::triangle::weights_at;
use crate::model::{V2, V3, splat, v2};
use crate::sampling::GRAZING;

/// A triangle that emits, at a time in the shutter.
#[apply(record!)]
pub(super) struct Emitter {
    pub a: V3,
    pub b: V3,
    pub c: V3,
    pub normal: V3,
    pub area: f32,
    pub triangle: u32,
    pub material: u32,
    pub object: u32,
}

#[cube]
pub(super) fn emitter(scene: &Scene, k: u32, time: f32) -> Emitter {
    let triangle = scene.words[(scene.header[OF_EMITTERS] + k) as usize];
    let row = (scene.header[OF_TRIANGLES] + OF_TRIANGLE as u32 * triangle) as usize;
    let at = scene.header[SURFACES] + SURFACE_STRIDE as u32 * triangle;
    let material = scene.words[row];
    let object = scene.words[row + 1];
    let shift = displacement(scene, object, time);
    Emitter {
        a: scene.vector(at) + shift,
        b: scene.vector(at + 3) + shift,
        c: scene.vector(at + 6) + shift,
        normal: scene.vector(at + 9),
        area: scene.floats[at as usize + 13],
        triangle,
        material,
        object,
    }
}

/// Whether an emitter is a light without extent.
#[cube]
pub(super) fn is_light(scene: &Scene, k: u32) -> bool {
    let mut found = false;
    if comptime!(scene.features.lights) {
        found = k >= scene.header[EMISSIVE_COUNT];
    }
    found
}

/// The light without extent that an emitter is.
#[cube]
pub(super) fn delta_light(scene: &Scene, k: u32) -> DeltaLight {
    let i = k - scene.header[EMISSIVE_COUNT];
    let at = scene.header[LIGHTS] + OF_LIGHT as u32 * i;
    let bits = scene.words[(scene.header[LIGHT_BITS] + i) as usize];
    DeltaLight {
        position: scene.vector(at),
        axis: scene.vector(at + 3),
        strength: scene.vector(at + 6),
        directional: bits & DIRECTIONAL != 0,
        spot: bits & SPOT != 0,
        cos_inner: scene.floats[at as usize + 9],
        cos_outer: scene.floats[at as usize + 10],
    }
}

/// A surface point that emitters are chosen for.
#[apply(record!)]
pub(super) struct Site {
    pub position: V3,
    /// The side's normal.
    pub normal: V3,
    pub time: f32,
    /// What the probabilities of few are divided by; of many the probability of directional lights.
    pub sum: f32,
}

/// An emitter whose front a ray hits, as if nothing were in between, or [`NONE`], and the point's weights
/// of the corners b and c.
#[apply(record!)]
pub(super) struct EmitterHit {
    pub emitter: u32,
    pub distance: f32,
    pub weights: V2,
}

#[cube]
pub(super) fn no_emitter_hit() -> EmitterHit {
    EmitterHit {
        emitter: NONE.runtime(),
        distance: 0.0f32.runtime(),
        weights: v2(0.0, 0.0),
    }
}

/// An emitter if a ray hits it.
#[cube]
pub(super) fn hits_emitter(scene: &Scene, k: u32, x: V3, direction: V3, time: f32) -> EmitterHit {
    let mut found = no_emitter_hit();
    let e = emitter(scene, k, time);
    let cosine = e.normal.dot(direction);
    if cosine < -GRAZING {
        let t = e.normal.dot(e.a - x) / cosine;
        if t > 0.0 {
            let w = weights_at(e.a, e.b, e.c, e.normal, e.area, x + direction * t);
            if w.x >= 0.0 && w.y >= 0.0 && w.z >= 0.0 {
                found.emitter = k;
                found.distance = t;
                found.weights = v2(w.y, w.z);
            }
        }
    }
    found
}

/// Radiance of the environment along a direction.
#[cube]
pub(super) fn sky(scene: &Scene, direction: V3) -> V3 {
    let mut radiance = splat(0.0);
    if comptime!(scene.features.sky_constant) {
        radiance = scene.vector(scene.header[SKY]);
    }
    if comptime!(scene.features.sky_map) {
        let cell = map_of(scene).cell(direction);
        radiance = cell.colour(scene.floats, scene.header[SKY]);
    }
    radiance
}

/// The map of the environment.
#[cube]
pub(super) fn map_of(scene: &Scene) -> Map {
    Map {
        width: scene.header[SKY_WIDTH],
        height: scene.header[SKY_HEIGHT],
        rows: scene.header[SKY_ROWS],
        columns: scene.header[SKY_COLUMNS],
        chances: scene.header[SKY_CHANCES],
    }
}
