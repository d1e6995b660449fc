//! Edge sampling on the film: number of samples, drawing of edge pieces, and importance of pixels.

use super::jumps::LOW_SAMPLES_LOG;
use super::lists::first_over;
use super::segment::OnSegment;
use crate::cube::*;

/// Side length in pixels of a cell. Edges in a cell are drawn in proportion to how much the loss depends on the
/// pixels there.
pub const CELL: u32 = 8;
/// Weight of the pixels of neighboring cells, relative to a cell's own.
pub const NEIGHBORS: f32 = 0.1;

/// Offset of grids on films from pixels, so that rounding does not move points of symmetric scenes to other cells.
pub const OFFSET: f32 = 0.137;

/// Returns the index of the cell around a film point. Cells are numbered row by row.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn cell_at(x: f32, y: f32, width: u32, height: u32) -> u32 {
    let x = min(max(x + OFFSET, 0.0), width as f32 - 1.0) as u32 / CELL;
    let y = min(max(y + OFFSET, 0.0), height as f32 - 1.0) as u32 / CELL;
    y * width.div_ceil(CELL) + x
}

/// Number of edge pieces whose weights are summed as one block.
pub const BLOCK: u32 = 128;

/// Maximum number of edge samples on a film.
pub const MAX_EDGE_SAMPLES: u32 = 1_000_000_000;

/// Returns the number of edge samples on the film for `pixels` pixels that a loss depends on, with `samples` samples
/// each.
///
/// This is one sample for two paths, or for four if a pixel has few ([`LOW_SAMPLES_LOG`]). It is at least 1024 samples,
/// or eight per path if that is less; so few samples take no noticeable time.
#[cfg_attr(feature = "gpu", cube)]
pub fn samples_of_film(pixels: u32, samples: u32) -> u32 {
    // The product would overflow otherwise.
    if pixels as f32 * samples as f32 <= 4.0e9 {
        let paths = pixels * samples;
        let few = (8 * paths.min(1024)).min(1024);
        let each = select(samples <= 1u32 << LOW_SAMPLES_LOG, 4u32, 2u32);
        paths.div_ceil(each).max(few).max(1).min(MAX_EDGE_SAMPLES)
    } else {
        MAX_EDGE_SAMPLES
    }
}

/// A drawn edge piece, and its weight as part of the sum of all weights.
#[apply(record!)]
pub struct DrawnPiece {
    pub piece: u32,
    pub share: f32,
}

#[cfg_attr(feature = "gpu", cube)]
impl DrawnPiece {
    /// Samples a point uniformly on the piece, which extends over λ in [from, to] of its edge. `total` is the sum of
    /// all weights.
    #[inline(always)]
    pub fn point(&self, from: f32, to: f32, total: f32, u: f32) -> OnSegment {
        let length = to - from;
        OnSegment {
            lambda: from + length * u,
            per_density: length * (total / max(self.share, 1e-37)),
        }
    }
}

/// Returns the piece at which the running sum of weights exceeds `part`, among `count` pieces.
///
/// The running sums within blocks are stored `stride` apart from `first` on, the running sums over blocks from
/// `first_block` on.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn draw_piece(
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
            (1 << 22, 1 << 12, MAX_EDGE_SAMPLES),
        ] {
            assert_eq!(
                samples_of_film(pixels, samples),
                wanted,
                "{pixels} {samples}"
            );
        }
    }
}
