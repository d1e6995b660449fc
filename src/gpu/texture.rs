//! Colours of materials.

use crate::cube::*;

use super::layout::{MATERIALS, NONE, OF_MATERIAL, OF_MATERIALS, TEXELS};
use super::reading::Scene;
use crate::model::texture::Texture;
use crate::model::{V2, V3};

/// The place of emission among the channels of a material.
pub(super) const EMISSION: u32 = 3;

/// A texture, by the place of its words.
#[cube]
pub(super) fn texture_at(scene: &Scene, texture: usize) -> Texture {
    Texture {
        first: scene.words[texture],
        width: scene.words[texture + 1],
        height: scene.words[texture + 2],
        wrap: scene.words[texture + 3],
    }
}

/// The colour of a texture.
#[cube]
pub(super) fn look_up(scene: &Scene, texture: usize, uv: V2) -> V3 {
    let cell = texture_at(scene, texture).cell_at(uv);
    cell.colour(scene.floats, scene.header[TEXELS])
}

/// The place of the words of a channel's texture; the first is [`NONE`] where it is a constant.
#[cube]
pub(super) fn texture_of(scene: &Scene, material: u32, channel: u32) -> usize {
    (scene.header[OF_MATERIALS] + OF_MATERIAL as u32 * material + 1 + 4 * channel) as usize
}

/// A channel of a material: a constant, or looked up in its texture.
#[cube]
pub(super) fn colour(
    scene: &Scene,
    material: u32,
    channel: u32,
    uv: V2,
    #[comptime] textured: bool,
) -> V3 {
    let mut found = scene.vector(scene.header[MATERIALS] + 12 * material + 3 * channel);
    if textured {
        let texture = texture_of(scene, material, channel);
        if scene.words[texture] != NONE {
            found = look_up(scene, texture, uv);
        }
    }
    found
}
