//! Derivatives by texels, constants and texture coordinates: `model/texture` in a kernel of a GPU.

use burn::cubecl::{self, prelude::*};

use super::corners::uv_rows;
use super::layout::{FIRST_SUMS, NONE, TEXELS as TEXEL_VALUES};
use super::reading::Scene;
use super::sums::{MATERIALS, TEXELS, Totals, UVS, component};
use super::texture::{Cell, cell_of_texture, texture_of};
use crate::model::{V2, V3, v2};

/// Adds the derivatives of g·colour by the texels of a cell; returns those by the point, in texels.
#[cube]
pub(super) fn cell_backward(
    scene: &Scene,
    sums: &Totals,
    texels: u32,
    cell: Cell,
    first: u32,
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
            sums.add_vector(first + 3 * texel, g * weight, part);
            k += 1;
        }
    }
    let a = scene.vector(texels + 3 * cell.a).dot(g);
    let b = scene.vector(texels + 3 * cell.b).dot(g);
    let c = scene.vector(texels + 3 * cell.c).dot(g);
    let d = scene.vector(texels + 3 * cell.d).dot(g);
    v2(
        (1.0 - y) * (b - a) + y * (d - c),
        (1.0 - x) * (c - a) + x * (d - b),
    )
}

/// Adds the derivatives of g·colour by the texels of a texture, if these are `wanted`; returns that by the texture
/// coordinates.
#[cube]
pub(super) fn texture_backward(
    scene: &Scene,
    sums: &Totals,
    texture: usize,
    uv: V2,
    g: V3,
    #[comptime] wanted: bool,
) -> V2 {
    let first = 3 * scene.words[texture];
    let cell = cell_of_texture(scene, texture, uv);
    let texels = scene.header[TEXEL_VALUES] + first;
    let first = scene.header[FIRST_SUMS + TEXELS] + first;
    let by = cell_backward(scene, sums, texels, cell, first, g, TEXELS, wanted);
    v2(
        by.x * scene.words[texture + 1] as f32,
        -by.y * scene.words[texture + 2] as f32,
    )
}

/// Adds the derivatives of g·colour by a channel of a material, if these are `wanted`; returns that by the texture
/// coordinates.
#[cube]
pub(super) fn colour_backward(
    scene: &Scene,
    sums: &Totals,
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
        let texture = texture_of(scene, material, channel);
        if scene.words[texture] != NONE {
            constant = false;
            by_uv = texture_backward(scene, sums, texture, uv, g, wanted);
        }
    }
    if wanted {
        if constant {
            let at = scene.header[FIRST_SUMS + MATERIALS] + 12 * material + 3 * channel;
            sums.add_vector(at, g, MATERIALS);
        }
    }
    by_uv
}

/// Adds a derivative by the texture coordinates at a point of a triangle.
#[cube]
pub(super) fn add_to_uvs(scene: &Scene, sums: &Totals, triangle: u32, weights: V3, by_uv: V2) {
    if comptime!(sums.of.uvs && scene.features.textured) {
        let rows = uv_rows(scene, triangle);
        if scene.words[rows] != NONE {
            let mut k = 0u32;
            while k < 3 {
                let weight = component(weights, k);
                let at = scene.header[FIRST_SUMS + UVS] + 2 * scene.words[rows + k as usize];
                sums.add(at, by_uv.x * weight, UVS);
                sums.add(at + 1, by_uv.y * weight, UVS);
                k += 1;
            }
        }
    }
}
