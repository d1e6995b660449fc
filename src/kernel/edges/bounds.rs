//! Bounds of edges: a sphere, a cone of normals, and what jumps.

use rayon::prelude::*;

use super::{Edge, Kind};
use crate::kernel::scene::KernelScene;
use crate::model::edge_weight::{Jumps, SeenEdge, Subtree};
use crate::model::{V3, v3};

/// Edges with the triangles that they belong to.
pub(super) struct EdgeList<'a> {
    pub edges: &'a [Edge],
    pub scene: &'a KernelScene,
    /// Their middles: trees are built by these.
    middles: Vec<V3>,
}

impl<'a> EdgeList<'a> {
    pub fn new(edges: &'a [Edge], scene: &'a KernelScene) -> Self {
        let middles = edges.par_iter().map(|e| e.a + e.along * 0.5);
        Self {
            middles: middles.collect(),
            edges,
            scene,
        }
    }

    /// The way of an edge over the shutter.
    pub fn velocity(&self, e: &Edge) -> V3 {
        let all = self.scene.velocities.as_ref();
        all.map_or(V3::ZERO, |v| v[e.object as usize].into())
    }

    pub fn middle(&self, index: u32) -> V3 {
        self.middles[index as usize]
    }

    /// An edge as it is seen from the origin at the start of the shutter.
    pub fn seen(&self, index: u32) -> SeenEdge {
        let e = &self.edges[index as usize];
        let [front, back] = self.normals(e);
        SeenEdge {
            to: self.middle(index),
            half: 0.5 * e.along.length(),
            along: e.along,
            front,
            back,
            jumps: e.jumps(),
        }
    }

    /// The normals of the first two faces; twice that of the only one.
    fn normals(&self, e: &Edge) -> [V3; 2] {
        let [first, second, ..] = e.faces;
        let second = if second == u32::MAX { first } else { second };
        [first, second].map(|k| self.scene.triangle(k).normal)
    }
}

impl Edge {
    fn jumps(&self) -> Jumps {
        let mut jumps = Jumps {
            closed: f32::from(u8::from(self.closed)),
            ..Jumps::default()
        };
        match self.kind {
            Kind::Fold => {
                jumps.fold = 1.0;
                jumps.crease = self.crease;
            }
            Kind::Border => {
                jumps.seen_always = 1.0;
                jumps.passes_always = 1.0;
            }
            Kind::Crossing => jumps.seen_always = 1.0,
        }
        jumps
    }
}

/// Bounds of some edges.
#[derive(Clone, Copy)]
pub(super) struct Bounds {
    low: V3,
    high: V3,
    /// A cone of the normals of folds: their sum, and the greatest angle to it.
    normals: V3,
    angle: f32,
    /// Jumps times lengths; where a fold is a silhouette, times the angle of the fold.
    jumps: Jumps,
}

/// The direction of a sum of normals.
fn direction(sum: V3) -> V3 {
    if sum.length() > 0.0 {
        sum.normalize()
    } else {
        v3(0.0, 0.0, 1.0)
    }
}

/// The angle between unit vectors, radians.
fn angle(a: V3, b: V3) -> f32 {
    // By both, so that small angles keep their digits.
    a.cross(b).length().atan2(a.dot(b))
}

impl Bounds {
    pub fn new(source: &EdgeList, list: &[u32]) -> Self {
        let edges = || list.iter().map(|&i| &source.edges[i as usize]);
        let folds = || edges().filter(|e| e.kind == Kind::Fold);
        let (mut low, mut high) = (V3::ONE * f32::MAX, V3::ONE * f32::MIN);
        let mut jumps = Jumps {
            closed: 1.0,
            ..Jumps::default()
        };
        for e in edges() {
            let v = source.velocity(e);
            for p in [e.a, e.a + e.along, e.a + v, e.a + e.along + v] {
                low = low.min(p);
                high = high.max(p);
            }
            let (length, own) = (e.along.length(), e.jumps());
            jumps.seen_always += length * own.seen_always;
            jumps.passes_always += length * own.passes_always;
            jumps.crease += length * own.crease;
        }
        let mut normals = V3::ZERO;
        for e in folds() {
            let [n, m] = source.normals(e);
            normals += n + m;
            jumps.fold += e.along.length() * (n - m).length();
            jumps.closed = jumps.closed.min(e.jumps().closed);
        }
        let axis = direction(normals);
        let angles = folds().flat_map(|e| source.normals(e).map(|n| angle(n, axis)));
        Self {
            low,
            high,
            normals,
            angle: angles.fold(0.0, f32::max),
            jumps,
        }
    }

    pub fn subtree(&self) -> Subtree {
        // With a margin for rounding.
        let cos = self.angle.min(std::f32::consts::PI).cos() - 1e-5;
        Subtree {
            centre: (self.low + self.high) * 0.5,
            radius: (self.high - self.low).length() * 0.5 * (1.0 + 1e-5),
            axis: direction(self.normals),
            cos,
            sin: (1.0 - cos * cos).max(0.0).sqrt(),
            jumps: self.jumps,
        }
    }

    /// Of all, at least one.
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
        let reach = folds.map(|p| p.angle + angle(direction(p.normals), axis));
        all.angle = reach.fold(0.0, f32::max);
        all
    }
}
