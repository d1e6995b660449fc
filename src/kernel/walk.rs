//! The state of paths on their way, bounce by bounce, which is also the record that they leave for the backward pass.

use std::ops::Deref;

use super::eights::Eight;
use super::shares::Yields;
use super::view::Tracer;
use crate::accel::{Hit, HitRay, NOTHING};
use crate::lanes::Block;
use crate::model::bsdf::Scatter;
use crate::model::camera::CameraRay;
use crate::model::{V2, V3};
use crate::sampling::{EmitterKinds, Four, Met, Stream};
pub(crate) use crate::trace::Seen;
use crate::trace::{Arrived, Leaving, Point, PointGradient, RayGradient};

/// Paths that go together, about: so many that stages fill their lanes, and the machine has others to do while it waits
/// for one.
pub(super) const TOGETHER: usize = 64;

/// Samples of a pixel that go together, at most.
pub(super) const RUN: usize = 8;

/// The constants of a path.
#[derive(Clone, Copy)]
pub(crate) struct Path {
    /// What its random numbers come from.
    pub numbers: Stream,
    /// Where those for the kernels of cones come from.
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
    /// What random numbers for cones come from, if there are any.
    pub cones: &'a [Stream],
    pub bounce: u32,
    pub kept: Kept,
}

/// What paths leave behind beside the light that they bring back.
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
    /// The path of a lane.
    #[inline(always)]
    pub fn path(&self, level: &Level, lane: usize) -> &'a Path {
        &self.paths[level.paths[lane] as usize]
    }

    /// The time of a lane's path.
    #[inline(always)]
    pub fn time(&self, level: &Level, lane: usize) -> f32 {
        if self.features.moves {
            self.path(level, lane).time
        } else {
            0.0
        }
    }
}

/// What a path saw first, and the light that it brought back so far.
#[derive(Clone, Copy)]
pub(crate) struct Walk {
    /// The triangle that the first ray hit, or [`NOTHING`].
    pub seen: u32,
    pub light: Seen,
    /// Its rays, where they are counted.
    pub rays: u32,
}

impl Walk {
    /// The first ray hit a surface point.
    #[inline(always)]
    pub fn see(&mut self, point: &Point) {
        self.seen = point.triangle;
        self.light.opacity = 1.0;
        self.light.depth = point.distance;
        self.light.normal = point.shading.geometric;
    }
}

/// Paths that go together.
#[derive(Default)]
pub(crate) struct Walks {
    pub list: Vec<Walk>,
    /// Random numbers of the film.
    pub film: Block<Four>,
    pub cameras: Block<CameraRay>,
    /// The surface points that paths come to, bounce by bounce. Where they are not kept two take turns.
    pub levels: Vec<Level>,
    /// The number of levels that paths came to.
    pub depth: usize,
}

impl Walks {
    /// Begins with a number of paths, none of which has come to a surface.
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

    /// A level, after those before it.
    pub fn level(&mut self, index: usize) -> &mut Level {
        let room = self.levels.len().max(index + 1);
        self.levels.resize_with(room, Level::default);
        &mut self.levels[index]
    }
}

/// The paths of a block that came to a surface point after some bounces: what each has there is in a lane of its own.
#[derive(Default)]
pub(crate) struct Level {
    /// The path of each lane, and its lane a bounce before.
    pub paths: Vec<u32>,
    pub before: Vec<u32>,
    pub points: Block<Point>,
    /// The throughput of the path where it arrives.
    pub throughputs: Block<V3>,
    /// Random numbers for the emitter that it is connected to.
    pub emitters: Block<V2>,
    /// For the way on and the next emitter, for choices, and for the cones of the next ray and of that to a light.
    pub numbers: Block<Four>,
    pub choices: Block<Four>,
    pub cones: Block<Four>,
    /// Whether all of eight lanes are of matt surfaces.
    pub matt: Vec<bool>,
    /// The way on, where the path goes on.
    pub scatters: Block<Scatter>,
    pub leavings: Block<Leaving>,
    pub ways: Vec<Way>,
    /// Light that arrives.
    pub lights: Vec<LightSample>,
}

impl Level {
    pub fn len(&self) -> usize {
        self.paths.len()
    }

    /// Makes room for a number of paths; none is there.
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

    /// A path comes to a surface point, which is set apart from this.
    #[inline(always)]
    pub fn add(&mut self, path: u32, before: u32, throughput: V3) {
        self.throughputs.set(self.len(), throughput);
        self.paths.push(path);
        self.before.push(before);
    }
}

/// How a path leaves a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Way {
    /// It doesn't.
    Ends,
    On,
    /// Its ray hit nothing, and brought light of the environment.
    Escaped,
}

/// Light that was seen: from a point of an emitter, from a delta light, or along a direction of a map.
#[derive(Clone, Copy, Debug)]
pub(super) struct LightSample {
    pub lane: u32,
    /// [`NONE`](crate::trace::NONE) of a map.
    pub emitter: u32,
    /// Weights of the emitter's corners b and c.
    pub weights: V2,
    pub direction: V3,
    pub arrived: Arrived,
}

/// A connection of a lane's point to a light, before its ray is made.
#[derive(Clone, Copy)]
pub(super) struct Connecting {
    pub lane: usize,
    /// [`NONE`] of a map.
    pub emitter: u32,
    pub weights: V2,
    /// The probability or density with which it was drawn, or would have been if it was found by scattering.
    pub chance: f32,
    pub by_scattering: bool,
}

/// Light that arrives if nothing is in between.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    pub path: u32,
    pub light: V3,
}

/// Light of a map along the way on, which arrives if the ray on hits nothing.
#[derive(Clone, Copy, Debug)]
pub(super) struct Waiting {
    pub lane: u32,
    pub light: V3,
    pub sample: Option<LightSample>,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct RayCounts {
    /// Camera, bounce and shadow rays.
    pub rays: u64,
    /// Paths that looked for their next surface, by bounce.
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

/// Memory of paths that go together, used again for the next.
#[derive(Default)]
pub(crate) struct Work {
    pub(super) rays: Vec<HitRay>,
    pub(super) hits: Vec<Hit>,
    /// The lanes that rays belong to.
    pub(super) lanes: Vec<u32>,
    /// Rays that hit surfaces.
    pub(super) arriving: Vec<u32>,
    pub(super) candidates: Vec<Candidate>,
    /// What is kept of each.
    pub(super) samples: Vec<LightSample>,
    pub(super) waiting: Vec<Waiting>,
    /// Of a choice of an emitter, of one path and of eight.
    pub(super) room: Vec<u32>,
    pub(super) few: Vec<Eight<f32>>,
    pub(super) met: Met,
    /// Emitters that lie along the directions in which glossy paths go on.
    pub(super) along: Vec<Connecting>,
    /// Paths on both sides of edges.
    pub(super) side_walks: Walks,
    pub(super) side_lights: Vec<Option<Seen>>,
    pub(super) back: Back,
    pub(crate) counts: RayCounts,
    /// What backward passes cost, and how much samples of edges vary.
    pub(crate) yields: Yields,
}

/// Derivatives on the way back, one a lane.
#[derive(Default)]
pub(super) struct Back {
    pub points: Vec<PointGradient>,
    /// By the throughput behind a point, then by that before it; and by the ray that leaves it.
    pub throughputs: Vec<V3>,
    pub rays: Vec<RayGradient>,
    /// By the throughput that leaves the point before, and by its ray.
    pub throughputs_before: Vec<V3>,
    pub rays_before: Vec<RayGradient>,
    /// Random numbers for edges, of each path.
    pub edges: Vec<Stream>,
    /// Of each level whether points move, or the directions in which they are seen turn.
    pub moves: Vec<Vec<bool>>,
}

impl Work {
    pub fn new(bounces: u32) -> Self {
        let mut work = Self {
            room: vec![0; EmitterKinds::MOST_ROOM],
            few: vec![Eight::<f32>::default(); EmitterKinds::MOST_ROOM],
            ..Self::default()
        };
        work.counts.bounces = vec![0; bounces.min(1 << 16) as usize + 1];
        work
    }
}
