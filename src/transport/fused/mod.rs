//! The path loop on the host: each path from camera to end in one go, and its derivatives by hand,
//! in f64. Nothing of it is on the tape but one node, from a table of what the scene is made of to
//! an image; the backward pass traces the paths again, pixel by pixel, and goes back along each.
//!
//! It is what `transport/path.rs` does with tensors, which is the specification: the same random
//! numbers, choices and formulas, so that images and gradients agree up to rounding.

mod adjoint;
mod forward;
mod log;
mod records;
mod shading;
mod sums;
mod surface;
mod tables;
mod walk;

use std::sync::Arc;

use burn::tensor::Tensor;
use glam::DVec3;

use super::sky::SkyMap;
use super::{Census, Lights, PathSettings, Sampler};
use crate::accel::{Hierarchy, Machine, Sides, Task, dispatch};
use crate::error::Result;
use crate::scene::{Camera, Flattened};
use crate::visibility::{Finder, Span, Visibility};
pub(crate) use log::{Log, TileLog};
pub(crate) use records::Work;
pub(crate) use sums::Sums;
use tables::HostCamera;
use tables::HostSky;
pub(crate) use tables::{Host, Tables};

/// A scene as a camera sees it, with the settings of a render, on the host.
pub(crate) struct Fused {
    /// Without tape.
    scene: Flattened,
    tables: Arc<Tables>,
    hierarchy: Arc<Hierarchy>,
    /// The sides of closed objects that the camera can see.
    sides: Option<Vec<Sides>>,
    lights: Arc<Lights>,
    sampler: Sampler,
    settings: PathSettings,
    camera: HostCamera,
    /// Width and height of the whole image.
    size: [usize; 2],
    cutoff: f64,
    /// The sets of random numbers that most paths use (`Sampler::run`).
    drawn: u8,
    /// Whether rays and surfaces they meet have derivatives.
    rays: bool,
}

/// What a fused render is made from beside its scene; all views of a scene share most of it.
#[derive(Clone)]
pub(crate) struct FusedParts {
    pub tables: Arc<Tables>,
    pub hierarchy: Arc<Hierarchy>,
    pub lights: Arc<Lights>,
    pub sampler: Sampler,
    pub settings: PathSettings,
    pub size: [usize; 2],
    pub cutoff: f64,
}

/// Derivatives of an image by what is in a graph.
pub(crate) struct Gradient {
    /// By the table of the scene.
    pub scene: Vec<f64>,
    /// By the row of the camera.
    pub camera: Vec<f64>,
}

/// Finders for camera and bounce rays, and for shadow rays.
struct Finders<'a> {
    rays: Finder<'a>,
    shadows: Finder<'a>,
}

impl Fused {
    /// Of a scene without tape.
    ///
    /// # Errors
    /// If the camera can't be read back.
    pub(crate) fn new(scene: Flattened, camera: &Camera, parts: FusedParts) -> Result<Self> {
        let frame = camera.frame(&scene.context, scene.bounds.center, scene.unit);
        let camera = HostCamera::new(&frame, camera.has_lens())?;
        let topology = &scene.topology;
        let hierarchy = &parts.hierarchy;
        let mut fused = Self {
            sides: hierarchy.sides(&topology.visible_side, &topology.object),
            rays: parts.tables.rays(&camera),
            tables: parts.tables,
            drawn: 0,
            scene,
            hierarchy: parts.hierarchy,
            lights: parts.lights,
            sampler: parts.sampler,
            settings: parts.settings,
            camera,
            size: parts.size,
            cutoff: parts.cutoff,
        };
        fused.drawn = fused.sets();
        Ok(fused)
    }

    /// The sets of random numbers that paths use at their first surfaces (`Dimension::of_sequence`).
    fn sets(&self) -> u8 {
        let settings = &self.settings;
        let glossy = self.scene.materials.glossy.contains(&true);
        let to_the_end = self.tables.host.sky.is_some()
            || (glossy && settings.sampling.multiple_importance && !self.lights.is_empty());
        let directions = settings.bounces + u32::from(to_the_end);
        let more = glossy || self.gathered().is_some() || settings.roulette_after.is_some();
        let mut sets = 1;
        if self.camera.lens.is_some() || self.tables.host.moves {
            sets |= 2;
        }
        for bounce in 0..directions.min(3) {
            sets |= if more { 12 } else { 4 } << (2 * bounce);
        }
        sets
    }

    /// How many numbers the sums of derivatives have.
    pub(crate) fn size(&self) -> usize {
        self.tables.size()
    }

    /// Sums of derivatives, all 0.
    pub(crate) fn sums(&self) -> Sums {
        self.tables.sums(self.rays)
    }

    /// The camera's row of what is in a graph, if anything of it is. It can be taken once.
    pub(crate) fn take_camera(&mut self) -> Option<Tensor<1>> {
        self.camera.parent.take()
    }

    /// Bounces of a path.
    pub(crate) fn bounces(&self) -> u32 {
        self.settings.bounces
    }

    /// An environment that paths see where they miss; a map's light is gathered at surfaces instead, if
    /// strategies are combined.
    fn missed(&self) -> Option<&HostSky> {
        let combined = self.settings.sampling.multiple_importance;
        let sky = self.tables.host.sky.as_ref();
        sky.filter(|sky| !combined || sky.map().is_none())
    }

    /// A map whose light is gathered at surfaces.
    fn gathered(&self) -> Option<&SkyMap> {
        let combined = self.settings.sampling.multiple_importance;
        let sky = self.tables.host.sky.as_ref().filter(|_| combined);
        sky.and_then(HostSky::map)
    }

    fn t_min(&self) -> f64 {
        self.settings.t_min(self.scene.radius())
    }

    fn finders(&self) -> Finders<'_> {
        let settings = self.settings.coverage(self.scene.radius());
        let finder = || {
            Finder::new(
                &self.hierarchy,
                &self.scene.topology,
                &self.scene.context,
                &settings,
                self.settings.visibility,
                self.cutoff,
            )
            .with_sides(self.sides.as_deref())
        };
        Finders {
            rays: finder(),
            shadows: finder().of_shadows(),
        }
    }

    /// near and far of a ray from a point (Eq. 3), where the form asks for them.
    fn span(&self, origin: DVec3) -> Span {
        if matches!(self.settings.visibility, Visibility::Layered) {
            return Span {
                near: 0.0,
                far: 1.0,
            };
        }
        let (distance, radius) = (origin.length(), self.scene.radius());
        Span {
            near: (distance - radius).max(0.0),
            far: distance + radius,
        }
    }

    /// Sums over the samples `from..to` of pixels, and what rays met. Weights of objects, if they are
    /// asked for, are those of each pixel in turn, the background's last.
    pub(crate) fn render(
        &self,
        pixels: &[u32],
        samples: (u32, u32),
        objects: Option<usize>,
        log: bool,
    ) -> Rendered {
        let finders = self.finders();
        let mut work = Work::new(self.settings.bounces);
        let arch = pulp::Arch::new();
        let mut sums = Vec::with_capacity(pixels.len());
        let mut weights = Vec::new();
        if log {
            work.log = Log::Write(TileLog::default());
        }
        for (i, &pixel) in pixels.iter().enumerate() {
            work.clear();
            work.log.begin_pixel(i);
            work.objects = objects.map(|n| vec![0.0; n + 1]);
            let paths = PixelPaths::<false> {
                fused: self,
                finders: &finders,
                pixel,
                samples,
                work: &mut work,
            };
            sums.push(dispatch(arch, paths));
            weights.extend(work.objects.take().into_iter().flatten());
        }
        // Up to the last bounce that a path reached.
        let bounces = &mut work.census.bounces;
        let reached = bounces.iter().rposition(|&b| b > 0);
        bounces.truncate(reached.map_or(0, |r| r + 1));
        Rendered {
            sums,
            objects: weights,
            census: work.census,
            log: match work.log {
                Log::Write(log) => Some(log),
                _ => None,
            },
        }
    }

    /// Adds derivatives of the sums of the pixels of a tile, each times what comes from above. With
    /// the tile's log nothing is looked for again.
    pub(crate) fn pull(
        &self,
        pixels: &[(u32, Pixel)],
        samples: (u32, u32),
        log: Option<Arc<TileLog>>,
        work: &mut Work,
        sums: &mut Sums,
    ) {
        let arch = pulp::Arch::new();
        let finders = self.finders();
        work.log = log.map_or(Log::None, |log| Log::Read(log, 0));
        for (i, (pixel, upstream)) in pixels.iter().enumerate() {
            if *upstream == Pixel::default() {
                continue;
            }
            work.clear();
            work.log.begin_pixel(i);
            let paths = PixelPaths::<true> {
                fused: self,
                finders: &finders,
                pixel: *pixel,
                samples,
                work,
            };
            dispatch(arch, paths);
            let back = PixelBack {
                fused: self,
                upstream,
                work,
                sums,
            };
            dispatch(arch, back);
        }
    }
}

/// The paths of a pixel.
struct PixelPaths<'a, const KEEP: bool> {
    fused: &'a Fused,
    finders: &'a Finders<'a>,
    pixel: u32,
    samples: (u32, u32),
    work: &'a mut Work,
}

impl<const KEEP: bool> Task for PixelPaths<'_, KEEP> {
    type Output = Pixel;

    #[inline(always)]
    fn run<M: Machine>(self, _machine: M) -> Pixel {
        let Self {
            fused,
            finders,
            pixel,
            samples,
            work,
        } = self;
        fused.pixel::<KEEP>(finders, pixel, samples, work)
    }
}

/// The way back along the paths of a pixel.
struct PixelBack<'a> {
    fused: &'a Fused,
    upstream: &'a Pixel,
    work: &'a mut Work,
    sums: &'a mut Sums,
}

impl Task for PixelBack<'_> {
    type Output = ();

    #[inline(always)]
    fn run<M: Machine>(self, _machine: M) {
        self.fused.pull_pixel(self.upstream, self.work, self.sums);
    }
}

/// A tile: the sums of its pixels, weights of objects, what rays met, and on request what they found.
pub(crate) struct Rendered {
    pub sums: Vec<Pixel>,
    pub objects: Vec<f64>,
    pub census: Census,
    pub log: Option<TileLog>,
}

/// What camera rays bring back.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Pixel {
    pub radiance: DVec3,
    /// 1 − W_background.
    pub opacity: f64,
    /// Σ W·t.
    pub depth: f64,
    /// Σ W·n, facing the camera.
    pub normal: DVec3,
}
