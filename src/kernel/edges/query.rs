//! Queries of a tree over edges, and what jumps at the edges.

use rayon::prelude::*;

use super::{Edge, Kind};
use crate::accel::{F8, Lanes, Machine, Mask8};
use crate::kernel::scene::KernelScene;
use crate::model::V3;

/// A search for an edge: a point, a cone of directions seen from it, and a purpose.
#[derive(Clone, Copy, Debug)]
pub(in crate::kernel) struct Query {
    pub x: V3,
    pub time: f32,
    pub axis: V3,
    /// Cosine and sine of the half-angle of the cone, at most 90°.
    pub cos: f32,
    pub sin: f32,
    /// Contributions grow about as cosⁿ of the angle to the axis.
    pub exponent: f32,
    /// Whether only edges count at which jumps whether light passes.
    pub shadows: bool,
}

/// A query, each of its numbers eight times.
pub(super) struct Query8<M: Machine> {
    machine: M,
    pub x: [F8<M>; 3],
    pub time: f32,
    pub axis: [F8<M>; 3],
    pub cos: F8<M>,
    pub sin: F8<M>,
    pub exponent: f32,
    pub narrow: bool,
    /// 1 where creases count.
    pub creases: F8<M>,
    /// Whether only edges count at which jumps whether light passes: a mask, and a flag.
    pub shadows: Mask8<M>,
    pub is_of_light: bool,
}

impl<M: Machine> Query8<M> {
    #[inline(always)]
    pub fn new(machine: M, q: &Query) -> Self {
        let splat = |x| F8::splat(machine, x);
        let creases = splat(if q.shadows { 0.0 } else { 1.0 });
        Self {
            machine,
            x: q.x.to_array().map(splat),
            time: q.time,
            axis: q.axis.to_array().map(splat),
            cos: splat(q.cos),
            sin: splat(q.sin),
            exponent: q.exponent,
            narrow: q.cos > 0.0,
            creases,
            shadows: creases.less(splat(0.5)),
            is_of_light: q.shadows,
        }
    }

    /// The vectors to points from the query's.
    #[inline(always)]
    pub fn to(&self, points: &[Lanes; 3]) -> [F8<M>; 3] {
        let [x, y, z] = points;
        [
            F8::load(self.machine, x) - self.x[0],
            F8::load(self.machine, y) - self.x[1],
            F8::load(self.machine, z) - self.x[2],
        ]
    }

    /// About cosⁿ of the angle to the axis.
    #[inline(always)]
    pub fn lobe(&self, cosine: F8<M>) -> F8<M> {
        let number = |x: f32| F8::splat(self.machine, x);
        if self.exponent == 0.0 {
            return number(1.0);
        }
        let sharp = number((self.exponent - 1.0).max(0.0));
        let s = (number(1.0) - cosine).mul_add(sharp, number(1.0));
        (cosine + number(1e-3)).div(s * s)
    }
}

#[inline(always)]
pub(super) fn dot<M: Machine>(a: [F8<M>; 3], b: [F8<M>; 3]) -> F8<M> {
    a[2].mul_add(b[2], a[1].mul_add(b[1], a[0] * b[0]))
}

#[inline(always)]
pub(super) fn cross<M: Machine>(a: [F8<M>; 3], b: [F8<M>; 3]) -> [F8<M>; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[inline(always)]
pub(super) fn load<M: Machine>(machine: M, lanes: &[Lanes; 3]) -> [F8<M>; 3] {
    let [x, y, z] = lanes;
    [
        F8::load(machine, x),
        F8::load(machine, y),
        F8::load(machine, z),
    ]
}

/// The most that may jump at edges, by what makes it jump; of one edge between 0 and 1.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Jumps<T = f32> {
    /// Colours that always jump, and jumps of whether light passes.
    pub seen_always: T,
    pub passes_always: T,
    /// Jumps of folds that are silhouettes.
    pub fold: T,
    /// Jumps where both faces of a fold are seen.
    pub crease: T,
    /// 1 where all folds are of closed objects.
    pub closed: T,
}

impl Jumps {
    pub fn of(e: &Edge) -> Self {
        let mut jumps = Self {
            closed: f32::from(u8::from(e.closed)),
            ..Self::default()
        };
        match e.kind {
            Kind::Fold => {
                jumps.fold = 1.0;
                jumps.crease = e.crease;
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

impl Jumps<Lanes> {
    pub fn set(&mut self, i: usize, of: &Jumps) {
        self.seen_always[i] = of.seen_always;
        self.passes_always[i] = of.passes_always;
        self.fold[i] = of.fold;
        self.crease[i] = of.crease;
        self.closed[i] = of.closed;
    }

    /// The jumps that are there wherever the edge is seen from.
    #[inline(always)]
    pub fn always<M: Machine>(&self, machine: M, q: &Query8<M>) -> F8<M> {
        let load = |lanes: &Lanes| F8::load(machine, lanes);
        q.shadows
            .select(load(&self.passes_always), load(&self.seen_always))
    }
}

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
        let all = &self.scene.velocities;
        all.as_ref().map_or(V3::ZERO, |v| v[e.object as usize])
    }

    pub fn middle(&self, index: u32) -> V3 {
        self.middles[index as usize]
    }

    /// The normals of the first two faces; twice that of the only one.
    pub fn normals(&self, e: &Edge) -> [V3; 2] {
        let [first, second, ..] = e.faces;
        let second = if second == u32::MAX { first } else { second };
        [first, second].map(|k| self.scene.triangles[k as usize].normal)
    }
}
