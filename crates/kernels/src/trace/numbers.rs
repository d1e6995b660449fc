//! Random numbers of paths by purpose, and the lens point and shutter time of a camera ray.

use crate::cube::*;

use super::scene::Scene;
use crate::model::filter::uniform_disk;
use crate::model::integers::wide;
use crate::model::{V2, v2};
use crate::sampling::{Dimensions, Sampler, Stream};

/// Purposes of random numbers, each with its own seed: paths, cones, edges, paths on both sides of edges, and edge
/// samples on the film.
pub const OF_PATHS: usize = 0;
pub const OF_CONES: usize = 1;
pub const OF_EDGES: usize = 2;
pub const OF_SIDES: usize = 3;
pub const ON_FILM: usize = 4;
pub const PURPOSES: usize = 5;

/// Pixel index of random numbers that belong to no pixel.
pub const NO_PIXEL: u32 = u32::MAX;

/// Returns the source of random numbers for a purpose.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn sampler(scene: &Scene, purpose: usize) -> Sampler {
    Sampler {
        seed: wide(scene.seeds[2 * purpose], scene.seeds[2 * purpose + 1]),
        sequence: comptime!(scene.features.sequence),
        width: scene.width,
        samples: scene.samples_log,
        pixels: scene.sample_blocks,
    }
}

/// A lens point on the unit disk, and a shutter time.
#[apply(record!)]
pub struct Exposure {
    pub lens: V2,
    pub time: f32,
}

/// Returns the lens point and the shutter time of a path.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn exposure(scene: &Scene, numbers: &Stream) -> Exposure {
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
