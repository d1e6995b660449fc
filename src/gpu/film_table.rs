//! Edges on the films of views, as kernels have them: pieces, and a table of the films.

use burn::cubecl::{self, prelude::*};

use crate::kernel::{Piece, View};

/// Numbers of a piece: its first and last λ, the weight that may jump there, which becomes a sum over its block, its
/// edge, and the cell of the film that it is in. Behind all pieces are sums over blocks.
pub(super) const OF_PIECE: u32 = 5;
/// Pieces of a block.
pub(super) const BLOCK: u32 = 128;

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
#[derive(Clone, Default)]
pub(crate) struct Films {
    /// [`OF_PIECE`] numbers for each, one view after another.
    pub(super) pieces: Vec<f32>,
    /// The table, then the row of each pixel if not all are asked for.
    pub(super) table: Vec<u32>,
    /// Samples of all views at most, and blocks.
    pub(super) samples: u32,
    pub(super) blocks: u32,
}

impl Films {
    /// From views, whether jumps are added on the film of each and the most samples for them, and the pixels if not all
    /// are asked for.
    pub fn new<'a>(
        views: impl ExactSizeIterator<Item = (&'a View, Option<u32>)>,
        pixels: Option<&[u32]>,
    ) -> Self {
        let mut films = Self::default();
        // So many that their numbers have room.
        let most = u32::MAX / 2 / views.len().max(1) as u32;
        let mut size = 0;
        for (view, samples) in views {
            let (width, height) = (view.settings.width, view.settings.height);
            size = (width * height) as usize;
            let pieces = samples.map(|_| view.film_pieces(|_| 1.0));
            let pieces = pieces.unwrap_or_default();
            let own = samples.filter(|_| !pieces.is_empty()).unwrap_or(0);
            let own = own.min(most);
            films.samples += own;
            let first = films.pieces.len() as u32 / OF_PIECE;
            films.blocks += (pieces.len() as u32).div_ceil(BLOCK);
            let past = first + pieces.len() as u32;
            films.table.extend([films.samples, own, first, past]);
            let radius = view.filter.radius().to_bits();
            films.table.extend([films.blocks, radius, 0, 0]);
            let numbers = |p: &Piece| {
                let cell = p.cell(width, height) as f32;
                [p.from, p.to, p.weight, p.edge as f32, cell]
            };
            films.pieces.extend(pieces.iter().flat_map(numbers));
        }
        if let Some(pixels) = pixels {
            let first = films.table.len();
            films.table.resize(first + size, u32::MAX);
            for (row, &pixel) in pixels.iter().enumerate() {
                films.table[first + pixel as usize] = row as u32;
            }
        }
        films
    }

    pub(super) fn count(&self) -> u32 {
        self.pieces.len() as u32 / OF_PIECE
    }
}

/// The first view whose word of the table, which counts those of all views so far, is more than a number.
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
#[derive(CubeType, CubeTypeMut, Clone, Copy, Debug)]
#[expand(derive(Clone, Copy))]
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
    // The last of those that are searched, if rounding leaves none.
    let mut low = first_block;
    let mut high = films[film + BLOCKS] - 1;
    while low < high {
        let middle = (low + high) / 2;
        if pieces[(OF_PIECE * count + middle) as usize] <= part {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    let mut before = 0.0f32;
    if low > first_block {
        before = pieces[(OF_PIECE * count + low - 1) as usize];
    }
    let rest = part - before;
    let first = films[film + FIRST_PIECE] + BLOCK * (low - first_block);
    low = first;
    high = (first + BLOCK).min(films[film + PAST_PIECE]) - 1;
    while low < high {
        let middle = (low + high) / 2;
        if pieces[(OF_PIECE * middle) as usize + 2] <= rest {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    let at = (OF_PIECE * low) as usize;
    let mut share = pieces[at + 2];
    if low > first {
        share -= pieces[at + 2 - OF_PIECE as usize];
    }
    DrawnPiece { at, share }
}
