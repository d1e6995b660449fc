//! Edges on the film: how many are drawn, which, and what pixels count for.

use super::jumps::FEW_SAMPLES;
use super::lists::first_over;
use super::segment::OnSegment;
use crate::cube::*;

/// Pixels of a side of a cell, about which edges are drawn as much as the loss depends on its pixels.
pub(crate) const CELL: u32 = 8;
/// What those of its neighbours count for, beside its own.
pub(crate) const NEIGHBOURS: f32 = 0.1;

/// Pieces of edges whose weights are added up together.
pub(crate) const BLOCK: u32 = 128;

/// The most samples of edges that a film is given.
pub(crate) const MOST: u32 = 1_000_000_000;

/// Samples of edges on the film for so many pixels that a loss depends on, and samples of each: one for two paths, for four
/// where a pixel has few ([`FEW_SAMPLES`]), and a thousand, which take no time, where paths are few.
#[cfg_attr(feature = "wgpu", cube)]
pub(crate) fn samples_of_film(pixels: u32, samples: u32) -> u32 {
    // The product would not fit otherwise.
    if pixels as f32 * samples as f32 <= 4.0e9 {
        let paths = pixels * samples;
        let few = (8 * paths.min(1024)).min(1024);
        let each = select(samples <= 1u32 << FEW_SAMPLES, 4u32, 2u32);
        paths.div_ceil(each).max(few).max(1).min(MOST)
    } else {
        MOST
    }
}

/// A piece of an edge that was drawn, and its share of the sum of all weights.
#[apply(record!)]
pub(crate) struct DrawnPiece {
    pub piece: u32,
    pub share: f32,
}

#[cfg_attr(feature = "wgpu", cube)]
impl DrawnPiece {
    /// A point of it for a uniform number, from one λ of the edge to another, of the sum of all weights.
    #[inline(always)]
    pub fn point(&self, from: f32, to: f32, total: f32, u: f32) -> OnSegment {
        let length = to - from;
        OnSegment {
            lambda: from + length * u,
            per_density: length * (total / self.share.max(1e-37)),
        }
    }
}

/// The piece that a part of the sum of all weights comes to, of `count` pieces. The sums of their weights up to each,
/// within blocks, lie a stride apart from `first` on, sums up to each block from `first_block` on.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn draw_piece(
    sums: &[f32],
    first: u32,
    stride: u32,
    count: u32,
    blocks: &[f32],
    first_block: u32,
    part: f32,
) -> DrawnPiece {
    let block = first_over(blocks, first_block, count.div_ceil(BLOCK), 1u32, part);
    let mut before = 0.0f32;
    if block > 0 {
        before = blocks[(first_block + block - 1) as usize];
    }
    let in_block = BLOCK * block;
    let own = BLOCK.min(count - in_block);
    let i = first_over(sums, first + stride * in_block, own, stride, part - before);
    let at = first + stride * (in_block + i);
    let mut share = sums[at as usize];
    if i > 0 {
        share -= sums[(at - stride) as usize];
    }
    DrawnPiece {
        piece: in_block + i,
        share,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_paths_have_a_thousand_samples() {
        for (pixels, samples, wanted) in [
            (0, 4, 1),
            (1, 1, 8),
            (200, 2, 1024),
            (1024, 16, 8192),
            (4096, 4, 4096),
            (4096, 5, 10240),
            (1001, 16, 8008),
            (1003, 9, 4514),
            (1 << 22, 1 << 12, MOST),
        ] {
            assert_eq!(
                samples_of_film(pixels, samples),
                wanted,
                "{pixels} {samples}"
            );
        }
    }
}
