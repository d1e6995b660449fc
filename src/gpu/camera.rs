//! The beginning of a path: its random numbers and its camera ray.

use crate::cube::*;

use super::layout::{BLOCKS, CAMERA, DUAL, FILTER, SAMPLES_LOG, SEED, SEED_OF_CONES, WIDTH};
use super::reading::{Scene, vector};
use crate::model::camera::{Camera, CameraRay, Dual};
use crate::model::filter::{sample_filter, uniform_disk};
use crate::model::integers::wide;
use crate::model::{Pair, V2, v2};
use crate::sampling::{Dimensions, Four, Sampler, Stream};

/// The source of random numbers whose seed is at a place of the header.
#[cube]
pub(super) fn sampler(scene: &Scene, seed: usize) -> Sampler {
    Sampler {
        seed: wide(scene.header[seed], scene.header[seed + 1]),
        sequence: comptime!(scene.features.sequence),
        width: scene.header[WIDTH],
        samples: scene.header[SAMPLES_LOG],
        pixels: scene.header[BLOCKS],
    }
}

#[cube]
pub(super) fn camera(scene: &Scene) -> Camera {
    Camera {
        eye: vector(scene.settings, CAMERA as u32),
        across: vector(scene.settings, CAMERA as u32 + 3),
        upward: vector(scene.settings, CAMERA as u32 + 6),
        forward: vector(scene.settings, CAMERA as u32 + 9),
        dual: Dual {
            x: vector(scene.settings, DUAL as u32),
            y: vector(scene.settings, DUAL as u32 + 3),
            z: vector(scene.settings, DUAL as u32 + 6),
        },
        lens: Pair {
            first: vector(scene.settings, CAMERA as u32 + 12),
            second: vector(scene.settings, CAMERA as u32 + 15),
        },
        aperture: 0.0f32.runtime(),
        per_focus: scene.settings[CAMERA + 18],
        parallel: comptime!(scene.features.parallel).runtime(),
        width: scene.settings[CAMERA + 19],
        height: scene.settings[CAMERA + 20],
        filter: scene.settings[CAMERA + 21],
    }
}

/// The film point, in pixels, in the middle of a pixel.
#[cube]
pub(super) fn middle_of(scene: &Scene, pixel: u32) -> V2 {
    let width = scene.header[WIDTH];
    v2((pixel % width) as f32 + 0.5, (pixel / width) as f32 + 0.5)
}

#[cube]
fn camera_ray(scene: &Scene, film: Four, lens: V2, pixel: u32) -> CameraRay {
    let table = scene.header[FILTER] as usize;
    let middle = middle_of(scene, pixel);
    let x = middle.x + sample_filter(scene.floats, table, film.x);
    let y = middle.y + sample_filter(scene.floats, table, film.y);
    camera(scene).ray(x, y, lens.x, lens.y)
}

/// A point of the lens, on the unit disk, and a time in the shutter.
#[apply(record!)]
pub(super) struct Exposure {
    pub lens: V2,
    pub time: f32,
}

/// Those of a path.
#[cube]
pub(super) fn exposure(scene: &Scene, numbers: &Stream) -> Exposure {
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

/// A path's random numbers, and its camera ray.
#[apply(record!)]
pub(super) struct Beginning {
    pub numbers: Stream,
    pub cones: Stream,
    pub film: Four,
    pub time: f32,
    pub ray: CameraRay,
}

/// The beginning of a path of a pixel.
#[cube]
pub(super) fn begin(scene: &Scene, pixel: u32, sample: u32) -> Beginning {
    let numbers = sampler(scene, SEED).stream(pixel, sample);
    let cones = sampler(scene, SEED_OF_CONES).stream(pixel, sample);
    let film = numbers.draw(scene.points, Dimensions::film());
    let exposure: Exposure = exposure(scene, &numbers);
    Beginning {
        numbers,
        cones,
        film,
        time: exposure.time,
        ray: camera_ray(scene, film, exposure.lens, pixel),
    }
}
