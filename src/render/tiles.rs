//! Tiles of pixels and samples.

use std::ops::Range;

use super::options::RenderOptions;

/// The pixels `first..first + pixels` with the samples `from..to` of each.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tile {
    pub first: usize,
    pub pixels: usize,
    pub from: u32,
    pub to: u32,
}

/// Divides the samples of pixels into tiles of about `rays` rays, in order of pixels, then samples. `rays_per_tile` of
/// the options takes precedence.
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
