//! Lists of numbers: vectors in them, and numbers that grow.

use super::{V3, v3};
#[cfg(feature = "wgpu")]
use crate::cube::*;

/// A vector of a list.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn vector(list: &[f32], at: u32) -> V3 {
    let i = at as usize;
    v3(list[i], list[i + 1], list[i + 2])
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
