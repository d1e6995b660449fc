//! The choice of an edge, and of a point on it, on the film.

use crate::kernel::pixels::PixelGradients;
use crate::kernel::view::View;
use crate::model::film::{BLOCK, draw_piece};
use crate::model::segment::OnSegment;

/// A piece of an edge on the film: the edge, and two values of λ.
type Piece = (u32, [f32; 2]);

/// Pieces of edges on the film of a view.
pub struct FilmEdges {
    pieces: Vec<Piece>,
    /// Prefix sums of the weights within each block. Sums over all pieces would lose small weights by rounding.
    sums: Vec<f32>,
    /// Prefix sums of the weights of blocks.
    blocks: Vec<f32>,
}

impl FilmEdges {
    /// Collects the pieces of edges that jump on the film where the loss depends on it. The weight of each is multiplied
    /// by how much it does.
    pub fn new(view: &View, pixels: &PixelGradients) -> Self {
        let weighted = view.film_slots(|[edge, _], piece| {
            let visible = piece.weight > 0.0;
            let weight = visible.then(|| piece.weight * pixels.near(piece.middle))?;
            (weight > 0.0).then_some(((edge, [piece.from, piece.to]), weight))
        });
        let (pieces, mut sums): (Vec<Piece>, Vec<f32>) = weighted.into_iter().unzip();
        let mut blocks = Vec::new();
        let mut total = 0.0;
        for block in sums.chunks_mut(BLOCK as usize) {
            let mut sum = 0.0;
            for weight in block {
                sum += *weight;
                *weight = sum;
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
        let (edge, [from, to]) = self.pieces[drawn.piece as usize];
        let point = drawn.point(from, to, total, v);
        (drawn.share > 0.0).then_some((edge, point))
    }
}
