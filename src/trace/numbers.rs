//! The random numbers of paths, by purpose, and where and when a camera ray starts.

use crate::cube::*;

use super::scene::Scene;
use crate::model::filter::uniform_disk;
use crate::model::integers::wide;
use crate::model::{V2, v2};
use crate::sampling::{Dimensions, Sampler, Stream};

/// Purposes of random numbers, each with a seed: paths, cones, edges, paths on both sides of these, and samples of edges
/// on the film.
pub(crate) const OF_PATHS: usize = 0;
pub(crate) const OF_CONES: usize = 1;
pub(crate) const OF_EDGES: usize = 2;
pub(crate) const OF_SIDES: usize = 3;
pub(crate) const ON_FILM: usize = 4;
pub(crate) const PURPOSES: usize = 5;

/// The pixel of random numbers that are of no pixel.
pub(crate) const NO_PIXEL: u32 = u32::MAX;

/// The source of random numbers for a purpose.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn sampler(scene: &Scene, purpose: usize) -> Sampler {
    Sampler {
        seed: wide(scene.seeds[2 * purpose], scene.seeds[2 * purpose + 1]),
        sequence: comptime!(scene.features.sequence),
        width: scene.width,
        samples: scene.samples_log,
        pixels: scene.sample_blocks,
    }
}

/// A point of the lens, on the unit disk, and a time in the shutter.
#[apply(record!)]
pub(crate) struct Exposure {
    pub lens: V2,
    pub time: f32,
}

/// Those of a path.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn exposure(scene: &Scene, numbers: &Stream) -> Exposure {
    let mut lens = v2(0.0, 0.0);
    let mut time = 0.0f32;
    if comptime!(scene.features.lens || scene.features.moves) {
        let drawn = numbers.draw(scene.points, Dimensions::lens_and_time());
        if comptime!(scene.features.lens) {
            lens = uniform_disk(drawn.x, drawn.y);
        }
        if comptime!(scene.features.moves) {
            time = drawn.z;
        }
    }
    Exposure { lens, time }
}
