//! A scene as a camera sees it.

use std::ops::Range;
use std::sync::Arc;

use super::camera::HostCamera;
use super::edges::EdgeSets;
use super::gradient::CameraSums;
use super::gradient::Wanted;
use super::scene::KernelScene;
use crate::model::camera::Camera;
use crate::model::cone::{Bend, bend};
use crate::model::filter::{PixelFilter, uniform_disk};
use crate::model::{V2, V3, v2};
use crate::sampling::{Dimensions, Numbers, Sampler};
use crate::scene::ParameterId;

/// A scene as a camera sees it, with the settings of a render.
pub(crate) struct View {
    pub scene: Arc<KernelScene>,
    pub settings: ViewSettings,
    pub host_camera: HostCamera,
    pub camera: Camera,
    pub filter: PixelFilter,
    /// The tangent of the half-angle of the cones of bounce and shadow rays.
    pub cone: f32,
    /// Random numbers for the kernels of cones.
    pub cones: Sampler,
    /// Random numbers for edges.
    pub edges: Sampler,
    /// Random numbers for paths on both sides of edges.
    pub sides: Sampler,
    /// Random numbers for edges on the film.
    pub film: Sampler,
    pub arch: pulp::Arch,
    /// The sets of random numbers that most paths use (`Sampler::run`).
    pub drawn: u8,
    /// Whether there is no light at all.
    pub dark: bool,
    /// Whether bounce rays that miss bring light of the environment; that of a map is gathered at
    /// surfaces instead, if strategies are combined.
    pub sees_sky: bool,
    pub gathers_map: bool,
    /// Whether points on emitters are chosen by the BSDF as well.
    pub combined: bool,
    pub wanted: Wanted,
    /// Edges that something can jump at.
    pub edge_sets: Option<Arc<EdgeSets>>,
    pub has_edges: bool,
}

/// The settings that a view is made from beside scene and camera.
#[derive(Clone)]
pub(crate) struct ViewSettings {
    pub width: u32,
    pub height: u32,
    /// The least radius of the pixel filter, in pixels.
    pub pixels: f64,
    /// The tangent of the half-angle of the cones of bounce and shadow rays.
    pub cone: f64,
    /// The same for camera rays, where that is wider than the filter.
    pub camera_cone: f64,
    pub bounces: u32,
    pub roulette_after: Option<u32>,
    pub multiple_importance: bool,
    pub sampler: Sampler,
    /// Whether gradients have the interior derivative, beside the jumps.
    pub interior: bool,
}

impl View {
    pub fn new(
        scene: Arc<KernelScene>,
        camera: HostCamera,
        settings: ViewSettings,
        wanted: Wanted,
        edge_sets: Option<Arc<EdgeSets>>,
    ) -> Self {
        let frame = &scene.frame;
        let mut model = camera.model(frame, settings.width, settings.height);
        let pixels_per_tangent = 0.5 * f64::from(settings.height) / camera.half_height;
        let wide = settings.camera_cone * pixels_per_tangent;
        let filter = PixelFilter::of_cone(settings.pixels, wide);
        model.filter = filter.cone_radius();
        let has_map = scene.sky.map().is_some();
        let gathers_map = has_map && settings.multiple_importance;
        let sees_sky = !scene.sky.is_black() && !gathers_map;
        let combined = settings.multiple_importance && !scene.emitters.all().is_empty();
        let mut view = Self {
            host_camera: camera,
            camera: model,
            filter,
            cone: settings.cone as f32,
            cones: settings.sampler.of_purpose(1),
            edges: settings.sampler.of_purpose(2),
            sides: settings.sampler.of_purpose(3),
            film: settings.sampler.of_purpose(4).of_one_pixel(),
            arch: pulp::Arch::new(),
            drawn: 0,
            dark: scene.emitters.is_empty() && scene.sky.is_black(),
            sees_sky,
            gathers_map,
            combined,
            has_edges: edge_sets.as_ref().is_some_and(|e| !e.is_empty()),
            edge_sets,
            wanted,
            scene,
            settings,
        };
        view.drawn = view.sets();
        view
    }

    /// Adds the derivatives by parameters of the camera at their places.
    pub fn write_camera(
        &self,
        sums: &CameraSums,
        places: &[(ParameterId, Range<usize>)],
        all: &mut [f64],
    ) {
        let aspect = f64::from(self.settings.width) / f64::from(self.settings.height);
        let unit = self.scene.frame.unit;
        let filter = f64::from(self.camera.filter);
        self.host_camera
            .backward(sums, unit, (aspect, filter), places, all);
    }

    /// The sets of random numbers that paths use at their first surfaces (`Dimensions`).
    fn sets(&self) -> u8 {
        let glossy = self.scene.glossy;
        let to_the_end = self.sees_sky || self.gathers_map || (glossy && self.combined);
        let directions = self.settings.bounces.saturating_add(u32::from(to_the_end));
        let more = glossy || self.gathers_map || self.settings.roulette_after.is_some();
        let mut sets = 1;
        if self.camera.aperture > 0.0 || self.scene.velocities.is_some() {
            sets |= 2;
        }
        for bounce in 0..directions.min(3) {
            sets |= if more { 12 } else { 4 } << (2 * bounce);
        }
        sets
    }

    /// A point of the lens, on the unit disk.
    #[inline(always)]
    pub fn lens_point(&self, numbers: &Numbers) -> V2 {
        if self.camera.aperture == 0.0 {
            return v2(0.0, 0.0);
        }
        let drawn = numbers.draw(Dimensions::lens_and_time());
        uniform_disk(drawn.x, drawn.y)
    }

    /// The time of a path in the shutter.
    #[inline(always)]
    pub fn time(&self, numbers: &Numbers) -> f32 {
        if self.scene.velocities.is_some() {
            numbers.draw(Dimensions::lens_and_time()).z
        } else {
            0.0
        }
    }

    /// A ray of the cone about an axis, on the outer side of a surface.
    #[inline(always)]
    pub fn bend(&self, axis: V3, normal: V3, u: f32, v: f32) -> Bend {
        bend(axis, normal, self.cone, u, v)
    }
}
