//! The choice of an edge, and of a point on it, on the film.

use super::pieces::{Piece, PixelGradients};
use crate::kernel::view::View;
use crate::model::film::{BLOCK, draw_piece};
use crate::model::segment::OnSegment;

/// Pieces of edges on the film of a view.
pub(crate) struct FilmEdges {
    pieces: Vec<Piece>,
    /// Prefix sums of the weights within each block. Sums over all pieces would lose small weights by rounding.
    sums: Vec<f32>,
    /// Prefix sums of the weights of blocks.
    blocks: Vec<f32>,
}

impl FilmEdges {
    /// Collects the pieces of edges that jump on the film where the loss depends on it.
    pub fn new(view: &View, pixels: &PixelGradients) -> Self {
        let pieces = view.film_pieces(|[x, y]| pixels.near(x, y));
        let mut sums = Vec::with_capacity(pieces.len());
        let mut blocks = Vec::new();
        let mut total = 0.0;
        for block in pieces.chunks(BLOCK as usize) {
            let mut sum = 0.0;
            for piece in block {
                sum += piece.weight;
                sums.push(sum);
            }
            total += sum;
            blocks.push(total);
        }
        Self {
            pieces,
            sums,
            blocks,
        }
    }

    pub fn is_empty(&self) -> bool {
        self.pieces.is_empty()
    }

    /// Draws an edge and a point of it from two uniform numbers.
    #[inline(always)]
    pub(super) fn choose(&self, u: f32, v: f32) -> Option<(u32, OnSegment)> {
        let count = self.pieces.len() as u32;
        let total = self.blocks[self.blocks.len() - 1];
        let drawn = draw_piece(&self.sums, 0, 1, count, &self.blocks, 0, u * total);
        let piece = &self.pieces[drawn.piece as usize];
        let point = drawn.point(piece.from, piece.to, total, v);
        (drawn.share > 0.0).then_some((piece.edge, point))
    }
}
