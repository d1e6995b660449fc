//! Records that a path leaves for its backward pass, and the memory that holds them.

use std::ops::Range;

use super::surface::Point;
use super::walk::Walks;
use crate::accel::{Hit, HitRay};
use crate::model::V3;
use crate::model::bsdf::Scatter;
use crate::model::cone::Bend;
use crate::sampling::EmitterHit;

/// A point of a path.
#[derive(Clone, Debug)]
pub(super) struct Vertex {
    pub point: Point,
    /// The throughput of the path where it arrives here.
    pub throughput: V3,
    /// Light that arrives, in [`Work::lights`] and [`Work::skies`].
    pub lights: Range<u32>,
    pub skies: Range<u32>,
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

/// Light from a point of an emitter that was seen.
#[derive(Clone, Copy, Debug)]
pub(super) struct LightSample {
    /// The triangle of the scene.
    pub triangle: u32,
    pub weights: [f32; 3],
    /// The unit vector from the surface point to the light.
    pub direction: V3,
    pub distance: f32,
    pub squared: f32,
    /// cos θ at the light.
    pub facing: f32,
    /// f·cos θ at the surface.
    pub reflected: V3,
    /// The divisor of the sample, in units of the emitter's area.
    pub density: f32,
}

/// Light of a map along a direction in which nothing hid it.
#[derive(Clone, Copy, Debug)]
pub(super) struct SkySample {
    pub direction: V3,
    pub density: f32,
}

/// Light that arrives if nothing is in between.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    pub walk: u32,
    pub light: V3,
    pub sample: Sample,
}

#[derive(Clone, Copy, Debug)]
pub(super) enum Sample {
    Light(LightSample),
    Sky(SkySample),
}

/// Counts of rays.
#[derive(Clone, Debug, Default)]
pub(crate) struct RayCounts {
    /// Camera, bounce and shadow rays.
    pub rays: u64,
    /// Paths that looked for their next surface, by bounce.
    pub bounces: Vec<u64>,
}

impl RayCounts {
    /// Counts a path that looks for its next surface.
    #[inline(always)]
    pub(super) fn add_bounce(&mut self, bounce: u32) {
        if let Some(count) = self.bounces.get_mut(bounce as usize) {
            *count += 1;
        }
    }

    /// Adds other counts by bounce.
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
    pub(super) skies: Vec<SkySample>,
    pub(super) rays: Vec<HitRay>,
    pub(super) hits: Vec<Hit>,
    pub(super) candidates: Vec<Candidate>,
    pub(super) chances: Vec<f32>,
    pub(super) emitter_hits: Vec<EmitterHit>,
    pub(super) side_walks: Walks,
    pub(crate) counts: RayCounts,
}

impl Work {
    pub fn new(bounces: u32) -> Self {
        let mut work = Self::default();
        work.counts.bounces = vec![0; bounces.min(1 << 16) as usize + 1];
        work
    }

    pub(super) fn clear(&mut self) {
        self.vertices.clear();
        self.lights.clear();
        self.skies.clear();
    }
}
