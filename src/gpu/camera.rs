//! The beginning of a path: its random numbers and its camera ray.

use crate::cube::*;

use super::layout::{CAMERA, DUAL, FILTER, SEED, SEED_OF_CONES, WIDTH};
use super::numbers::{Four, Stream, numbers_of, on_disk};
use super::reading::{Scene, vector};
use crate::model::camera::{Camera, CameraRay, Dual};
use crate::model::filter::sample_filter;
use crate::model::{Pair, V2, v2};

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
pub(super) fn camera_ray(scene: &Scene, film: Four, more: Four, pixel: u32) -> CameraRay {
    let table = scene.header[FILTER] as usize;
    let middle = middle_of(scene, pixel);
    let x = middle.x + sample_filter(scene.floats, table, film.x);
    let y = middle.y + sample_filter(scene.floats, table, film.y);
    let mut on_lens = v2(0.0, 0.0);
    if comptime!(scene.features.lens) {
        on_lens = on_disk(more.x, more.y);
    }
    camera(scene).ray(x, y, on_lens.x, on_lens.y)
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
    let numbers = numbers_of(scene, SEED, pixel, sample);
    let cones = numbers_of(scene, SEED_OF_CONES, pixel, sample);
    let film = numbers.film(scene);
    let mut more = film;
    if comptime!(scene.features.lens || scene.features.moves) {
        more = numbers.lens_and_time(scene);
    }
    let mut time = 0.0f32;
    if comptime!(scene.features.moves) {
        time = more.z;
    }
    Beginning {
        numbers,
        cones,
        film,
        time,
        ray: camera_ray(scene, film, more, pixel),
    }
}
