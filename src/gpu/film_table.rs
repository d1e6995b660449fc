//! Edges on the films of views, as kernels have them: pieces, and a table of the films.

use crate::cube::*;
use rayon::prelude::*;

use crate::kernel::{Piece, View};
use crate::model::film::BLOCK;
use crate::model::lists::first_over;

/// Numbers of a piece: its first and last λ, the weight that may jump there, which becomes a sum over its block, its
/// edge, and the cell of the film that it is in; the last two are whole numbers, which f32 holds up to [`WHOLE`].
/// Behind all pieces are sums over blocks.
pub(super) const OF_PIECE: u32 = 5;
pub(super) const WHOLE: f32 = 16_777_216.0;

/// Words of the table for each view. The number of samples of all views so far, and the most that are its own; its
/// first piece, and the one past the last; the number of blocks of all views so far; the radius of the pixel filter,
/// by its bits. Then what kernels leave: the sum of all weights, by its bits, and the number of its samples.
pub(super) const ALL: usize = 0;
pub(super) const MOST: usize = 1;
pub(super) const FIRST_PIECE: usize = 2;
pub(super) const PAST_PIECE: usize = 3;
pub(super) const BLOCKS: usize = 4;
pub(super) const RADIUS: usize = 5;
pub(super) const TOTAL: usize = 6;
pub(super) const OWN: usize = 7;
pub(super) const OF_FILM: u32 = 8;

/// Edges on the films of views.
#[derive(Default)]
pub(crate) struct Films {
    /// [`OF_PIECE`] numbers for each, one view after another, and room for sums over blocks.
    pub(super) pieces: Vec<f32>,
    pub(super) count: u32,
    /// The table, then the row of each pixel if not all are asked for.
    pub(super) table: Vec<u32>,
    /// Samples of all views at most, and blocks.
    pub(super) samples: u32,
    pub(super) blocks: u32,
}

impl Films {
    /// From views, whether jumps are added on the film of each and the most samples for them, and the pixels if not all
    /// are asked for.
    pub fn new(views: &[(&View, Option<u32>)], pixels: Option<&[u32]>) -> Self {
        let mut films = Self::default();
        // So many that their numbers have room.
        let most = u32::MAX / 2 / views.len().max(1) as u32;
        let pieces = |&(view, samples): &(&View, Option<u32>)| {
            samples.map_or(Vec::new(), |_| view.film_pieces(|_| 1.0))
        };
        let pieces: Vec<Vec<Piece>> = views.par_iter().map(pieces).collect();
        let mut size = 0;
        for (&(view, samples), pieces) in views.iter().zip(&pieces) {
            let (width, height) = (view.settings.width, view.settings.height);
            size = (width * height) as usize;
            let own = samples.filter(|_| !pieces.is_empty()).unwrap_or(0);
            let own = own.min(most);
            films.samples += own;
            let first = films.count;
            films.count += pieces.len() as u32;
            films.blocks += (pieces.len() as u32).div_ceil(BLOCK);
            films.table.extend([films.samples, own, first, films.count]);
            let radius = view.filter.radius().to_bits();
            films.table.extend([films.blocks, radius, 0, 0]);
            let numbers = |p: &Piece| {
                let cell = p.cell(width, height) as f32;
                [p.from, p.to, p.weight, p.edge as f32, cell]
            };
            films.pieces.extend(pieces.iter().flat_map(numbers));
        }
        let blocks = films.blocks.max(1) as usize;
        films.pieces.resize(films.pieces.len() + blocks, 0.0);
        if let Some(pixels) = pixels {
            let first = films.table.len();
            films.table.resize(first + size, u32::MAX);
            for (row, &pixel) in pixels.iter().enumerate() {
                films.table[first + pixel as usize] = row as u32;
            }
        }
        films
    }
}

/// The view that a sample, a piece or a block belongs to, by the word of the table that counts those of all views so far.
#[cube]
pub(super) fn view_of(table: &[u32], views: u32, number: u32, #[comptime] word: usize) -> u32 {
    let mut low = 0u32;
    let mut high = views - 1;
    while low < high {
        let middle = (low + high) / 2;
        if table[(OF_FILM * middle) as usize + word] <= number {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    low
}

/// A piece that was drawn, and its share of the sum of all weights.
#[apply(record!)]
pub(super) struct DrawnPiece {
    /// Where its numbers begin.
    pub at: usize,
    pub share: f32,
}

/// The piece of a view that a part of the sum of all weights comes to, of `count` pieces of all views.
#[cube]
pub(super) fn draw_piece(
    pieces: &[f32],
    films: &[u32],
    view: u32,
    part: f32,
    count: u32,
) -> DrawnPiece {
    let film = (OF_FILM * view) as usize;
    let mut first_block = 0u32;
    if view > 0 {
        first_block = films[film - OF_FILM as usize + BLOCKS];
    }
    let sums = OF_PIECE * count + first_block;
    let block = first_over(pieces, sums, films[film + BLOCKS] - first_block, 1u32, part);
    let mut before = 0.0f32;
    if block > 0 {
        before = pieces[(sums + block - 1) as usize];
    }
    let first = films[film + FIRST_PIECE] + BLOCK * block;
    let own = BLOCK.min(films[film + PAST_PIECE] - first);
    let i = first_over(pieces, OF_PIECE * first + 2, own, OF_PIECE, part - before);
    let at = (OF_PIECE * (first + i)) as usize;
    let mut share = pieces[at + 2];
    if i > 0 {
        share -= pieces[at + 2 - OF_PIECE as usize];
    }
    DrawnPiece { at, share }
}
