//! Holes of triangles by masks: `scene/holes` in a kernel of a GPU.

use burn::cubecl::{self, prelude::*};

use super::layout::{ALPHAS, MASKED, MASKED_UVS, MASKS, NONE, OF_MASKED};
use super::reading::weights_in;
use super::texture::cell_of_texture;
use crate::model::{V3, v2};

/// Whether a triangle has a hole at the point with these weights of its corners.
#[cube]
pub(super) fn is_open(floats: &[f32], words: &[u32], triangle: u32, weights: V3) -> bool {
    let place = words[(words[MASKED] + triangle) as usize];
    let mut open = false;
    if place != NONE {
        let at = (words[MASKED_UVS] + OF_MASKED as u32 * place) as usize;
        let uv = v2(
            floats[at] * weights.x + floats[at + 2] * weights.y + floats[at + 4] * weights.z,
            floats[at + 1] * weights.x + floats[at + 3] * weights.y + floats[at + 5] * weights.z,
        );
        let mask = (words[MASKS] + 4 * place) as usize;
        let cell = cell_of_texture(words, mask, uv);
        let first = words[ALPHAS] + words[mask];
        let a = floats[(first + cell.a) as usize];
        let b = floats[(first + cell.b) as usize];
        let c = floats[(first + cell.c) as usize];
        let d = floats[(first + cell.d) as usize];
        let above = a * (1.0 - cell.x) + b * cell.x;
        let below = c * (1.0 - cell.x) + d * cell.x;
        open = above * (1.0 - cell.y) + below * cell.y < floats[at + 6];
    }
    open
}

/// Whether a triangle has a hole at a point of it, at the start of the shutter.
#[cube]
pub(super) fn is_open_at(floats: &[f32], words: &[u32], triangle: u32, at_rest: V3) -> bool {
    let weights = weights_in(floats, words, triangle, at_rest);
    is_open(floats, words, triangle, weights)
}
