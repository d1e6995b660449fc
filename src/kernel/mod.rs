//! Path tracing on the host, each path from camera to end in one go, in f32, with derivatives by hand.
//!
//! `path` traces forward; `backward` traces a path again and goes back along it; `boundary` adds what
//! the jumps of visibility at edges contribute. `scene` holds what is traced, `gradient` the sums of
//! derivatives.

mod backward;
mod boundary;
mod camera;
mod emitters;
mod gradient;
mod path;
mod records;
mod scene;
mod sky;
mod surface;

use std::ops::Range;
use std::sync::Arc;

use crate::accel::{Machine, Task, dispatch};
use crate::model::camera::Camera;
use crate::model::filter::PixelFilter;
use crate::scene::ParameterId;
use crate::transport::sampler::{Numbers, RUN, Run, Sampler};

pub(crate) use camera::HostCamera;
pub(crate) use gradient::{Sums, Wanted};
pub(crate) use path::Seen;
pub(crate) use records::{RayCounts, Work};
pub(crate) use scene::KernelScene;

pub(crate) use boundary::{EdgeSets, PixelGradients};
use path::{Path, Walks};

/// A scene as a camera sees it, with the settings of a render.
pub(crate) struct View {
    pub scene: Arc<KernelScene>,
    host_camera: HostCamera,
    camera: Camera,
    filter: PixelFilter,
    /// The tangent of the half-angle of the cones of bounce and shadow rays.
    cone: f32,
    sampler: Sampler,
    /// For the kernels of cones, and for edges.
    cones: Sampler,
    edges: Sampler,
    /// For paths on both sides of edges.
    sides: Sampler,
    /// For edges on the film.
    film: Sampler,
    bounces: u32,
    roulette_after: Option<u32>,
    width: u32,
    height: u32,
    arch: pulp::Arch,
    /// The sets of random numbers that most paths use (`Sampler::run`).
    drawn: u8,
    /// Whether there is no light at all.
    dark: bool,
    /// Whether bounce rays that miss bring light of the environment; that of a map is gathered at
    /// surfaces instead, if strategies are combined.
    sees_sky: bool,
    gathers_map: bool,
    /// Whether points on emitters are chosen by the BSDF as well.
    combined: bool,
    pub wanted: Wanted,
    interior: bool,
    /// Edges that something can jump at.
    edge_sets: Option<Arc<EdgeSets>>,
    has_edges: bool,
}

/// What a view is made from beside scene and camera.
#[derive(Clone)]
pub(crate) struct ViewSettings {
    pub width: u32,
    pub height: u32,
    /// The least radius of the pixel filter, in pixels.
    pub pixels: f64,
    /// The tangent of the half-angle of the cones of bounce and shadow rays.
    pub cone: f64,
    /// The same of camera rays, where that is wider than the filter.
    pub camera_cone: f64,
    pub bounces: u32,
    pub roulette_after: Option<u32>,
    pub multiple_importance: bool,
    pub sampler: Sampler,
    /// Whether gradients have what changes while visibility doesn't, beside what jumps add.
    pub interior: bool,
}

impl View {
    pub fn new(
        scene: Arc<KernelScene>,
        camera: HostCamera,
        settings: &ViewSettings,
        wanted: Wanted,
        edge_sets: Option<Arc<EdgeSets>>,
    ) -> Self {
        let frame = &scene.frame;
        let model = camera.model(frame, settings.width, settings.height);
        let pixels_per_tangent = 0.5 * f64::from(settings.height) / camera.half_height;
        let has_map = scene.sky.map().is_some();
        let gathers_map = has_map && settings.multiple_importance;
        let sees_sky = !scene.sky.is_black() && !gathers_map;
        let combined = settings.multiple_importance && !scene.emitters.is_empty();
        let mut view = Self {
            host_camera: camera,
            camera: model,
            filter: PixelFilter::new(
                settings
                    .pixels
                    .max(settings.camera_cone * pixels_per_tangent),
            ),
            cone: settings.cone as f32,
            cones: settings.sampler.stream(1),
            edges: settings.sampler.stream(2),
            sides: settings.sampler.stream(3),
            film: settings.sampler.stream(4).of_one_pixel(),
            sampler: settings.sampler,
            bounces: settings.bounces,
            roulette_after: settings.roulette_after,
            width: settings.width,
            height: settings.height,
            arch: pulp::Arch::new(),
            drawn: 0,
            dark: scene.emitters.is_empty() && scene.sky.is_black(),
            sees_sky,
            gathers_map,
            combined,
            has_edges: edge_sets.as_ref().is_some_and(|e| !e.is_empty()),
            edge_sets,
            interior: settings.interior,
            wanted,
            scene,
        };
        view.drawn = view.sets();
        view
    }

    /// Adds the derivatives by parameters of the camera at their places.
    pub fn write_camera(
        &self,
        sums: &gradient::CameraSums,
        places: &[(ParameterId, Range<usize>)],
        all: &mut [f64],
    ) {
        let aspect = f64::from(self.width) / f64::from(self.height);
        let unit = self.scene.frame.unit;
        self.host_camera.backward(sums, unit, aspect, places, all);
    }

    /// How far beyond a pixel its filter reaches, in pixels.
    pub fn reach(&self) -> f32 {
        self.filter.radius()
    }

    /// Whether anything jumps on the film.
    pub fn has_edges(&self) -> bool {
        self.has_edges
    }

    /// The sets of random numbers that paths use at their first surfaces (`Dimension::of_sequence`).
    fn sets(&self) -> u8 {
        let glossy = self.scene.glossy;
        let to_the_end = self.sees_sky || self.gathers_map || (glossy && self.combined);
        let directions = self.bounces.saturating_add(u32::from(to_the_end));
        let more = glossy || self.gathers_map || self.roulette_after.is_some();
        let mut sets = 1;
        if self.camera.aperture > 0.0 || self.scene.velocities.is_some() {
            sets |= 2;
        }
        for bounce in 0..directions.min(3) {
            sets |= if more { 12 } else { 4 } << (2 * bounce);
        }
        sets
    }

    /// Sums over samples of pixels. `objects` counts, for each pixel, what its rays hit.
    pub fn render(
        &self,
        pixels: &[u32],
        samples: Range<u32>,
        work: &mut Work,
        objects: Option<&mut [f32]>,
    ) -> Vec<Seen> {
        let forward = Forward {
            view: self,
            pixels,
            samples,
            work,
            objects,
        };
        dispatch(self.arch, forward)
    }

    /// How much a loss depends on the radiance of a pixel, on average over those that it depends on.
    pub fn typical(pixels: &[(u32, Seen)]) -> f32 {
        let (mut sum, mut count) = (0.0, 0u32);
        for (_, g) in pixels {
            let own = f64::from(g.radiance.sum_abs());
            sum += own;
            count += u32::from(own > 0.0);
        }
        (sum / f64::from(count.max(1))) as f32
    }

    /// Adds the derivatives of sums over samples of pixels, each times what comes from above. `typical` is
    /// the mean over the image of how much that is ([`View::typical`]).
    pub fn backward(
        &self,
        pixels: &[(u32, Seen)],
        typical: f32,
        samples: Range<u32>,
        work: &mut Work,
        sums: &mut Sums,
    ) {
        let backward = Backward {
            view: self,
            pixels,
            typical,
            samples,
            work,
            sums,
        };
        dispatch(self.arch, backward);
    }
}

/// [`View::render`] as a task.
struct Forward<'a> {
    view: &'a View,
    pixels: &'a [u32],
    samples: Range<u32>,
    work: &'a mut Work,
    objects: Option<&'a mut [f32]>,
}

impl Task for Forward<'_> {
    type Output = Vec<Seen>;

    #[inline(always)]
    fn run<M: Machine>(self, _machine: M) -> Vec<Seen> {
        let Self {
            view,
            pixels,
            samples,
            work,
            mut objects,
        } = self;
        let mut all = vec![Seen::default(); pixels.len()];
        let mut walks = Walks::default();
        let (together, mut first) = (view.together(&samples), 0);
        while first < pixels.len() {
            let some = first..pixels.len().min(first + together);
            let mut from = samples.start;
            while from < samples.end {
                let past = next_run(from).min(samples.end);
                let runs = view.runs(pixels[some.clone()].iter().copied(), from);
                let paths = view.paths(&runs, from..past);
                view.camera_walks::<false>(&paths, &mut walks, work);
                for (k, walk) in walks.list.iter().enumerate() {
                    let i = first + k / (past - from) as usize;
                    all[i].add(walk);
                    if let Some(objects) = &mut objects {
                        view.count_object(i, walk.seen, objects);
                    }
                }
                from = past;
            }
            first = some.end;
        }
        all
    }
}

/// The first sample of the next run.
fn next_run(sample: u32) -> u32 {
    (sample - sample % RUN as u32).saturating_add(RUN as u32)
}

/// Paths that go together, about: so many that the machine has others to do while it waits for one.
const TOGETHER: usize = 16;

impl View {
    /// How many pixels have their paths go together.
    fn together(&self, samples: &Range<u32>) -> usize {
        let of_pixel = (samples.end - samples.start).clamp(1, RUN as u32);
        TOGETHER.div_ceil(of_pixel as usize)
    }

    /// The random numbers of the run of samples that one of them is in, of some pixels.
    #[inline(always)]
    fn runs(&self, pixels: impl Iterator<Item = u32>, sample: u32) -> Vec<Run<'_>> {
        let first = sample - sample % RUN as u32;
        let mut runs = Vec::with_capacity(TOGETHER);
        for pixel in pixels {
            runs.push(self.sampler.run(pixel, first..next_run(first), self.drawn));
        }
        runs
    }

    /// Samples of all runs, those of one after another.
    #[inline(always)]
    fn paths<'a>(&'a self, runs: &'a [Run], samples: Range<u32>) -> Vec<Path<'a>> {
        let mut paths = Vec::with_capacity(runs.len() * RUN);
        for run in runs {
            for sample in samples.clone() {
                paths.push(self.path(run.numbers(sample)));
            }
        }
        paths
    }

    #[inline(always)]
    fn path<'a>(&'a self, numbers: Numbers<'a>) -> Path<'a> {
        let cones = (self.cone > 0.0).then(|| self.cones.numbers(numbers.path()));
        Path {
            time: self.time(&numbers),
            numbers,
            cones,
        }
    }

    /// Counts an object that a ray of the i-th pixel hit; the last is the background.
    fn count_object(&self, i: usize, triangle: u32, objects: &mut [f32]) {
        let width = self.scene.counted.len() + 1;
        let k = match self.scene.triangles.get(triangle as usize) {
            Some(t) => {
                let found = self.scene.counted.binary_search(&(t.object as usize));
                found.unwrap_or(width - 1)
            }
            None => width - 1,
        };
        objects[i * width + k] += 1.0;
    }
}

/// [`View::backward`] as a task.
struct Backward<'a> {
    view: &'a View,
    pixels: &'a [(u32, Seen)],
    typical: f32,
    samples: Range<u32>,
    work: &'a mut Work,
    sums: &'a mut Sums,
}

impl Task for Backward<'_> {
    type Output = ();

    #[inline(always)]
    fn run<M: Machine>(self, _machine: M) {
        let Self {
            view,
            pixels,
            typical,
            samples,
            work,
            sums,
        } = self;
        let mut walks = Walks::default();
        let asked: Vec<&(u32, Seen)> = pixels.iter().filter(|p| p.1 != Seen::default()).collect();
        for some in asked.chunks(view.together(&samples)) {
            let mut from = samples.start;
            while from < samples.end {
                let past = next_run(from).min(samples.end);
                let runs = view.runs(some.iter().map(|p| p.0), from);
                let paths = view.paths(&runs, from..past);
                work.clear();
                view.camera_walks::<true>(&paths, &mut walks, work);
                for (k, (path, walk)) in paths.iter().zip(&walks.list).enumerate() {
                    let (_, upstream) = some[k / (past - from) as usize];
                    view.walk_backward(path, walk, (upstream, typical), work, sums);
                }
                from = past;
            }
        }
    }
}
