//! Emitters, lights without extent and the environment: `model/delta_light` and `model/sky` in a kernel of a GPU.

use std::f32::consts::{PI, TAU};

use crate::cube::*;

use super::layout::{
    DIRECTIONAL, EMISSIVE_COUNT, LIGHT_BITS, LIGHTS, NONE, OF_EMITTERS, OF_LIGHT, OF_TRIANGLE,
    OF_TRIANGLES, SKY, SKY_CHANCES, SKY_COLUMNS, SKY_HEIGHT, SKY_ROWS, SKY_WIDTH, SPOT,
    SURFACE_STRIDE, SURFACES,
};
use super::reading::Scene;
use super::surface::displacement;
use super::texture::{Cell, in_cell};
use crate::model::choice::first_over;
use crate::model::delta_light::DeltaLight;
use crate::model::frame::sin_cos_of_turns;
use crate::model::triangle::weights_at;
use crate::model::{V2, V3, splat, v2, v3};
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
        radiance = in_cell(scene, scene.header[SKY], cell_of_map(scene, direction));
    }
    radiance
}

/// The texels about a direction: columns wrap, rows end at the poles.
#[cube]
pub(super) fn cell_of_map(scene: &Scene, direction: V3) -> Cell {
    let place = place_in_map(scene, direction);
    let x = place.x - 0.5;
    let y = place.y - 0.5;
    let left = x.floor();
    let top = y.floor();
    let width = scene.header[SKY_WIDTH] as i32;
    let last = scene.header[SKY_HEIGHT] as i32 - 1;
    let i = ((left as i32 + width) % width) as u32;
    let j = ((left as i32 + 1 + width) % width) as u32;
    let above = (top as i32).max(0).min(last) as u32 * scene.header[SKY_WIDTH];
    let below = (top as i32 + 1).max(0).min(last) as u32 * scene.header[SKY_WIDTH];
    Cell {
        a: above + i,
        b: above + j,
        c: below + i,
        d: below + j,
        x: x - left,
        y: y - top,
    }
}

/// Column and row of a direction in the map, in texels.
#[cube]
fn place_in_map(scene: &Scene, d: V3) -> V2 {
    let around = (d.x * d.x + d.z * d.z).sqrt();
    v2(
        (0.5 + d.x.atan2(-d.z) / TAU) * scene.header[SKY_WIDTH] as f32,
        around.atan2(d.y) / PI * scene.header[SKY_HEIGHT] as f32,
    )
}

/// The density per solid angle with which [`choose_direction`] draws a direction.
#[cube]
pub(super) fn density_of_direction(scene: &Scene, d: V3) -> f32 {
    let width = scene.header[SKY_WIDTH];
    let height = scene.header[SKY_HEIGHT];
    let place = place_in_map(scene, d);
    let x = (place.x.max(0.0) as u32).min(width - 1);
    let y = (place.y.max(0.0) as u32).min(height - 1);
    let sine = (1.0 - d.y * d.y).max(1e-12).sqrt();
    let p = scene.floats[(scene.header[SKY_CHANCES] + y * width + x) as usize];
    p * (width * height) as f32 / (TAU * PI * sine)
}

/// A direction to the map for a pair of random numbers.
#[cube]
pub(super) fn choose_direction(scene: &Scene, u: f32, v: f32) -> V3 {
    let width = scene.header[SKY_WIDTH];
    let height = scene.header[SKY_HEIGHT];
    let rows = scene.header[SKY_ROWS];
    let wanted = v * scene.floats[(rows + height - 1) as usize];
    let y = first_over(scene.floats, rows, height, 1u32, wanted);
    let row = scene.header[SKY_COLUMNS] + y * width;
    let along = u * scene.floats[(row + width - 1) as usize];
    let x = first_over(scene.floats, row, width, 1u32, along);
    let turn = (x as f32 + inside(scene, row, x, along)) / width as f32 - 0.5;
    let polar = (y as f32 + inside(scene, rows, y, wanted)) / height as f32;
    let around = sin_cos_of_turns(turn - turn.floor());
    let down = sin_cos_of_turns(0.5 * polar);
    let sine = down.sin.max(1e-6);
    v3(sine * around.sin, down.cos, -sine * around.cos).normalize()
}

/// The place of a number between two of a list, 0 … 1.
#[cube]
fn inside(scene: &Scene, first: u32, k: u32, value: f32) -> f32 {
    let mut before = 0.0f32;
    if k > 0 {
        before = scene.floats[(first + k - 1) as usize];
    }
    let past = scene.floats[(first + k) as usize];
    ((value - before) / (past - before)).max(0.0).min(1.0)
}
