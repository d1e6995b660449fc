//! The beginning of a path: its random numbers and its camera ray.

use crate::cube::*;

use crate::model::camera::{Camera, CameraRay, Dual};
use crate::model::filter::{sample_filter, uniform_disk};
use crate::model::integers::wide;
use crate::model::lists::vector;
use crate::model::{Pair, V2, v2};
use crate::sampling::{Dimensions, Four, Sampler, Stream};
use crate::trace::{CAMERA, DUAL, Scene, middle_of};

/// Seeds of random numbers: of paths, of cones, of edges, of paths on both sides of these, and of samples on the film.
pub(super) const SEED: usize = 0;
pub(super) const SEED_OF_CONES: usize = 2;
pub(super) const SEED_OF_EDGES: usize = 4;
pub(super) const SEED_OF_SIDES: usize = 6;
pub(super) const SEED_OF_FILM: usize = 8;

/// The source of random numbers with a seed.
#[cube]
pub(super) fn sampler(scene: &Scene, seed: usize) -> Sampler {
    Sampler {
        seed: wide(scene.seeds[seed], scene.seeds[seed + 1]),
        sequence: comptime!(scene.features.sequence),
        width: scene.width,
        samples: scene.samples_log,
        pixels: scene.sample_blocks,
    }
}

#[cube]
pub(super) fn camera(scene: &Scene) -> Camera {
    Camera {
        eye: vector(scene.settings, CAMERA),
        across: vector(scene.settings, CAMERA + 3),
        upward: vector(scene.settings, CAMERA + 6),
        forward: vector(scene.settings, CAMERA + 9),
        dual: Dual {
            x: vector(scene.settings, DUAL),
            y: vector(scene.settings, DUAL + 3),
            z: vector(scene.settings, DUAL + 6),
        },
        lens: Pair {
            first: vector(scene.settings, CAMERA + 12),
            second: vector(scene.settings, CAMERA + 15),
        },
        aperture: 0.0f32.runtime(),
        per_focus: scene.settings[18],
        parallel: comptime!(scene.features.parallel).runtime(),
        width: scene.settings[19],
        height: scene.settings[20],
        filter: scene.settings[21],
    }
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

#[cube]
impl Beginning {
    /// Two pairs of random numbers, for the cones of a bounce and of a shadow ray.
    pub fn cone(&self, scene: &Scene, bounce: u32) -> Four {
        let mut drawn = Four::default();
        if comptime!(scene.features.cones) {
            drawn = self.cones.draw(scene.points, Dimensions::of_set(bounce));
        }
        drawn
    }

    pub fn direction(&self, scene: &Scene, bounce: u32) -> Four {
        self.numbers
            .draw(scene.points, Dimensions::direction(bounce))
    }

    pub fn choices(&self, scene: &Scene, bounce: u32) -> Four {
        self.numbers.draw(scene.points, Dimensions::choices(bounce))
    }
}

/// The beginning of a path of a pixel.
#[cube]
pub(super) fn begin(scene: &Scene, pixel: u32, sample: u32) -> Beginning {
    let numbers = sampler(scene, SEED).stream(pixel, sample);
    let cones = sampler(scene, SEED_OF_CONES).stream(pixel, sample);
    let film = numbers.draw(scene.points, Dimensions::film());
    let exposure: Exposure = exposure(scene, &numbers);
    let (middle, lens) = (middle_of(scene, pixel), exposure.lens);
    let x = middle.x + sample_filter(scene.filter, 0usize, film.x);
    let y = middle.y + sample_filter(scene.filter, 0usize, film.y);
    Beginning {
        numbers,
        cones,
        film,
        time: exposure.time,
        ray: camera(scene).ray(x, y, lens.x, lens.y),
    }
}
