//! Blocks of eight branches of a node, or of eight edges of a leaf. The host stores the first number of all eight, then
//! the second number of all eight, and so on, so that it executes a loop over them with vector instructions. GPUs store
//! all numbers of one branch or edge, then those of the next, and load four numbers at once.

use crate::accel::LANES;
use crate::accel::eights::number;
#[cfg(feature = "gpu")]
use crate::cube::*;
use crate::model::Four;
#[cfg(feature = "gpu")]
use crate::trace::Fours;

/// A list of blocks, or one block.
#[cfg_attr(feature = "gpu", derive(CubeType))]
#[derive(Clone, Copy)]
pub struct Blocks<'a> {
    pub list: &'a [f32],
    /// For GPUs: all floats by four, if the device can load them so. `first` is where the blocks begin, divided by four, in
    /// `fours` or else in `list`.
    #[cfg(feature = "gpu")]
    pub fours: Fours<'a>,
    #[cfg(feature = "gpu")]
    pub first: u32,
}

impl<'a> Blocks<'a> {
    pub fn new(list: &'a [f32]) -> Self {
        Self {
            list,
            #[cfg(feature = "gpu")]
            fours: Fours::default(),
            #[cfg(feature = "gpu")]
            first: 0,
        }
    }
}

/// Returns a block of a list. `numbers` is how many numbers a branch or an edge has.
#[inline(always)]
pub(super) fn block_at<'a>(blocks: &Blocks<'a>, numbers: usize, index: usize) -> Blocks<'a> {
    let first = LANES * numbers * index;
    Blocks::new(&blocks.list[first..first + LANES * numbers])
}

/// Returns the numbers from 4 `k` on of a branch or edge.
#[inline(always)]
pub(super) fn four_of(block: &Blocks, _numbers: usize, branch: usize, k: usize) -> Four {
    Four {
        x: number(block.list, 4 * k, branch),
        y: number(block.list, 4 * k + 1, branch),
        z: number(block.list, 4 * k + 2, branch),
        w: number(block.list, 4 * k + 3, branch),
    }
}

/// Returns the place of number `k` of a branch or edge, given that of its first number.
#[inline(always)]
pub(super) fn place_of(first: usize, k: usize) -> usize {
    first + LANES * k
}

/// Returns the first branch or edge from `from` on that counts, given the bits of these. On the host all of them count,
/// since it computes eight at once.
#[inline(always)]
pub(super) fn next_of(_bits: u32, from: usize) -> usize {
    from
}

/// The same in kernels.
#[cfg(feature = "gpu")]
mod in_kernels {
    use super::*;
    use crate::trace::four;

    #[cube]
    pub(super) fn block<'a>(blocks: &Blocks<'a>, numbers: usize, index: usize) -> Blocks<'a> {
        Blocks::<'a> {
            list: blocks.list,
            fours: blocks.fours,
            first: blocks.first + (LANES * numbers / 4 * index) as u32,
        }
    }

    #[cube]
    pub(super) fn four_numbers(block: &Blocks, numbers: usize, branch: usize, k: usize) -> Four {
        let at = block.first + (numbers / 4 * branch) as u32;
        four(block.list, block.fours, at + k as u32)
    }

    #[cube]
    pub(super) fn place(first: usize, k: usize) -> usize {
        first + k
    }

    #[cube]
    pub(super) fn next(bits: u32, from: usize) -> usize {
        // The bit behind all others is always found.
        let left = (bits | comptime!(1u32 << LANES as u32)) >> from as u32;
        from + left.trailing_zeros() as usize
    }
}

#[cfg(feature = "gpu")]
pub(super) mod block_at {
    pub(in super::super) use super::in_kernels::block::expand;
}

#[cfg(feature = "gpu")]
pub(super) mod four_of {
    pub(in super::super) use super::in_kernels::four_numbers::expand;
}

#[cfg(feature = "gpu")]
pub(super) mod place_of {
    pub(in super::super) use super::in_kernels::place::expand;
}

#[cfg(feature = "gpu")]
pub(super) mod next_of {
    pub(in super::super) use super::in_kernels::next::expand;
}
