//! What is looked up in images, and its derivatives: colours of materials, holes of masks, the environment.

use crate::cube::*;

use super::parts::{MATERIALS, SKY, TEXELS};
use super::scene::{CHANNELS, EMISSION, GLOWS, MATERIAL, NONE, Scene};
use super::sums::Sums;
use crate::model::lists::vector;
use crate::model::sky::Map;
use crate::model::texture::{Cell, Masks, texture_at};
use crate::model::{V2, V3, splat, v2};

/// The colour of a texture, by the place of its words among those of materials.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(never)]
pub(crate) fn look_up(scene: &Scene, texture: u32, uv: V2) -> V3 {
    let cell = texture_at(scene.of_materials, texture).cell_at(uv);
    cell.colour(scene.texels, 0u32)
}

/// The place of the words of a channel's texture; the first is [`NONE`] where it is a constant.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn texture_of(material: u32, channel: u32) -> u32 {
    MATERIAL * material + 1 + 4 * channel
}

#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(super) fn constant_of(scene: &Scene, material: u32, channel: u32) -> V3 {
    vector(scene.materials, 3 * (CHANNELS * material + channel))
}

/// A channel of a material: a constant, or looked up in its texture.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn colour(scene: &Scene, material: u32, channel: u32, uv: V2) -> V3 {
    let mut found = constant_of(scene, material, channel);
    if comptime!(scene.features.textured) {
        let texture = texture_of(material, channel);
        if scene.of_materials[texture as usize] != NONE {
            found = look_up(scene, texture, uv);
        }
    }
    found
}

/// What a material emits, where its texture has these coordinates, at a cosine to the normal of its front: from behind
/// nothing.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn emission_of(scene: &Scene, material: u32, uv: V2, cosine: f32) -> V3 {
    let mut found = splat(0.0);
    if cosine > 0.0 {
        found = constant_of(scene, material, EMISSION);
        if comptime!(scene.features.glows) {
            found = colour(scene, material, EMISSION, uv);
        }
    }
    found
}

/// Whether what the front of a material emits is not the same everywhere and in all directions.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn glows(scene: &Scene, material: u32) -> bool {
    let mut found = false;
    if comptime!(scene.features.glows) {
        found = scene.bits_of(material) & GLOWS != 0;
    }
    found
}

/// Adds the derivatives of g·colour by the texels of a cell to a part, if these are wanted; returns those by the point,
/// in texels.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
fn cell_backward(sums: &Sums, texels: &[f32], cell: Cell, g: V3, part: u32, wanted: bool) -> V2 {
    if wanted {
        let mut k = 0u32;
        while k < 4 {
            sums.add_vector(3 * cell.texel(k), g * cell.share(k), part);
            k += 1;
        }
    }
    cell.slopes(texels, 0u32, g)
}

/// Adds the derivatives of g·colour by the texels of a texture, if these are wanted; returns that by the texture
/// coordinates.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(never)]
pub(crate) fn texture_backward(
    scene: &Scene,
    sums: &Sums,
    texture: u32,
    uv: V2,
    g: V3,
    wanted: bool,
) -> V2 {
    let image = texture_at(scene.of_materials, texture);
    let by = cell_backward(sums, scene.texels, image.cell_at(uv), g, TEXELS, wanted);
    image.by_coordinates(by)
}

/// Adds the derivatives of g·colour by a channel of a material, if these are wanted; returns that by the texture
/// coordinates.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn colour_backward(
    scene: &Scene,
    sums: &Sums,
    material: u32,
    channel: u32,
    uv: V2,
    g: V3,
    wanted: bool,
) -> V2 {
    let mut by_uv = v2(0.0, 0.0);
    let mut constant = true;
    if comptime!(scene.features.textured) {
        let texture = texture_of(material, channel);
        if scene.of_materials[texture as usize] != NONE {
            constant = false;
            by_uv = texture_backward(scene, sums, texture, uv, g, wanted);
        }
    }
    if wanted && constant {
        sums.add_vector(3 * (CHANNELS * material + channel), g, MATERIALS);
    }
    by_uv
}

/// Adds the derivatives of g times what a material emits; returns that by the texture coordinates.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn emission_backward(scene: &Scene, sums: &Sums, material: u32, uv: V2, g: V3) -> V2 {
    let mut by_uv = v2(0.0, 0.0);
    if comptime!(scene.features.glows) {
        by_uv = colour_backward(scene, sums, material, EMISSION, uv, g, sums.of.emission);
    } else if comptime!(sums.of.emission) {
        sums.add_vector(3 * (CHANNELS * material + EMISSION), g, MATERIALS);
    }
    by_uv
}

/// Whether a triangle has a hole at the point with these weights of its corners.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn is_open<'a>(scene: &Scene<'a>, triangle: u32, weights: V3) -> bool {
    let mut open = false;
    if comptime!(scene.features.holes) {
        let masks = Masks::<'a> {
            masked: scene.masked,
            images: scene.masks,
            uvs: scene.masked_uvs,
            alphas: scene.alphas,
        };
        open = masks.open(triangle, weights);
    }
    open
}

/// Whether a triangle has a hole at a place, at a time.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn is_open_at(scene: &Scene, triangle: u32, position: V3, time: f32) -> bool {
    let mut open = false;
    if comptime!(scene.features.holes) {
        let at_rest = position - scene.shift(triangle, time);
        open = is_open(scene, triangle, scene.triangle(triangle).weights(at_rest));
    }
    open
}

/// The map of the environment.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn map_of(scene: &Scene) -> Map {
    Map {
        width: scene.sky_width,
        height: scene.sky_height,
    }
}

/// Radiance of the environment along a direction.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn sky(scene: &Scene, direction: V3) -> V3 {
    let mut radiance = splat(0.0);
    if comptime!(scene.features.sky_constant) {
        radiance = vector(scene.sky, 0u32);
    }
    if comptime!(scene.features.sky_map) {
        radiance = radiance_of_map(map_of(scene), scene.sky, direction);
    }
    radiance
}

#[cfg_attr(feature = "wgpu", cube)]
#[inline(never)]
fn radiance_of_map(map: Map, texels: &[f32], direction: V3) -> V3 {
    map.cell(direction).colour(texels, 0u32)
}

/// Adds the derivatives of g·radiance of the environment; returns that by the direction.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(never)]
pub(crate) fn sky_backward(scene: &Scene, sums: &Sums, direction: V3, g: V3) -> V3 {
    let mut by_direction = splat(0.0);
    if comptime!(scene.features.sky_constant && sums.of.sky) {
        sums.add_vector(0u32, g, SKY);
    }
    if comptime!(scene.features.sky_map) {
        let map = map_of(scene);
        let cell = map.cell(direction);
        let by = cell_backward(sums, scene.sky, cell, g, SKY, sums.of.sky);
        by_direction = map.by_direction(direction, by);
    }
    by_direction
}
