//! Derivatives by texels, constants and texture coordinates: `model/texture` in a kernel of a GPU.

use burn::cubecl::{self, prelude::*};

use super::corners::uv_rows;
use super::layout::{FIRST_SUMS, NONE, TEXELS as TEXEL_VALUES};
use super::reading::vector;
use super::sums::{MATERIALS, TEXELS, UVS, add, add_vector, component};
use super::texture::{Cell, cell_of_texture, texture_of};
use super::{Derivatives, Features};
use crate::model::{V2, V3, v2};

/// Adds the derivatives of g·colour by the texels of a cell; returns those by the point, in texels.
#[cube]
pub(super) fn cell_backward(
    floats: &[f32],
    totals: &[Atomic<u32>],
    scales: &[f32],
    texels: u32,
    cell: Cell,
    sums: u32,
    g: V3,
    #[comptime] part: usize,
    #[comptime] wanted: bool,
) -> V2 {
    let x = cell.x;
    let y = cell.y;
    if wanted {
        let mut k = 0u32;
        while k < 4 {
            let mut texel = cell.a;
            let mut weight = (1.0 - x) * (1.0 - y);
            if k == 1 {
                texel = cell.b;
                weight = x * (1.0 - y);
            } else if k == 2 {
                texel = cell.c;
                weight = (1.0 - x) * y;
            } else if k == 3 {
                texel = cell.d;
                weight = x * y;
            }
            add_vector(totals, scales, sums + 3 * texel, g * weight, part);
            k += 1;
        }
    }
    let a = vector(floats, texels + 3 * cell.a).dot(g);
    let b = vector(floats, texels + 3 * cell.b).dot(g);
    let c = vector(floats, texels + 3 * cell.c).dot(g);
    let d = vector(floats, texels + 3 * cell.d).dot(g);
    v2(
        (1.0 - y) * (b - a) + y * (d - c),
        (1.0 - x) * (c - a) + x * (d - b),
    )
}

/// Adds the derivatives of g·colour by the texels of a texture, if these are `wanted`; returns that by the texture
/// coordinates.
#[cube]
pub(super) fn texture_backward(
    floats: &[f32],
    words: &[u32],
    totals: &[Atomic<u32>],
    scales: &[f32],
    texture: usize,
    uv: V2,
    g: V3,
    #[comptime] wanted: bool,
) -> V2 {
    let first = 3 * words[texture];
    let cell = cell_of_texture(words, texture, uv);
    let texels = words[TEXEL_VALUES] + first;
    let sums = words[FIRST_SUMS + TEXELS] + first;
    let by = cell_backward(
        floats, totals, scales, texels, cell, sums, g, TEXELS, wanted,
    );
    v2(
        by.x * words[texture + 1] as f32,
        -by.y * words[texture + 2] as f32,
    )
}

/// Adds the derivatives of g·colour by a channel of a material, if these are `wanted`; returns that by the texture
/// coordinates.
#[cube]
pub(super) fn colour_backward(
    floats: &[f32],
    words: &[u32],
    totals: &[Atomic<u32>],
    scales: &[f32],
    material: u32,
    channel: u32,
    uv: V2,
    g: V3,
    #[comptime] textured: bool,
    #[comptime] wanted: bool,
) -> V2 {
    let mut by_uv = v2(0.0, 0.0);
    let mut constant = true;
    if textured {
        let texture = texture_of(words, material, channel);
        if words[texture] != NONE {
            constant = false;
            by_uv = texture_backward(floats, words, totals, scales, texture, uv, g, wanted);
        }
    }
    if wanted {
        if constant {
            let at = words[FIRST_SUMS + MATERIALS] + 12 * material + 3 * channel;
            add_vector(totals, scales, at, g, MATERIALS);
        }
    }
    by_uv
}

/// Adds a derivative by the texture coordinates at a point of a triangle.
#[cube]
pub(super) fn add_to_uvs(
    words: &[u32],
    totals: &[Atomic<u32>],
    scales: &[f32],
    triangle: u32,
    weights: V3,
    by_uv: V2,
    #[comptime] features: Features,
    #[comptime] of: Derivatives,
) {
    if comptime!(of.uvs && features.textured) {
        let rows = uv_rows(words, triangle);
        if words[rows] != NONE {
            let mut k = 0u32;
            while k < 3 {
                let weight = component(weights, k);
                let at = words[FIRST_SUMS + UVS] + 2 * words[rows + k as usize];
                add(totals, scales, at, by_uv.x * weight, UVS);
                add(totals, scales, at + 1, by_uv.y * weight, UVS);
                k += 1;
            }
        }
    }
}
