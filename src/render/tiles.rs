//! Pixels and samples in tiles, and the random numbers of a render.

use super::options::RenderOptions;
use crate::sampling::Sampler;

/// Pixels `first..first + pixels` with samples `from..to`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tile {
    pub first: usize,
    pub pixels: usize,
    pub from: u32,
    pub to: u32,
}

/// The random numbers of a render.
pub(super) fn sampler(options: &RenderOptions) -> Sampler {
    Sampler::new(
        options.seed,
        options.sampling.sequence,
        options.width,
        options.samples,
    )
}

/// Pixels in pieces of about so many rays.
pub(super) fn tiles(options: &RenderOptions, pixels: usize, rays: usize) -> Vec<Tile> {
    let samples = options.samples as usize;
    let rays = options.rays_per_tile.unwrap_or(rays);
    let per_tile = (rays / samples).max(1);
    let samples_per_tile = rays.min(samples);
    let mut tiles = Vec::new();
    for first in (0..pixels).step_by(per_tile) {
        for from in (0..samples).step_by(samples_per_tile) {
            tiles.push(Tile {
                first,
                pixels: per_tile.min(pixels - first),
                from: from as u32,
                to: (from + samples_per_tile).min(samples) as u32,
            });
        }
    }
    tiles
}
