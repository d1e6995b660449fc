//! Textures and what they are looked up by: `model/texture` in a kernel of a GPU.

use crate::cube::*;

use super::layout::{MATERIALS, NONE, OF_MATERIAL, OF_MATERIALS, TEXELS};
use super::reading::Scene;
use crate::model::{V2, V3};

/// The place of emission among the channels of a material.
pub(super) const EMISSION: u32 = 3;

/// Four texels about a point, by their numbers, and its place between their centres.
#[apply(record!)]
pub(super) struct Cell {
    pub a: u32,
    pub b: u32,
    pub c: u32,
    pub d: u32,
    pub x: f32,
    pub y: f32,
}

/// The cell of a texture coordinate, of a texture's texels from 0 on.
#[cube]
pub(super) fn cell_of_texture(scene: &Scene, texture: usize, uv: V2) -> Cell {
    let width = scene.words[texture + 1];
    let height = scene.words[texture + 2];
    let wrap = scene.words[texture + 3];
    let x = uv.x * width as f32 - 0.5;
    let y = (1.0 - uv.y) * height as f32 - 0.5;
    let left = x.floor();
    let top = y.floor();
    let i = left as i32;
    let j = top as i32;
    let above = wrapped(j, height, wrap) * width;
    let below = wrapped(j + 1, height, wrap) * width;
    let before = wrapped(i, width, wrap);
    let behind = wrapped(i + 1, width, wrap);
    Cell {
        a: above + before,
        b: above + behind,
        c: below + before,
        d: below + behind,
        x: x - left,
        y: y - top,
    }
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

/// The colour of a cell of texels from a place among the floats on.
#[cube]
pub(super) fn in_cell(scene: &Scene, texels: u32, cell: Cell) -> V3 {
    let a = scene.vector(texels + 3 * cell.a);
    let b = scene.vector(texels + 3 * cell.b);
    let c = scene.vector(texels + 3 * cell.c);
    let d = scene.vector(texels + 3 * cell.d);
    let x = cell.x;
    let y = cell.y;
    a * ((1.0 - x) * (1.0 - y)) + b * (x * (1.0 - y)) + c * ((1.0 - x) * y) + d * (x * y)
}

/// The colour of a texture.
#[cube]
pub(super) fn look_up(scene: &Scene, texture: usize, uv: V2) -> V3 {
    let texels = scene.header[TEXELS] + 3 * scene.words[texture];
    in_cell(scene, texels, cell_of_texture(scene, texture, uv))
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
