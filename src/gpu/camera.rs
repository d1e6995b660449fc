//! The beginning of a path: its random numbers and its camera ray.

use softray_kernels::cube::*;

use softray_kernels::model::Four;
use softray_kernels::model::camera::{Camera, CameraRay, camera_at};
use softray_kernels::model::filter::sample_filter;
use softray_kernels::sampling::{Dimensions, Stream};
use softray_kernels::trace::{Exposure, OF_CONES, OF_PATHS, Scene, exposure, middle_of, sampler};

#[cube]
pub(super) fn camera(scene: &Scene) -> Camera {
    camera_at(scene.settings, comptime!(scene.features.parallel).runtime())
}

/// The random numbers of a path, and its camera ray.
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
    /// Returns two pairs of random numbers, for the cones of a bounce ray and of a shadow ray.
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

/// Returns the beginning of a path of a pixel.
#[cube]
pub(super) fn begin(scene: &Scene, pixel: u32, sample: u32) -> Beginning {
    let numbers = sampler(scene, OF_PATHS).stream(pixel, sample);
    let cones = sampler(scene, OF_CONES).stream(pixel, sample);
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
