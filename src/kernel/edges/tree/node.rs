//! Nodes of a tree over edges: bounds of eight subtrees, and estimates of what these contribute.

use super::edge_list::EdgeList;
use super::jumps::Jumps;
use super::query::{Query8, dot, load as vectors};
use crate::accel::{F8, LANES, Lanes, Machine};
use crate::kernel::edges::edge::Kind;
use crate::model::{V3, v3};

/// Bounds of some edges.
pub(super) struct Bounds {
    centre: V3,
    radius: f32,
    /// A cone of the normals of folds.
    axis: V3,
    cos: f32,
    /// Jumps times lengths; where a fold is a silhouette, times the angle of the fold.
    jumps: Jumps,
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
            let (length, own) = (e.along.length(), Jumps::of(e));
            jumps.seen_always += length * own.seen_always;
            jumps.passes_always += length * own.passes_always;
            jumps.crease += length * own.crease;
        }
        let mut sum = V3::ZERO;
        for e in folds() {
            let [n, m] = source.normals(e);
            sum += n + m;
            jumps.fold += e.along.length() * (n - m).length();
            jumps.closed = jumps.closed.min(Jumps::of(e).closed);
        }
        let axis = if sum.length() > 0.0 {
            sum.normalize()
        } else {
            v3(0.0, 0.0, 1.0)
        };
        let mut cos: f32 = 1.0;
        for e in folds() {
            for normal in source.normals(e) {
                cos = cos.min(normal.dot(axis));
            }
        }
        Self {
            centre: (low + high) * 0.5,
            radius: (high - low).length() * 0.5 * (1.0 + 1e-5),
            axis,
            cos,
            jumps,
        }
    }
}

/// Bounds of up to eight subtrees.
pub(super) struct Node {
    centre: [Lanes; 3],
    radius: Lanes,
    /// A cone of the normals of folds.
    axis: [Lanes; 3],
    cos: Lanes,
    sin: Lanes,
    jumps: Jumps<Lanes>,
    /// Twice the index of a node, or of a leaf plus one.
    pub child: [u32; LANES],
}

impl Node {
    pub fn empty() -> Self {
        let zero = [0.0; LANES];
        Self {
            centre: [zero; 3],
            radius: zero,
            axis: [zero; 3],
            cos: zero,
            sin: zero,
            jumps: Jumps::default(),
            child: [u32::MAX; LANES],
        }
    }

    pub fn set(&mut self, i: usize, b: &Bounds, child: u32) {
        for (to, x) in self.centre.iter_mut().zip(b.centre.to_array()) {
            to[i] = x;
        }
        for (to, x) in self.axis.iter_mut().zip(b.axis.to_array()) {
            to[i] = x;
        }
        self.radius[i] = b.radius;
        // With a margin for rounding.
        let cos = b.cos - 1e-5;
        self.cos[i] = cos;
        self.sin[i] = (1.0 - cos * cos).max(0.0).sqrt();
        self.jumps.set(i, &b.jumps);
        self.child[i] = child;
    }

    /// Estimates of what the subtrees contribute, 0 only if they can't; and those to be entered, one bit
    /// each: they lie in the cone in part, or are seen under an angle whose sine is over `large`.
    #[inline(always)]
    pub fn weights<M: Machine>(&self, machine: M, q: &Query8<M>, large: f32) -> (Lanes, u32) {
        let load = |lanes: &Lanes| F8::load(machine, lanes);
        let number = |x: f32| F8::splat(machine, x);
        let (zero, one) = (number(0.0), number(1.0));
        let r = q.to(&self.centre);
        let radius = load(&self.radius);
        let squared = dot(r, r);
        let distance = squared.sqrt();
        let along = dot(r, q.axis);
        let across = (squared - along * along).max(zero).sqrt();
        let beside = across * q.cos - along * q.sin;
        let missed = radius.less(beside);
        // The angle under which the sphere is seen.
        let sin_seen = radius.div(distance.max(number(1e-20))).min(one);
        let cos_seen = (one - sin_seen * sin_seen).max(zero).sqrt();
        let (sin, cos) = (load(&self.sin), load(&self.cos));
        let sin_sum = sin * cos_seen + cos * sin_seen;
        let cos_sum = cos * cos_seen - sin * sin_seen;
        let facing = dot(vectors(machine, &self.axis), r).div(distance.max(number(1e-20)));
        // Where normals and directions spread over more than a half-space anything is possible.
        let narrow = zero.less(cos_sum).and(distance.less(radius).not());
        let no_silhouette = narrow.and(sin_sum.less(facing.abs()));
        let fold = load(&self.jumps.fold).div(sin_sum.abs() + number(0.05));
        let fold = no_silhouette.select(zero, fold);
        let hidden = narrow
            .and(sin_sum.less(facing))
            .and(zero.less(load(&self.jumps.closed)));
        let crease = hidden.select(zero, load(&self.jumps.crease) * q.creases);
        let always = self.jumps.always(machine, q);
        let nearest = (along + radius).div(distance + radius).max(zero).min(one);
        let weight = (always + fold + crease) * q.lobe(nearest);
        let weight = weight.div(squared + radius * radius);
        let weight = missed.select(zero, weight);
        let whole = (beside + radius)
            .less(zero)
            .and(sin_seen.less(number(large)));
        (weight.lanes(), !whole.bits())
    }
}
