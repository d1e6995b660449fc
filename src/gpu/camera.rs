//! The beginning of a path: its random numbers and its camera ray.

use burn::cubecl::{self, prelude::*};

use super::Features;
use super::layout::{CAMERA, DUAL, FILTER, SEED, SEED_OF_CONES, WIDTH};
use super::numbers::{Four, Stream, numbers_of, on_disk};
use super::reading::vector;
use crate::model::camera::{Camera, CameraRay, Dual};
use crate::model::filter::sample_filter;
use crate::model::{Pair, V2, v2};

#[cube]
pub(super) fn camera(floats: &[f32], #[comptime] parallel: bool) -> Camera {
    Camera {
        eye: vector(floats, CAMERA as u32),
        across: vector(floats, CAMERA as u32 + 3),
        upward: vector(floats, CAMERA as u32 + 6),
        forward: vector(floats, CAMERA as u32 + 9),
        dual: Dual {
            x: vector(floats, DUAL as u32),
            y: vector(floats, DUAL as u32 + 3),
            z: vector(floats, DUAL as u32 + 6),
        },
        lens: Pair {
            first: vector(floats, CAMERA as u32 + 12),
            second: vector(floats, CAMERA as u32 + 15),
        },
        aperture: 0.0f32.runtime(),
        per_focus: floats[CAMERA + 18],
        parallel: parallel.runtime(),
        width: floats[CAMERA + 19],
        height: floats[CAMERA + 20],
        filter: floats[CAMERA + 21],
    }
}

/// The film point, in pixels, in the middle of a pixel.
#[cube]
pub(super) fn middle_of(words: &[u32], pixel: u32) -> V2 {
    let width = words[WIDTH];
    v2((pixel % width) as f32 + 0.5, (pixel / width) as f32 + 0.5)
}

#[cube]
pub(super) fn camera_ray(
    floats: &[f32],
    words: &[u32],
    film: Four,
    more: Four,
    pixel: u32,
    #[comptime] features: Features,
) -> CameraRay {
    let table = words[FILTER] as usize;
    let middle = middle_of(words, pixel);
    let x = middle.x + sample_filter(floats, table, film.x);
    let y = middle.y + sample_filter(floats, table, film.y);
    let mut on_lens = v2(0.0, 0.0);
    if comptime!(features.lens) {
        on_lens = on_disk(more.x, more.y);
    }
    camera(floats, features.parallel).ray(x, y, on_lens.x, on_lens.y)
}

/// A path's random numbers, and its camera ray.
#[derive(CubeType, CubeTypeMut, Clone, Copy, Debug)]
#[expand(derive(Clone, Copy))]
pub(super) struct Beginning {
    pub numbers: Stream,
    pub cones: Stream,
    pub film: Four,
    pub time: f32,
    pub ray: CameraRay,
}

/// The beginning of a path of a pixel.
#[cube]
pub(super) fn begin(
    floats: &[f32],
    words: &[u32],
    pixel: u32,
    sample: u32,
    #[comptime] features: Features,
) -> Beginning {
    let numbers = numbers_of(words, SEED, pixel, sample, features.sobol);
    let cones = numbers_of(words, SEED_OF_CONES, pixel, sample, features.sobol);
    let film = numbers.film(words, features.sobol);
    let mut more = film;
    if comptime!(features.lens || features.moves) {
        more = numbers.lens_and_time(words, features.sobol);
    }
    let mut time = 0.0f32;
    if comptime!(features.moves) {
        time = more.z;
    }
    Beginning {
        numbers,
        cones,
        film,
        time,
        ray: camera_ray(floats, words, film, more, pixel, features),
    }
}
