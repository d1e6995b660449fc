//! Queries of a tree over edges.

use crate::accel::{F8, Lanes, Machine, Mask8};
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

/// Eight vectors.
#[inline(always)]
pub(super) fn load<M: Machine>(machine: M, lanes: &[Lanes; 3]) -> [F8<M>; 3] {
    let [x, y, z] = lanes;
    [
        F8::load(machine, x),
        F8::load(machine, y),
        F8::load(machine, z),
    ]
}
