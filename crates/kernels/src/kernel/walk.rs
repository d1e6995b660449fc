//! The state of paths while they are traced, bounce by bounce. It is also the record for the backward pass.

use std::ops::Deref;

use super::eights::Eight;
use super::shares::Yields;
use super::view::Tracer;
use crate::accel::{Hit, HitRay, NOTHING};
use crate::lanes::Block;
use crate::model::bsdf::Scatter;
use crate::model::camera::CameraRay;
use crate::model::{Four, V2, V3};
use crate::sampling::{EmitterKinds, Met, Stream};
pub use crate::trace::Seen;
use crate::trace::{
    Arrived, Beside, Leaving, LightBeside, Point, PointGradient, RayGradient, Scene, albedo_of,
};

/// The approximate number of paths that are traced together. It is large enough to fill the lanes of stages, and to
/// give the processor other work while it waits for one path's data.
pub(super) const TOGETHER: usize = 64;

/// The largest number of samples of a pixel that are traced together.
pub(super) const RUN: usize = 8;

/// The constants of a path.
#[derive(Clone, Copy)]
pub struct Path {
    /// The source of its random numbers.
    pub numbers: Stream,
    /// The index of its source of random numbers for the cone kernels.
    pub cones: u32,
    pub time: f32,
}

/// Paths from the camera.
#[derive(Default)]
pub(super) struct Paths {
    pub list: Vec<Path>,
    pub cones: Vec<Stream>,
}

/// A block of paths after some bounces.
pub(super) struct PathBlock<'a> {
    pub tracer: &'a Tracer<'a>,
    pub paths: &'a [Path],
    /// The sources of random numbers for cones, if there are cones.
    pub cones: &'a [Stream],
    pub bounce: u32,
    pub kept: Kept,
}

/// What paths record in addition to their light.
#[derive(Clone, Copy, Default)]
pub(super) struct Kept {
    /// All levels, for the backward pass.
    pub levels: bool,
    /// The number of rays of each path.
    pub counts: bool,
}

impl<'a> Deref for PathBlock<'a> {
    type Target = Tracer<'a>;

    #[inline(always)]
    fn deref(&self) -> &Tracer<'a> {
        self.tracer
    }
}

impl<'a> PathBlock<'a> {
    /// Returns the path of a lane.
    #[inline(always)]
    pub fn path(&self, level: &Level, lane: usize) -> &'a Path {
        &self.paths[level.paths[lane] as usize]
    }

    /// Returns the shutter time of a lane's path.
    #[inline(always)]
    pub fn time(&self, level: &Level, lane: usize) -> f32 {
        if self.features.moves {
            self.path(level, lane).time
        } else {
            0.0
        }
    }
}

/// The first surface that a path saw, and the light that it has collected so far.
#[derive(Clone, Copy)]
pub struct Walk {
    /// The triangle that the first ray hit, or [`NOTHING`].
    pub seen: u32,
    pub light: Seen,
    /// The number of its rays, if rays are counted.
    pub rays: u32,
}

impl Walk {
    /// Records the surface point that the first ray hit.
    #[inline(always)]
    pub fn see(&mut self, point: &Point) {
        self.seen = point.triangle;
        self.light.opacity = 1.0;
        self.light.depth = point.distance;
        self.light.normal = point.shading.geometric;
    }
}

/// Paths that are traced together.
#[derive(Default)]
pub struct Walks {
    pub list: Vec<Walk>,
    /// The albedo of the first surface that each path saw, if it is an output.
    pub albedos: Vec<V3>,
    /// Random numbers for the film.
    pub film: Block<Four>,
    pub cameras: Block<CameraRay>,
    /// The surface points that paths reach, bounce by bounce. If levels are not kept, two of them are used in turn.
    pub levels: Vec<Level>,
    /// The number of levels that paths reached.
    pub depth: usize,
}

impl Walks {
    /// Resets this to `count` paths, none of which has reached a surface.
    pub fn clear(&mut self, count: usize) {
        self.list.clear();
        let new = Walk {
            seen: NOTHING,
            light: Seen::default(),
            rays: 1,
        };
        self.list.resize(count, new);
        self.film.reserve(count);
        self.cameras.reserve(count);
        self.level(0).clear(count);
        self.depth = 1;
    }

    /// Records the albedos of the first surfaces, which are those of the first level.
    pub fn see_albedos(&mut self, scene: &Scene) {
        self.albedos.clear();
        self.albedos.resize(self.list.len(), V3::ZERO);
        let first = &self.levels[0];
        for (lane, &path) in first.paths.iter().enumerate() {
            self.albedos[path as usize] = albedo_of(scene, &first.points.get(lane));
        }
    }

    /// Returns a level, and adds levels up to it if there are fewer.
    pub fn level(&mut self, index: usize) -> &mut Level {
        let room = self.levels.len().max(index + 1);
        self.levels.resize_with(room, Level::default);
        &mut self.levels[index]
    }
}

/// The paths of a block that reached a surface point after the same number of bounces, each in a lane of its own.
#[derive(Default)]
pub struct Level {
    /// The path of each lane, and (in `before`) the lane of that path one bounce earlier.
    pub paths: Vec<u32>,
    pub before: Vec<u32>,
    pub points: Block<Point>,
    /// The throughput with which the path arrives.
    pub throughputs: Block<V3>,
    /// Random numbers for the emitter to which the point is connected.
    pub emitters: Block<V2>,
    /// Random numbers for the next direction and the next emitter (`numbers`), for choices (`choices`), and for the
    /// cones of the next ray and of the shadow ray (`cones`).
    pub numbers: Block<Four>,
    pub choices: Block<Four>,
    pub cones: Block<Four>,
    /// For each group of eight lanes, whether all are on matt surfaces.
    pub matt: Vec<bool>,
    /// The sampled next direction and ray, if the path continues.
    pub scatters: Block<Scatter>,
    pub leavings: Block<Leaving>,
    pub ways: Vec<Way>,
    /// Light that arrives at the points.
    pub lights: Vec<LightSample>,
}

impl Level {
    pub fn len(&self) -> usize {
        self.paths.len()
    }

    /// Removes all paths and makes room for `room` of them.
    pub fn clear(&mut self, room: usize) {
        self.paths.clear();
        self.before.clear();
        self.matt.clear();
        self.lights.clear();
        self.ways.clear();
        self.ways.resize(room, Way::Ends);
        self.points.reserve(room);
        self.throughputs.reserve(room);
        self.emitters.reserve(room);
        self.numbers.reserve(room);
        self.choices.reserve(room);
        self.cones.reserve(room);
        self.scatters.reserve(room);
        self.leavings.reserve(room);
    }

    /// Adds a path that reached a surface point. The caller sets the point itself.
    #[inline(always)]
    pub fn add(&mut self, path: u32, before: u32, throughput: V3) {
        self.throughputs.set(self.len(), throughput);
        self.paths.push(path);
        self.before.push(before);
    }
}

/// How a path leaves a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// It ends here.
    Ends,
    On,
    /// Its ray hit nothing and collected light of the environment.
    Escaped,
}

/// Light that arrived unblocked: from a point of an emitter, from a delta light, or from a direction of an environment
/// map.
#[derive(Clone, Copy, Debug)]
pub(super) struct LightSample {
    pub lane: u32,
    /// [`NONE`](crate::trace::NONE) for an environment map.
    pub emitter: u32,
    /// Weights of the emitter's corners b and c.
    pub weights: V2,
    pub direction: V3,
    pub arrived: Arrived,
}

/// A connection of a lane's point to a light, before its shadow ray is made.
#[derive(Clone, Copy)]
pub(super) struct Connecting {
    pub lane: usize,
    /// [`NONE`] for an environment map.
    pub emitter: u32,
    pub weights: V2,
    /// The probability or density with which light sampling drew it, or would have drawn it if BSDF sampling generated
    /// it.
    pub chance: f32,
    pub by_scattering: bool,
}

/// Light that arrives if no occluder is in between.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    pub path: u32,
    pub light: V3,
}

/// Light of an environment map along the next direction, which arrives if the next ray hits nothing.
#[derive(Clone, Copy, Debug)]
pub(super) struct Waiting {
    pub lane: u32,
    pub light: V3,
    pub sample: Option<LightSample>,
}

#[derive(Clone, Debug, Default)]
pub struct RayCounts {
    /// Camera rays, bounce rays and shadow rays.
    pub rays: u64,
    /// By bounce: the number of paths that were traced to their next surface.
    pub bounces: Vec<u64>,
}

impl RayCounts {
    #[inline(always)]
    pub(super) fn add_bounces_at(&mut self, bounce: u32, paths: usize) {
        if let Some(count) = self.bounces.get_mut(bounce as usize) {
            *count += paths as u64;
        }
    }

    pub fn add(&mut self, o: &Self) {
        self.rays += o.rays;
        let reached = o.bounces.iter().rposition(|&b| b > 0).map_or(0, |r| r + 1);
        self.bounces.resize(self.bounces.len().max(reached), 0);
        for (a, b) in self.bounces.iter_mut().zip(&o.bounces) {
            *a += b;
        }
    }
}

/// Scratch memory for paths that are traced together, reused for the next paths.
#[derive(Default)]
pub struct Work {
    pub(super) rays: Vec<HitRay>,
    pub(super) hits: Vec<Hit>,
    /// The lane of each ray.
    pub(super) lanes: Vec<u32>,
    /// The rays that hit surfaces.
    pub(super) arriving: Vec<u32>,
    pub(super) candidates: Vec<Candidate>,
    /// The record of each candidate for the backward pass.
    pub(super) samples: Vec<LightSample>,
    pub(super) waiting: Vec<Waiting>,
    /// Memory for choosing an emitter: for one path (`room`) and for eight (`few`).
    pub(super) room: Vec<u32>,
    pub(super) few: Vec<Eight<f32>>,
    pub(super) met: Met,
    /// Emitters along the directions in which glossy paths continue.
    pub(super) along: Vec<Connecting>,
    /// Paths on both sides of edges.
    pub(super) side_walks: Walks,
    pub(super) besides: Vec<[Beside; 2]>,
    pub(super) side_lights: Vec<Option<LightBeside>>,
    pub(super) back: Back,
    pub counts: RayCounts,
    /// The cost of backward passes, and the variance of edge samples.
    pub yields: Yields,
}

/// The derivatives of the backward pass, for each channel.
#[derive(Default)]
pub(super) struct Back {
    pub channels: Vec<Lanes>,
    /// Random numbers for edges, for each path.
    pub edges: Vec<Stream>,
    /// For each level and lane, whether the point moves or the direction in which it is seen turns.
    pub moves: Vec<Vec<bool>>,
}

/// The derivatives of a channel, one for each lane.
#[derive(Default)]
pub(super) struct Lanes {
    pub points: Vec<PointGradient>,
    /// Derivatives with respect to the throughput after a point, later with respect to the throughput before it; and
    /// (in `rays`) with respect to the ray that leaves the point.
    pub throughputs: Vec<V3>,
    pub rays: Vec<RayGradient>,
    /// Derivatives with respect to the throughput that leaves the previous point, and to its ray.
    pub throughputs_before: Vec<V3>,
    pub rays_before: Vec<RayGradient>,
}

impl Work {
    pub fn new(bounces: u32) -> Self {
        let mut work = Self {
            room: vec![0; EmitterKinds::MAX_ROOM],
            few: vec![Eight::<f32>::default(); EmitterKinds::MAX_ROOM],
            ..Self::default()
        };
        work.counts.bounces = vec![0; bounces.min(1 << 16) as usize + 1];
        work
    }
}
