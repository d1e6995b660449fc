//! Estimates of the light from groups of emitters at a point, by bounds of position, orientation and power.

use super::V3;
use crate::cube::*;

/// Power-weighted moments of the axes n of emitters.
#[apply(zeroed!)]
pub struct Axes {
    /// Their mean a.
    pub mean: V3,
    /// The mean of their products, M = E[n nᵀ]: xx, yy, zz, and xy, xz, yz.
    pub squares: V3,
    pub products: V3,
}

/// A group of emitters: a bounding sphere, their axes, and their power, which is 0 for an empty group.
#[apply(record!)]
pub struct Sphere {
    pub center: V3,
    pub radius: f32,
    pub axes: Axes,
    pub power: f32,
}

/// What the spread of directions to a sphere seen under 90° adds to a squared cosine. An emitter seen along its
/// surface then has the mean of those around it.
const SPREAD: f32 = 0.25;
/// Emitters around a point contribute about as much light as from this fraction of their sphere's squared radius: the
/// mean of 1/r² over a box is six times that at the corners.
const INSIDE: f32 = 0.125;

#[cfg_attr(feature = "gpu", cube)]
impl Axes {
    /// Returns approximately the mean of max(n·d, 0) = (n·d + |n·d|)/2, as (a·d + √(dᵀM d))/2, which is never below
    /// the mean. `spread` is the squared spread of the directions.
    #[inline(always)]
    pub fn facing(&self, d: V3, spread: f32) -> f32 {
        let squares = self.squares.dot(d.times(d));
        let products =
            self.products.x * d.x * d.y + self.products.y * d.x * d.z + self.products.z * d.y * d.z;
        let square = max(squares + 2.0 * products + spread, 0.0);
        max(0.5 * (self.mean.dot(d) + square.sqrt()), 0.0)
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Sphere {
    /// Returns the approximate irradiance at a point with a normal due to the group.
    #[inline(always)]
    pub fn irradiance(&self, x: V3, normal: V3) -> f32 {
        let to = self.center - x;
        let squared = max(to.length_squared(), 1e-30);
        let inverse = 1.0 / squared.sqrt();
        // The sine of the angle under which the sphere is seen.
        let seen = max(min(self.radius * inverse, 1.0), 1e-6);
        let emits = self.axes.facing(to * -inverse, SPREAD * seen * seen);
        // The mean cosine over the sphere, if the horizon divides it.
        let incident = to.dot(normal) * inverse;
        let above = max(incident + seen, 0.0);
        let receives = select(incident < seen, above * above / (4.0 * seen), incident);
        self.power * emits * receives / max(squared, INSIDE * self.radius * self.radius)
    }

    /// Returns whether a ray intersects the sphere.
    #[inline(always)]
    pub fn is_met(&self, x: V3, direction: V3) -> bool {
        let to = self.center - x;
        let along = to.dot(direction);
        let across = to - direction * along;
        // With a margin for rounding errors far away.
        let reach = along.abs() * 1e-6 + self.radius;
        self.power > 0.0 && across.length_squared() < reach * reach && along + reach > 0.0
    }
}

impl Axes {
    /// Sums axes weighted by their fractions of the power; an emitter without an axis shines in all directions.
    pub fn new(all: impl Iterator<Item = (Option<V3>, f32)>) -> Self {
        let mut this = Self::default();
        for (axis, share) in all {
            let Some(n) = axis else {
                this.squares += V3::ONE * (4.0 * share);
                continue;
            };
            let crossed = super::v3(n.x * n.y, n.x * n.z, n.y * n.z);
            this.mean += n * share;
            this.squares += n * n * share;
            this.products += crossed * share;
        }
        this
    }

    pub fn numbers(&self) -> [f32; 9] {
        let vectors = [self.mean, self.squares, self.products];
        let mut all = [0.0; 9];
        all.as_chunks_mut::<3>()
            .0
            .iter_mut()
            .zip(vectors)
            .for_each(|(to, v)| *to = v.to_array());
        all
    }
}
