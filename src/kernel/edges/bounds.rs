//! Bounds of edges: a sphere, a cone of normals, and sums of jumps.

use super::Edges;
use crate::kernel::scene::KernelScene;
use crate::model::edge_weight::{Jumps, SeenEdge, Subtree};
use crate::model::{V3, v3};
use crate::trace::NONE;

/// Edges, with the scene that contains their triangles.
pub(super) struct EdgeList<'a> {
    pub edges: &'a Edges,
    pub scene: &'a KernelScene,
    /// Whether the tree is for a GPU, which computes its leaves.
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
            jumps: Jumps::of_kind(e.kind as u32, e.crease, e.closed),
        };
        (seen, self.scene.shift(first, 1.0))
    }
}

/// Bounds of some edges.
#[derive(Clone, Copy)]
pub(super) struct Bounds {
    low: V3,
    high: V3,
    /// A cone of the normals of folds: their sum, and the largest angle to it.
    normals: V3,
    angle: f32,
    /// Sums of jump × length; for the silhouettes of folds also × the angle of the fold.
    jumps: Jumps,
}

/// Returns the direction of a sum of normals.
fn direction(sum: V3) -> V3 {
    if sum.length() > 0.0 {
        sum.normalize()
    } else {
        v3(0.0, 0.0, 1.0)
    }
}

/// Returns the angle in radians between unit vectors whose ends have the distance `apart`.
fn angle(apart: f32) -> f32 {
    // The distance keeps the digits of small angles.
    2.0 * (0.5 * apart).min(1.0).asin()
}

impl Bounds {
    /// Returns the bounds of edges that move by the given displacements over the shutter.
    pub fn new(edges: &[(SeenEdge, V3)]) -> Self {
        let mut this = Self {
            low: V3::ONE * f32::MAX,
            high: V3::ONE * f32::MIN,
            normals: V3::ZERO,
            angle: 0.0,
            jumps: Jumps {
                closed: 1.0,
                ..Jumps::default()
            },
        };
        let folds = || edges.iter().filter(|(e, _)| e.jumps.fold > 0.0);
        for &(e, v) in edges {
            let (half, length) = (e.along * 0.5, 2.0 * e.half);
            for p in [e.to - half, e.to + half] {
                this.low = this.low.min(p).min(p + v);
                this.high = this.high.max(p).max(p + v);
            }
            let (sum, own) = (&mut this.jumps, &e.jumps);
            sum.seen_always += length * own.seen_always;
            sum.passes_always += length * own.passes_always;
            sum.crease += length * own.crease;
            sum.fold += length * own.fold * (e.front - e.back).length();
        }
        for (e, _) in folds() {
            this.normals += e.front + e.back;
            this.jumps.closed = this.jumps.closed.min(e.jumps.closed);
        }
        let axis = direction(this.normals);
        let apart = folds().flat_map(|(e, _)| [e.front, e.back].map(|n| (n - axis).length()));
        this.angle = angle(apart.fold(0.0, f32::max));
        this
    }

    pub fn subtree(&self) -> Subtree {
        // The margin is for rounding.
        let cos = self.angle.min(std::f32::consts::PI).cos() - 1e-5;
        Subtree {
            center: (self.low + self.high) * 0.5,
            radius: (self.high - self.low).length() * 0.5 * (1.0 + 1e-5),
            axis: direction(self.normals),
            cos,
            sin: (1.0 - cos * cos).max(0.0).sqrt(),
            jumps: self.jumps,
        }
    }

    /// Joins bounds, of which there must be at least one.
    pub fn joined(parts: &[Self]) -> Self {
        let mut all = parts[0];
        for part in &parts[1..] {
            let (sum, own) = (&mut all.jumps, &part.jumps);
            sum.seen_always += own.seen_always;
            sum.passes_always += own.passes_always;
            sum.fold += own.fold;
            sum.crease += own.crease;
            sum.closed = sum.closed.min(own.closed);
            all.low = all.low.min(part.low);
            all.high = all.high.max(part.high);
            all.normals += part.normals;
        }
        let axis = direction(all.normals);
        let folds = parts
            .iter()
            .filter(|p| p.normals != V3::ZERO || p.angle > 0.0);
        let reach = folds.map(|p| p.angle + angle((direction(p.normals) - axis).length()));
        all.angle = reach.fold(0.0, f32::max);
        all
    }
}
