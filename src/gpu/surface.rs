//! Points of surfaces that rays hit: `kernel/surface` in a kernel of a GPU.

use burn::cubecl::{self, prelude::*};

use super::Features;
use super::hit::vector;
use super::layout::{
    COMPENSATED, EMITS, GLOSSY, MATERIALS, MODEL, NONE, NORMALS, OF_MATERIAL, OF_MATERIALS,
    OF_TRIANGLE, OF_TRIANGLES, REFLECTS, SURFACE_STRIDE, SURFACES, TEXELS, UVS, VELOCITIES,
};
use crate::model::bsdf::{Known, Shading};
use crate::model::triangle::weights_at;
use crate::model::{Pair, V2, V3, splat, v2};

/// A point that a ray hit.
#[derive(CubeType, CubeTypeMut, Clone, Copy, Debug)]
#[expand(derive(Clone, Copy))]
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

/// Normals of corners may cancel where they are interpolated.
const TINY: f32 = 1e-15;

/// The place of one of the emission's constants among those of a material.
const EMISSION: u32 = 9;

/// The displacement of an object at a time in the shutter.
#[cube]
pub(super) fn displacement(
    floats: &[f32],
    words: &[u32],
    object: u32,
    time: f32,
    #[comptime] moves: bool,
) -> V3 {
    let mut shift = splat(0.0);
    if moves {
        shift = vector(floats, words[VELOCITIES] + 3 * object) * time;
    }
    shift
}

/// What a material emits from its front.
#[cube]
pub(super) fn emission_of(floats: &[f32], words: &[u32], material: u32) -> V3 {
    vector(floats, words[MATERIALS] + 12 * material + EMISSION)
}

/// The point of a triangle, about there, seen along a direction.
#[cube]
pub(super) fn point_at(
    floats: &[f32],
    words: &[u32],
    triangle: u32,
    near: V3,
    direction: V3,
    time: f32,
    #[comptime] features: Features,
) -> Point {
    let row = (words[OF_TRIANGLES] + OF_TRIANGLE as u32 * triangle) as usize;
    let material = words[row];
    let object = words[row + 1];
    let at = words[SURFACES] + SURFACE_STRIDE as u32 * triangle;
    let a = vector(floats, at);
    let b = vector(floats, at + 3);
    let c = vector(floats, at + 6);
    let front = vector(floats, at + 9);
    let plane = floats[at as usize + 12];
    let area = floats[at as usize + 13];
    let shift = displacement(floats, words, object, time, features.moves);
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
    let mut normal = geometric;
    if comptime!(features.smooth) {
        if words[row + 5] != NONE {
            smooth = true;
            let first = words[NORMALS];
            let sum = vector(floats, first + 3 * words[row + 5]) * weights.x
                + vector(floats, first + 3 * words[row + 6]) * weights.y
                + vector(floats, first + 3 * words[row + 7]) * weights.z;
            let mut inverse = 1.0 / sum.length().max(TINY);
            if sum.dot(geometric) < 0.0 {
                inverse = -inverse;
            }
            normal = sum * inverse;
        }
    }
    let mut uv = v2(0.0, 0.0);
    if comptime!(features.textured) {
        if words[row + 2] != NONE {
            let i = (words[UVS] + 2 * words[row + 2]) as usize;
            let j = (words[UVS] + 2 * words[row + 3]) as usize;
            let k = (words[UVS] + 2 * words[row + 4]) as usize;
            uv = v2(
                floats[i] * weights.x + floats[j] * weights.y + floats[k] * weights.z,
                floats[i + 1] * weights.x + floats[j + 1] * weights.y + floats[k + 1] * weights.z,
            );
        }
    }
    let constants = words[MATERIALS] + 12 * material;
    let of_material = (words[OF_MATERIALS] + OF_MATERIAL as u32 * material) as usize;
    let bits = words[of_material];
    let diffuse = colour(
        floats,
        words,
        constants,
        of_material + 1,
        uv,
        features.textured,
    );
    let mut specular = splat(0.0);
    let mut exponent = 0.0f32;
    let mut glossy = false;
    if comptime!(features.glossy) {
        if bits & GLOSSY != 0 {
            glossy = true;
            specular = colour(
                floats,
                words,
                constants + 3,
                of_material + 5,
                uv,
                features.textured,
            );
            exponent = colour(
                floats,
                words,
                constants + 6,
                of_material + 9,
                uv,
                features.textured,
            )
            .x;
        }
    }
    let mut model = 0u32;
    let mut compensated = false;
    if comptime!(features.facets) {
        model = (bits / MODEL) % 8;
        compensated = bits & COMPENSATED != 0;
    }
    let mut emission = splat(0.0);
    if side > 0.0 && bits & EMITS != 0 {
        emission = emission_of(floats, words, material);
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
            facets: comptime!(Known(features.facets)),
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

/// Four texels about a point, by where they begin among the floats or sums, and its place between their centres.
#[derive(CubeType, CubeTypeMut, Clone, Copy, Debug)]
#[expand(derive(Clone, Copy))]
pub(super) struct Cell {
    pub a: u32,
    pub b: u32,
    pub c: u32,
    pub d: u32,
    pub x: f32,
    pub y: f32,
}

/// The cell of a texture coordinate, of the texels from 0 on.
#[cube]
pub(super) fn cell_of_texture(words: &[u32], texture: usize, uv: V2) -> Cell {
    let width = words[texture + 1];
    let height = words[texture + 2];
    let wrap = words[texture + 3];
    let x = uv.x * width as f32 - 0.5;
    let y = (1.0 - uv.y) * height as f32 - 0.5;
    let left = x.floor();
    let top = y.floor();
    let i = left as i32;
    let j = top as i32;
    let first = words[texture];
    let above = first + wrapped(j, height, wrap) * width;
    let below = first + wrapped(j + 1, height, wrap) * width;
    let before = wrapped(i, width, wrap);
    let behind = wrapped(i + 1, width, wrap);
    Cell {
        a: 3 * (above + before),
        b: 3 * (above + behind),
        c: 3 * (below + before),
        d: 3 * (below + behind),
        x: x - left,
        y: y - top,
    }
}

/// A colour of a material: a constant, or looked up in its texture.
#[cube]
fn colour(
    floats: &[f32],
    words: &[u32],
    constant: u32,
    texture: usize,
    uv: V2,
    #[comptime] textured: bool,
) -> V3 {
    let mut found = vector(floats, constant);
    if textured {
        if words[texture] != NONE {
            found = in_cell(floats, words[TEXELS], cell_of_texture(words, texture, uv));
        }
    }
    found
}

/// The colour of a cell.
#[cube]
pub(super) fn in_cell(floats: &[f32], texels: u32, cell: Cell) -> V3 {
    let a = vector(floats, texels + cell.a);
    let b = vector(floats, texels + cell.b);
    let c = vector(floats, texels + cell.c);
    let d = vector(floats, texels + cell.d);
    let x = cell.x;
    let y = cell.y;
    a * ((1.0 - x) * (1.0 - y)) + b * (x * (1.0 - y)) + c * ((1.0 - x) * y) + d * (x * y)
}

/// The texel for any integer coordinate (`Wrap::texel`).
#[cube]
fn wrapped(i: i32, size: u32, wrap: u32) -> u32 {
    let n = size as i32;
    let mut texel = i;
    if wrap == 1 {
        texel = i.max(0).min(n - 1);
    } else {
        let mut period = n;
        if wrap == 2 {
            period = 2 * n;
        }
        texel = ((i % period) + period) % period;
        if texel >= n {
            texel = 2 * n - 1 - texel;
        }
    }
    texel as u32
}
