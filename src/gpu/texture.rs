//! Textures and what they are looked up by: `model/texture` in a kernel of a GPU.

use burn::cubecl::{self, prelude::*};

use super::layout::{MATERIALS, NONE, OF_MATERIAL, OF_MATERIALS, TEXELS};
use super::reading::vector;
use crate::model::{V2, V3};

/// The place of emission among the channels of a material.
pub(super) const EMISSION: u32 = 3;

/// Four texels about a point, by their numbers, and its place between their centres.
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

/// The cell of a texture coordinate, of a texture's texels from 0 on.
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
pub(super) fn in_cell(floats: &[f32], texels: u32, cell: Cell) -> V3 {
    let a = vector(floats, texels + 3 * cell.a);
    let b = vector(floats, texels + 3 * cell.b);
    let c = vector(floats, texels + 3 * cell.c);
    let d = vector(floats, texels + 3 * cell.d);
    let x = cell.x;
    let y = cell.y;
    a * ((1.0 - x) * (1.0 - y)) + b * (x * (1.0 - y)) + c * ((1.0 - x) * y) + d * (x * y)
}

/// The colour of a texture.
#[cube]
pub(super) fn look_up(floats: &[f32], words: &[u32], texture: usize, uv: V2) -> V3 {
    let texels = words[TEXELS] + 3 * words[texture];
    in_cell(floats, texels, cell_of_texture(words, texture, uv))
}

/// The place of the words of a channel's texture; the first is [`NONE`] where it is a constant.
#[cube]
pub(super) fn texture_of(words: &[u32], material: u32, channel: u32) -> usize {
    (words[OF_MATERIALS] + OF_MATERIAL as u32 * material + 1 + 4 * channel) as usize
}

/// A channel of a material: a constant, or looked up in its texture.
#[cube]
pub(super) fn colour(
    floats: &[f32],
    words: &[u32],
    material: u32,
    channel: u32,
    uv: V2,
    #[comptime] textured: bool,
) -> V3 {
    let mut found = vector(floats, words[MATERIALS] + 12 * material + 3 * channel);
    if textured {
        let texture = texture_of(words, material, channel);
        if words[texture] != NONE {
            found = look_up(floats, words, texture, uv);
        }
    }
    found
}
