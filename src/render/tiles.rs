//! Pixels and their samples in pieces.

use std::ops::Range;

use super::options::RenderOptions;

/// Pixels `first..first + pixels` with samples `from..to`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tile {
    pub first: usize,
    pub pixels: usize,
    pub from: u32,
    pub to: u32,
}

/// Samples of pixels in pieces of about so many rays, unless the options say how many: in order of pixels, then samples.
pub(super) fn tiles(
    options: &RenderOptions,
    pixels: usize,
    samples: Range<u32>,
    rays: usize,
) -> Vec<Tile> {
    let rays = options.rays_per_tile.unwrap_or(rays);
    let count = samples.len();
    let per_tile = (rays / count).max(1);
    let samples_per_tile = rays.min(count);
    let mut tiles = Vec::new();
    for first in (0..pixels).step_by(per_tile) {
        for from in samples.clone().step_by(samples_per_tile) {
            tiles.push(Tile {
                first,
                pixels: per_tile.min(pixels - first),
                from,
                to: samples
                    .end
                    .min(from.saturating_add(samples_per_tile as u32)),
            });
        }
    }
    tiles
}
