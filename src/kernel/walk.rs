//! The state of paths on their way, and the records that they leave for the backward pass.

use std::ops::Range;

use crate::accel::{Hit, HitRay, NOTHING};
use crate::model::bsdf::Scatter;
use crate::model::camera::CameraRay;
use crate::model::cone::Bend;
use crate::model::{V2, V3};
use crate::sampling::{EmitterHit, EmitterKinds, Met, Numbers};
pub(crate) use crate::trace::Seen;
use crate::trace::{Arrived, Point};

/// The constants of a path.
#[derive(Clone, Copy)]
pub(crate) struct Path<'a> {
    pub numbers: Numbers<'a>,
    /// Random numbers for the kernels of cones.
    pub cones: Option<Numbers<'a>>,
    pub time: f32,
}

/// A path on its way.
#[derive(Clone)]
pub(crate) struct Walk {
    pub camera: CameraRay,
    /// The triangle that the camera ray hit, or [`NOTHING`].
    pub seen: u32,
    /// The surface point that the path came to, if it did.
    pub point: Point,
    pub on_surface: bool,
    /// Distance and geometric normal of the first surface.
    pub first: (f32, V3),
    pub throughput: V3,
    /// The light that it brought back so far.
    pub radiance: V3,
    /// Random numbers for the next emitter.
    pub emitter: [f32; 2],
    pub scatter: Scatter,
    pub bend: Bend,
    /// Its last point among those that are kept.
    pub vertex: usize,
}

impl Walk {
    pub fn new() -> Self {
        Self {
            camera: CameraRay::default(),
            seen: NOTHING,
            point: Point::default(),
            on_surface: false,
            first: (0.0, V3::ZERO),
            throughput: V3::ONE,
            radiance: V3::ZERO,
            emitter: [0.0; 2],
            scatter: Scatter::default(),
            bend: Bend::default(),
            vertex: usize::MAX,
        }
    }

    /// The path comes to its first surface point.
    #[inline(always)]
    pub fn begin_at(&mut self, point: Point) {
        self.first = (point.distance, point.shading.geometric);
        self.point = point;
        self.on_surface = true;
    }
}

/// Paths that go together.
#[derive(Default)]
pub(crate) struct Walks {
    pub list: Vec<Walk>,
    pub alive: Vec<u32>,
}

impl Walks {
    pub fn clear(&mut self) {
        self.list.clear();
        self.alive.clear();
    }
}

impl Walk {
    /// Adds the surface that the camera ray saw and the light that the path brought back.
    #[inline(always)]
    pub fn add_to(&self, seen: &mut Seen) {
        seen.radiance += self.radiance;
        if self.seen != NOTHING {
            seen.opacity += 1.0;
            seen.depth += self.first.0;
            seen.normal += self.first.1;
        }
    }
}

/// A point of a path.
#[derive(Clone, Debug)]
pub(super) struct Vertex {
    pub point: Point,
    /// The throughput of the path where it arrives here.
    pub throughput: V3,
    /// Light that arrives, in [`Work::lights`].
    pub lights: Range<u32>,
    /// The way on; None where the path ends.
    pub leave: Option<Leave>,
    /// The point before it, `usize::MAX` for the first.
    pub previous: usize,
}

/// The way in which a path leaves a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Leave {
    pub scatter: Scatter,
    /// The probability with which it goes on.
    pub survival: f32,
    pub bend: Bend,
    /// Whether the ray hit nothing, and brought light of the environment.
    pub escaped: bool,
}

/// Light that was seen: from a point of an emitter, from a delta light, or along a direction of a map.
#[derive(Clone, Copy, Debug)]
pub(super) struct LightSample {
    /// [`NONE`](crate::trace::NONE) of a map.
    pub emitter: u32,
    /// Weights of the emitter's corners b and c.
    pub weights: V2,
    pub direction: V3,
    pub arrived: Arrived,
}

/// Light that arrives if nothing is in between.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    pub walk: u32,
    pub light: V3,
    pub sample: LightSample,
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
    pub(super) fn add_bounce(&mut self, bounce: u32) {
        if let Some(count) = self.bounces.get_mut(bounce as usize) {
            *count += 1;
        }
    }

    pub fn add_bounces(&mut self, o: &Self) {
        let reached = o.bounces.iter().rposition(|&b| b > 0).map_or(0, |r| r + 1);
        if self.bounces.len() < reached {
            self.bounces.resize(reached, 0);
        }
        for (a, b) in self.bounces.iter_mut().zip(&o.bounces) {
            *a += b;
        }
    }
}

/// Memory of paths that go together, used again for the next.
#[derive(Default)]
pub(crate) struct Work {
    pub(super) vertices: Vec<Vertex>,
    pub(super) lights: Vec<LightSample>,
    pub(super) rays: Vec<HitRay>,
    pub(super) hits: Vec<Hit>,
    pub(super) candidates: Vec<Candidate>,
    /// Of a choice of an emitter.
    pub(super) room: Vec<u32>,
    pub(super) met: Met,
    pub(super) emitter_hits: Vec<EmitterHit>,
    pub(super) side_walks: Walks,
    pub(super) chain: Vec<usize>,
    pub(crate) counts: RayCounts,
}

impl Work {
    pub fn new(bounces: u32) -> Self {
        let mut work = Self {
            room: vec![0; EmitterKinds::MOST_ROOM],
            ..Self::default()
        };
        work.counts.bounces = vec![0; bounces.min(1 << 16) as usize + 1];
        work
    }

    pub(super) fn clear(&mut self) {
        self.vertices.clear();
        self.lights.clear();
    }
}
