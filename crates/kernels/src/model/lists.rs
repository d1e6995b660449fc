//! Reading vectors from flat lists, and binary search in increasing values.

use super::{V3, v3};
#[cfg(feature = "gpu")]
use crate::cube::*;

/// Returns the vector stored at index `at` of a list.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn vector(list: &[f32], at: u32) -> V3 {
    let i = at as usize;
    // The last index first, so that the host checks bounds once.
    let z = list[i + 2];
    let y = list[i + 1];
    v3(list[i], y, z)
}

/// Returns the index of the first value larger than `value` among `count` increasing values, which are stored
/// `stride` apart from index `first` on. Returns the last index if no value is larger.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn first_over(list: &[f32], first: u32, count: u32, stride: u32, value: f32) -> u32 {
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
