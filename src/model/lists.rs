//! Lists of numbers: vectors in them, and numbers that grow.

use super::{V3, v3};
#[cfg(feature = "wgpu")]
use crate::cube::*;

/// A vector of a list.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn vector(list: &[f32], at: u32) -> V3 {
    let i = at as usize;
    // The last number first: then the host checks one index.
    let z = list[i + 2];
    let y = list[i + 1];
    v3(list[i], y, z)
}

/// The first of some numbers, which grow and lie a stride apart, that is over a number; the last if none is.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn first_over(list: &[f32], first: u32, count: u32, stride: u32, value: f32) -> u32 {
    let mut low = 0u32;
    let mut high = count - 1;
    while low < high {
        let middle = (low + high) / 2;
        if list[(first + stride * middle) as usize] <= value {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    low
}
