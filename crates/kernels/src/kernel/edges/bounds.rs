//! Bounds of edges: a box, a cone of normals, and sums of jumps. GPUs compute them by the same formulas.

use super::Edges;
use super::draw::{stored_fold, stored_normals};
use crate::accel::LANES;
use crate::cube::*;
use crate::kernel::scene::KernelScene;
use crate::model::edge_weight::{Jumps, SeenEdge, Subtree};
use crate::model::{Pair, V3, select_vector, splat, v3};
use crate::trace::NONE;

/// Edges, with the scene that contains their triangles.
pub(super) struct EdgeList<'a> {
    pub edges: &'a Edges,
    pub scene: &'a KernelScene,
    /// Whether the tree is for a GPU, which computes its nodes and leaves.
    pub for_gpu: bool,
}

impl EdgeList<'_> {
    pub fn middle(&self, index: u32) -> V3 {
        let [a, along] = self.edges.flat[index as usize].map(V3::from);
        a + along * 0.5
    }

    /// Returns an edge as seen from the origin at the start of the shutter, and its displacement over the shutter.
    pub fn seen(&self, index: u32) -> (SeenEdge, V3) {
        let e = &self.edges.get(index as usize);
        // An edge with one face has the normal of that face twice.
        let [first, second, ..] = e.faces;
        let second = if second == NONE { first } else { second };
        let [front, back] = [first, second].map(|k| self.scene.triangle(k).normal);
        let seen = SeenEdge {
            to: self.middle(index),
            half: 0.5 * e.along.length(),
            along: e.along,
            front,
            back,
            jumps: Jumps::of_kind(e.kind_word(), e.crease),
        };
        (seen, self.scene.shift(first, 1.0))
    }
}

/// Bounds of some edges.
#[apply(record!)]
pub struct Bounds {
    /// A box around the edges over the shutter.
    pub low: V3,
    pub high: V3,
    /// The number of folds, and a cone of the normals of their faces: the sum of the normals, and the sine of half the
    /// largest angle to it.
    pub folds: f32,
    pub normals: V3,
    pub sin_half: f32,
    /// Sums of jump × length; for the silhouettes of folds also × the angle of the fold.
    pub jumps: Jumps,
}

/// If the sum of normals is this small a part of their number, rounding decides its direction.
const CANCELED: f32 = 1e-3;

/// Returns the sine of half the angle between unit vectors.
#[cfg_attr(feature = "gpu", cube)]
fn sin_half_between(a: V3, b: V3) -> f32 {
    // The distance keeps the digits of small angles.
    min(0.5 * (a - b).length(), 1.0)
}

/// Returns the cosine of an angle of at most 90°, given its sine.
#[cfg_attr(feature = "gpu", cube)]
fn cosine(sine: f32) -> f32 {
    ((1.0 - sine) * (1.0 + sine)).sqrt()
}

#[cfg_attr(feature = "gpu", cube)]
impl Bounds {
    /// Returns the bounds of no edges.
    pub fn none() -> Bounds {
        Bounds {
            low: splat(f32::MAX),
            high: splat(-f32::MAX),
            folds: 0.0,
            normals: splat(0.0),
            sin_half: 0.0,
            jumps: Jumps {
                seen_always: 0.0,
                passes_always: 0.0,
                fold: 0.0,
                crease: 0.0,
                followed: 0.0,
                closed: 1.0,
            },
        }
    }

    /// Returns whether the sum of normals has a direction.
    fn is_directed(&self) -> bool {
        self.normals.length() > self.folds * CANCELED
    }

    /// Returns the direction of the sum of normals, or any direction.
    pub fn axis(&self) -> V3 {
        let unit = self.normals * (1.0 / max(self.normals.length(), 1e-30));
        select_vector(self.is_directed(), unit, v3(0.0, 0.0, 1.0))
    }

    /// Returns the bounds with another sine of half the angle of the cone, which contains all directions if its axis is
    /// any direction.
    pub fn with_cone(&self, sin_half: f32) -> Bounds {
        let is_directed = self.is_directed();
        let is_wide = self.folds > 0.0 && !is_directed;
        Bounds {
            low: self.low,
            high: self.high,
            folds: self.folds,
            normals: self.normals,
            sin_half: select(is_wide, 1.0, sin_half),
            jumps: self.jumps,
        }
    }

    /// Adds an edge, with its displacement over the shutter. The angle of the cone is set by [`Self::over_leaf`].
    pub fn add_edge(&mut self, e: &SeenEdge, velocity: V3) {
        let half = e.along * 0.5;
        let low = (e.to - half).min(e.to + half);
        let high = (e.to - half).max(e.to + half);
        self.low = self.low.min(low).min(low + velocity);
        self.high = self.high.max(high).max(high + velocity);
        let length = 2.0 * e.half;
        let is_fold = e.jumps.fold > 0.0;
        self.jumps.seen_always += length * e.jumps.seen_always;
        self.jumps.passes_always += length * e.jumps.passes_always;
        self.jumps.fold += length * e.jumps.fold * (e.front - e.back).length();
        self.jumps.crease += length * e.jumps.crease;
        self.jumps.followed += length * e.jumps.followed;
        let closed = select(is_fold, e.jumps.closed, 1.0);
        self.jumps.closed = min(self.jumps.closed, closed);
        self.normals += select_vector(is_fold, e.front + e.back, splat(0.0));
        self.folds += select(is_fold, 1.0, 0.0);
    }

    /// Returns the bounds with the cone around all normals of the added edges, which are those of a leaf. Its block
    /// begins at the index `first` of a list, and the edges in it are `apart` places from each other.
    pub fn over_leaf(&self, leaves: &mut [f32], first: usize, apart: usize) -> Bounds {
        let axis = self.axis();
        let mut sin_half = 0.0f32;
        for i in 0..repeated(LANES, 0u32.runtime()) {
            let normals: Pair = stored_normals(leaves, first + apart * i);
            let front = sin_half_between(normals.first, axis);
            let back = sin_half_between(normals.second, axis);
            let fold = stored_fold(leaves, first + apart * i);
            sin_half = max(sin_half, select(fold > 0.0, max(front, back), 0.0));
        }
        self.with_cone(sin_half)
    }

    /// Adds other bounds. The cone must then be set by the largest [`Self::reach`] of these.
    pub fn add_part(&mut self, part: &Bounds) {
        self.low = self.low.min(part.low);
        self.high = self.high.max(part.high);
        self.normals += part.normals;
        self.folds += part.folds;
        self.jumps.seen_always += part.jumps.seen_always;
        self.jumps.passes_always += part.jumps.passes_always;
        self.jumps.fold += part.jumps.fold;
        self.jumps.crease += part.jumps.crease;
        self.jumps.followed += part.jumps.followed;
        self.jumps.closed = min(self.jumps.closed, part.jumps.closed);
    }

    /// Returns the sine of half the largest angle, up to 180°, between an axis and a normal of its cone, or 0 without
    /// folds.
    pub fn reach(&self, axis: V3) -> f32 {
        let own = self.sin_half;
        let turn = sin_half_between(self.axis(), axis);
        let (cos_own, cos_turn) = (cosine(own), cosine(turn));
        let sum = min(own * cos_turn + cos_own * turn, 1.0);
        let reach = select(cos_own * cos_turn > own * turn, sum, 1.0);
        select(self.folds > 0.0, reach, 0.0)
    }

    /// Returns the bounds in the form in which nodes store them.
    pub fn subtree(&self) -> Subtree {
        // The margins are for rounding.
        let cos = 1.0 - 2.0 * self.sin_half * self.sin_half - 1e-5;
        Subtree {
            center: (self.low + self.high) * 0.5,
            radius: (self.high - self.low).length() * 0.500_005,
            axis: self.axis(),
            cos,
            sin: max(1.0 - cos * cos, 0.0).sqrt(),
            jumps: self.jumps,
        }
    }
}

impl Bounds {
    /// Joins bounds.
    pub fn joined(parts: &[Self]) -> Self {
        let mut all = Self::none();
        parts.iter().for_each(|part| all.add_part(part));
        let axis = all.axis();
        let reach = parts.iter().map(|part| part.reach(axis));
        all.with_cone(reach.fold(0.0, f32::max))
    }
}
