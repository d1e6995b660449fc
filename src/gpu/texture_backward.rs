//! Derivatives by texels, constants and texture coordinates.

use burn::cubecl::{self, prelude::*};

use super::corners::uv_rows;
use super::layout::{FIRST_SUMS, NONE, TEXELS as TEXEL_VALUES};
use super::reading::Scene;
use super::sums::{MATERIALS, TEXELS, Totals, UVS, component};
use super::texture::{texture_at, texture_of};
use crate::model::texture::Cell;
use crate::model::{V2, V3, v2};

/// Adds the derivatives of g·colour by the texels of a cell; returns those by the point, in texels.
#[cube]
pub(super) fn cell_backward(
    scene: &Scene,
    sums: &Totals,
    texels: u32,
    cell: Cell,
    g: V3,
    #[comptime] part: usize,
    #[comptime] wanted: bool,
) -> V2 {
    if wanted {
        let mut k = 0u32;
        while k < 4 {
            let at = scene.header[FIRST_SUMS + part] + 3 * cell.texel(k);
            sums.add_vector(at, g * cell.share(k), part);
            k += 1;
        }
    }
    cell.slopes(scene.floats, texels, g)
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
    let image = texture_at(scene, texture);
    let texels = scene.header[TEXEL_VALUES];
    let by = cell_backward(scene, sums, texels, image.cell_at(uv), g, TEXELS, wanted);
    image.by_coordinates(by)
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
