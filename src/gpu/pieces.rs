//! The part of a batch that a launch serves.

use crate::cube::*;

/// Samples of pixels, which are counted over all views.
#[derive(CubeType, CubeLaunch, Clone, Copy, Debug)]
#[expand(derive(Clone, Copy))]
pub(super) struct Piece {
    /// The first pixel, the distance to the next, and their number.
    pub first: u32,
    pub stride: u32,
    pub count: u32,
    /// The first sample of each, and the one past the last.
    pub from: u32,
    pub past: u32,
    /// Pixels of a view.
    pub of_view: u32,
}

#[cube]
impl Piece {
    pub fn paths(&self) -> u32 {
        self.count * (self.past - self.from)
    }
}

/// A pixel of a view.
#[apply(record!)]
pub(super) struct PixelAt {
    /// Its place among those of all views.
    pub row: u32,
    pub view: u32,
    pub pixel: u32,
}

/// A pixel of a piece.
#[cube]
pub(super) fn pixel_at(
    pixels: &[u32],
    piece: Piece,
    slot: u32,
    #[comptime] listed: bool,
) -> PixelAt {
    let row = piece.first + slot * piece.stride;
    let mut pixel = row % piece.of_view;
    if listed {
        pixel = pixels[pixel as usize];
    }
    PixelAt {
        row,
        view: row / piece.of_view,
        pixel,
    }
}
