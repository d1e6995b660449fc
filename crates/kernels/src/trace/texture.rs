//! Image lookups and their derivatives: material colors, holes of alpha masks, the environment.

use crate::cube::*;

use super::parts::{MATERIALS, SKY, TEXELS};
#[cfg(feature = "gpu")]
use super::scene::SceneExpand;
use super::scene::{CHANNELS, EMISSION, GLOWS, MATERIAL, NONE, Scene};
use super::sums::Sums;
use crate::model::lists::vector;
use crate::model::sky::Map;
use crate::model::texture::{Cell, Masks, texture_at};
use crate::model::{V2, V3, splat, v2};

#[cfg_attr(feature = "gpu", cube)]
impl<'a> Scene<'a> {
    /// Returns the color of the texture whose words start at index `texture` among those of materials.
    #[inline(never)]
    pub fn look_up(&self, texture: u32, uv: V2) -> V3 {
        let cell = texture_at(self.of_materials, texture).cell_at(uv);
        cell.color(self.texels, 0u32)
    }

    #[inline(always)]
    pub fn constant_of(&self, material: u32, channel: u32) -> V3 {
        vector(self.materials, 3 * (CHANNELS * material + channel))
    }

    /// Returns a channel of a material: a constant, or a texture lookup.
    #[inline(always)]
    pub fn color(&self, material: u32, channel: u32, uv: V2) -> V3 {
        let mut found = self.constant_of(material, channel);
        let texture = texture_of(material, channel);
        if comptime!(self.features.textured) && self.of_materials[texture as usize] != NONE {
            found = self.look_up(texture, uv);
        }
        found
    }

    /// Returns the radiance that a material emits at texture coordinates and at a cosine to its front normal; 0 from
    /// behind.
    #[inline(always)]
    pub fn emission_of(&self, material: u32, uv: V2, cosine: f32) -> V3 {
        let mut found = splat(0.0);
        if cosine > 0.0 {
            found = self.constant_of(material, EMISSION);
            if comptime!(self.features.glows) {
                found = self.color(material, EMISSION, uv);
            }
        }
        found
    }

    /// Returns whether the emission of a material's front varies with position or direction.
    #[inline(always)]
    pub fn glows(&self, material: u32) -> bool {
        let mut found = false;
        if comptime!(self.features.glows) {
            found = self.bits_of(material) & GLOWS != 0;
        }
        found
    }

    /// Adds the derivatives of g·color with respect to the texels of a texture, if `wanted`, and returns the one with
    /// respect to the texture coordinates.
    #[inline(never)]
    pub fn texture_backward(&self, sums: &Sums, texture: u32, uv: V2, g: V3, wanted: bool) -> V2 {
        let image = texture_at(self.of_materials, texture);
        let by = cell_backward(sums, self.texels, image.cell_at(uv), g, TEXELS, wanted);
        image.by_coordinates(by)
    }

    /// Adds the derivatives of g·color with respect to a channel of a material, if `wanted`, and returns the one with
    /// respect to the texture coordinates.
    #[inline(always)]
    pub fn color_backward(
        &self,
        sums: &Sums,
        material: u32,
        channel: u32,
        uv: V2,
        g: V3,
        wanted: bool,
    ) -> V2 {
        let mut by_uv = v2(0.0, 0.0);
        let texture = texture_of(material, channel);
        if comptime!(self.features.textured) && self.of_materials[texture as usize] != NONE {
            by_uv = self.texture_backward(sums, texture, uv, g, wanted);
        } else if wanted {
            sums.add_vector(3 * (CHANNELS * material + channel), g, MATERIALS);
        }
        by_uv
    }

    /// Adds the derivatives of g times a material's emission, and returns the one with respect to the texture
    /// coordinates.
    #[inline(always)]
    pub fn emission_backward(&self, sums: &Sums, material: u32, uv: V2, g: V3) -> V2 {
        let mut by_uv = v2(0.0, 0.0);
        if comptime!(self.features.glows) {
            by_uv = self.color_backward(sums, material, EMISSION, uv, g, sums.of.emission);
        } else if comptime!(sums.of.emission) {
            sums.add_vector(3 * (CHANNELS * material + EMISSION), g, MATERIALS);
        }
        by_uv
    }

    /// Returns whether a triangle has a hole at the point with these barycentric weights.
    #[inline(always)]
    pub fn is_open(&self, triangle: u32, weights: V3) -> bool {
        let mut open = false;
        if comptime!(self.features.holes) {
            let masks = Masks::<'a> {
                masked: self.masked,
                images: self.masks,
                uvs: self.masked_uvs,
                alphas: self.alphas,
            };
            open = masks.open(triangle, weights);
        }
        open
    }

    /// Returns whether a triangle has a hole at a position and time.
    #[inline(always)]
    pub fn is_open_at(&self, triangle: u32, position: V3, time: f32) -> bool {
        let mut open = false;
        if comptime!(self.features.holes) {
            let at_rest = position - self.shift(triangle, time);
            open = self.is_open(triangle, self.triangle(triangle).weights(at_rest));
        }
        open
    }
}

/// Returns the index of the words of a channel's texture; the first word is [`NONE`] for a constant.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn texture_of(material: u32, channel: u32) -> u32 {
    MATERIAL * material + 1 + 4 * channel
}

/// Adds the derivatives of g·color with respect to the texels of a cell to a part, if `wanted`, and returns the
/// derivatives with respect to the cell's point, in texels.
#[cfg_attr(feature = "gpu", cube)]
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

/// Returns the environment map.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn map_of(scene: &Scene) -> Map {
    Map {
        width: scene.sky_width,
        height: scene.sky_height,
    }
}

/// Returns the radiance of the environment along a direction.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn sky(scene: &Scene, direction: V3) -> V3 {
    let mut radiance = scene.everywhere();
    if comptime!(scene.features.sky_map) {
        radiance = radiance_of_map(map_of(scene), scene.sky, direction);
    }
    radiance
}

#[cfg_attr(feature = "gpu", cube)]
#[inline(never)]
fn radiance_of_map(map: Map, texels: &[f32], direction: V3) -> V3 {
    map.cell(direction).color(texels, 0u32)
}

/// Adds the derivatives of g·radiance of the environment, and returns the one with respect to the direction.
#[cfg_attr(feature = "gpu", cube)]
#[inline(never)]
pub fn sky_backward(scene: &Scene, sums: &Sums, direction: V3, g: V3) -> V3 {
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
