//! Holes of triangles by masks: `scene/holes` in a kernel of a GPU.

use burn::cubecl::{self, prelude::*};

use super::layout::{ALPHAS, MASKED, MASKED_UVS, MASKS, NONE, OF_MASKED};
use super::reading::{Scene, weights_in};
use super::texture::texture_at;
use crate::model::{V3, v2};

/// Whether a triangle has a hole at the point with these weights of its corners.
#[cube]
pub(super) fn is_open(scene: &Scene, triangle: u32, weights: V3) -> bool {
    let place = scene.words[(scene.header[MASKED] + triangle) as usize];
    let mut open = false;
    if place != NONE {
        let at = (scene.header[MASKED_UVS] + OF_MASKED as u32 * place) as usize;
        let uv = v2(
            scene.floats[at] * weights.x
                + scene.floats[at + 2] * weights.y
                + scene.floats[at + 4] * weights.z,
            scene.floats[at + 1] * weights.x
                + scene.floats[at + 3] * weights.y
                + scene.floats[at + 5] * weights.z,
        );
        let mask = (scene.header[MASKS] + 4 * place) as usize;
        let cell = texture_at(scene, mask).cell_at(uv);
        open = cell.number(scene.floats, scene.header[ALPHAS]) < scene.floats[at + 6];
    }
    open
}

/// Whether a triangle has a hole at a point of it, at the start of the shutter.
#[cube]
pub(super) fn is_open_at(scene: &Scene, triangle: u32, at_rest: V3) -> bool {
    let weights = weights_in(scene, triangle, at_rest);
    is_open(scene, triangle, weights)
}
