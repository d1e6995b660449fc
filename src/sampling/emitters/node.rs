//! A node of a tree over emitters: bounds of eight branches, and estimates of the light that they bring.

use super::branches::Sphere;
use crate::accel::{F8, LANES, Lanes, Machine};
use crate::model::V3;

pub(super) const NONE: u32 = u32::MAX;
/// How much directions to the points of a sphere that is seen under 90° add to a squared cosine: an emitter that is seen
/// along its surface has then the mean of those around.
pub(crate) const SPREAD: f32 = 0.25;
/// Emitters around a point bring about as much light as from this share of their sphere's squared radius: a mean of 1/r²
/// over a box is six times that at the corners.
pub(crate) const INSIDE: f32 = 0.125;

/// Bounds of up to eight emitters, or of as many branches.
pub(super) struct Node {
    pub centre: [Lanes; 3],
    pub radius: Lanes,
    /// Means of axes, and of their products.
    pub axis: [Lanes; 3],
    pub moments: [Lanes; 6],
    /// 0 where there is nothing.
    pub power: Lanes,
    /// Nodes, or emitters of a leaf.
    pub child: [u32; LANES],
    pub parent: Place,
    /// The number of a leaf.
    pub group: Option<u32>,
}

/// A node and one of its eight.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub node: u32,
    pub lane: u32,
}

impl Place {
    pub const NONE: Self = Self {
        node: u32::MAX,
        lane: 0,
    };
}

/// A point and a direction, such as a normal, each of their numbers eight times.
pub(super) struct Query<M: Machine> {
    x: [F8<M>; 3],
    direction: [F8<M>; 3],
}

impl<M: Machine> Query<M> {
    #[inline(always)]
    pub fn new(machine: M, x: V3, direction: V3) -> Self {
        let splat = |v: V3| {
            [
                F8::splat(machine, v.x),
                F8::splat(machine, v.y),
                F8::splat(machine, v.z),
            ]
        };
        Self {
            x: splat(x),
            direction: splat(direction),
        }
    }
}

#[inline(always)]
fn dot<M: Machine>(a: [F8<M>; 3], b: [F8<M>; 3]) -> F8<M> {
    a[2].mul_add(b[2], a[1].mul_add(b[1], a[0] * b[0]))
}

impl Node {
    pub fn empty(parent: Place) -> Self {
        let zero = [0.0; LANES];
        Self {
            centre: [zero; 3],
            radius: zero,
            axis: [zero; 3],
            moments: [zero; 6],
            power: zero,
            child: [NONE; LANES],
            parent,
            group: None,
        }
    }

    pub fn set(&mut self, lane: usize, sphere: &Sphere) {
        for (to, x) in self.centre.iter_mut().zip(sphere.centre.to_array()) {
            to[lane] = x;
        }
        for (to, x) in self.axis.iter_mut().zip(sphere.axes.mean.to_array()) {
            to[lane] = x;
        }
        for (to, x) in self.moments.iter_mut().zip(sphere.axes.moments) {
            to[lane] = x;
        }
        self.radius[lane] = sphere.radius;
        self.power[lane] = sphere.power;
    }

    /// The bits of those whose spheres a ray meets.
    #[inline(always)]
    pub fn met_by<M: Machine>(&self, machine: M, ray: &Query<M>) -> u32 {
        let load = |lanes: &Lanes| F8::load(machine, lanes);
        let zero = F8::splat(machine, 0.0);
        let [cx, cy, cz] = self.centre.each_ref().map(load);
        let to = [cx - ray.x[0], cy - ray.x[1], cz - ray.x[2]];
        let radius = load(&self.radius);
        let along = dot(to, ray.direction);
        let [x, y, z] = ray.direction.map(|d| along * d);
        let across = [to[0] - x, to[1] - y, to[2] - z];
        // With a margin for rounding far away.
        let reach = along.abs().mul_add(F8::splat(machine, 1e-6), radius);
        let near = dot(across, across).less(reach * reach);
        let ahead = zero.less(along + reach);
        let any = zero.less(load(&self.power));
        near.and(ahead).and(any).bits()
    }

    /// About the irradiance of a point by each, as [`LightTree::all`], or power where all are 0; with their sum.
    #[inline(always)]
    pub fn weights<M: Machine>(&self, machine: M, query: &Query<M>) -> (Lanes, f32) {
        let load = |lanes: &Lanes| F8::load(machine, lanes);
        let number = |x: f32| F8::splat(machine, x);
        let (zero, one) = (number(0.0), number(1.0));
        let [cx, cy, cz] = self.centre.each_ref().map(load);
        let to = [cx - query.x[0], cy - query.x[1], cz - query.x[2]];
        let (radius, power) = (load(&self.radius), load(&self.power));
        let squared = dot(to, to).max(number(1e-30));
        let inverse = one.div(squared.sqrt());
        // The sine of the angle under which the sphere is seen.
        let seen = (radius * inverse).min(one).max(number(1e-6));
        let [x, y, z] = to.map(|c| (zero - c) * inverse);
        let [xx, yy, zz, xy, xz, yz] = self.moments.each_ref().map(load);
        let products = dot([xx, yy, zz], [x * x, y * y, z * z]);
        let crossed = dot([xy, xz, yz], [x * y, x * z, y * z]);
        let spread = crossed.mul_add(number(2.0), number(SPREAD) * seen * seen);
        let emits =
            dot([x, y, z], self.axis.each_ref().map(load)) + (products + spread).max(zero).sqrt();
        // The mean of cosines over the sphere, where the horizon divides it.
        let incident = dot(to, query.direction) * inverse;
        let above = (incident + seen).max(zero);
        let receives = incident
            .less(seen)
            .select((above * above).div(number(4.0) * seen), incident);
        let squared = squared.max(number(INSIDE) * radius * radius);
        let weight = (number(0.5) * power * emits.max(zero) * receives).div(squared);
        let weight = zero.less(power).select(weight, zero);
        let total = weight.sum();
        if total > 0.0 && total.is_finite() {
            (weight.lanes(), total)
        } else {
            (self.power, power.sum())
        }
    }
}
