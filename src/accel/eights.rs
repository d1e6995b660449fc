//! Trees whose nodes have eight branches: how what they are of is divided, and how the numbers of branches lie in lists.
//!
//! A list holds blocks of eight branches: eight of their first number, eight of their second, and so on. So a loop over
//! branches that is compiled for a CPU takes all at once.

use super::LANES;
use crate::cube::*;
use crate::model::{V3, v3};

/// A number of a branch in a block.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn number(block: &[f32], k: usize, branch: usize) -> f32 {
    block[LANES * k + branch]
}

/// Three numbers of a branch, from one on.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn vector(block: &[f32], k: usize, branch: usize) -> V3 {
    v3(
        number(block, k, branch),
        number(block, k + 1, branch),
        number(block, k + 2, branch),
    )
}

/// Sets the numbers of a branch in a block.
pub(crate) fn set<const N: usize>(block: &mut [f32], branch: usize, numbers: [f32; N]) {
    for (k, x) in numbers.into_iter().enumerate() {
        block[LANES * k + branch] = x;
    }
}

/// Divides a list into up to eight parts, of which the one that costs the most is divided next, if it has several items.
pub(crate) fn parts<T>(
    list: &mut [T],
    cost: impl Fn(&[T]) -> f32,
    split: impl Fn(&mut [T]) -> [&mut [T]; 2],
) -> Vec<&mut [T]> {
    let (mut costs, mut parts) = (vec![cost(list)], vec![list]);
    while parts.len() < LANES {
        let several = (0..parts.len()).filter(|&i| parts[i].len() > 1);
        let Some(worst) = several.max_by(|&a, &b| costs[a].total_cmp(&costs[b])) else {
            break;
        };
        costs.swap_remove(worst);
        let halves = split(parts.swap_remove(worst));
        costs.extend(halves.each_ref().map(|half| cost(half)));
        parts.extend(halves);
    }
    parts
}
