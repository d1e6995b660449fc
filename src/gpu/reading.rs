//! What kernels read from lists: vectors, triangles, and places among numbers that grow.

use burn::cubecl::{self, prelude::*};

use super::layout::{SURFACE_STRIDE, SURFACES};
use crate::model::triangle::weights_at;
use crate::model::{V3, v3};

/// A vector of a list of floats.
#[cube]
pub(super) fn vector(floats: &[f32], at: u32) -> V3 {
    let i = at as usize;
    v3(floats[i], floats[i + 1], floats[i + 2])
}

/// Weights of a triangle's corners in a point of it, at the start of the shutter.
#[cube]
pub(super) fn weights_in(floats: &[f32], words: &[u32], triangle: u32, at_rest: V3) -> V3 {
    let at = words[SURFACES] + SURFACE_STRIDE as u32 * triangle;
    weights_at(
        vector(floats, at),
        vector(floats, at + 3),
        vector(floats, at + 6),
        vector(floats, at + 9),
        floats[at as usize + 13],
        at_rest,
    )
}

/// The first of some numbers, which grow and lie a stride apart, that is over a number; the last if none is.
#[cube]
pub(super) fn first_over(floats: &[f32], first: u32, count: u32, stride: u32, value: f32) -> u32 {
    let mut low = 0u32;
    let mut high = count - 1;
    while low < high {
        let middle = (low + high) / 2;
        if floats[(first + stride * middle) as usize] <= value {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    low
}
