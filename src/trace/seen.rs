//! What a camera ray sees.

use crate::cube::*;

use super::scene::{EMITS, Scene};
use super::sums::Sums;
use super::surface::{Point, PointGradient};
use crate::model::{V3, splat};

/// The surface that a camera ray sees, and the light that its path brings back; or the derivatives of a loss by these.
#[apply(zeroed!)]
#[derive(PartialEq)]
pub(crate) struct Seen {
    pub radiance: V3,
    /// 1 where there is a surface.
    pub opacity: f32,
    /// The distance to it.
    pub depth: f32,
    /// Its geometric normal on the side that is seen.
    pub normal: V3,
}

#[cfg_attr(feature = "wgpu", cube)]
impl Seen {
    /// The sum of the sizes of all numbers.
    #[inline(always)]
    pub fn size(&self) -> f32 {
        self.radiance.abs().element_sum()
            + self.opacity.abs()
            + self.depth.abs()
            + self.normal.abs().element_sum()
    }

    /// Adds another, times a factor.
    #[inline(always)]
    pub fn add(&mut self, other: &Seen, factor: f32) {
        self.radiance += other.radiance * factor;
        self.opacity += other.opacity * factor;
        self.depth += other.depth * factor;
        self.normal += other.normal * factor;
    }

    /// Of derivatives: how much the loss changes from one side of an edge to the other, by what is seen on the − side
    /// less what is on the + side.
    #[inline(always)]
    pub fn jump(&self, light: &Seen) -> f32 {
        self.radiance.dot(light.radiance)
            + self.opacity * light.opacity
            + self.depth * light.depth
            + self.normal.dot(light.normal)
    }
}

impl Seen {
    pub fn times(&self, factor: f32) -> Self {
        let mut all = Self::default();
        all.add(self, factor);
        all
    }
}

/// The light that a surface point emits towards the point that sees it.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn emitted(scene: &Scene, p: &Point) -> V3 {
    let mut emission = splat(0.0);
    if scene.bits_of(p.material) & EMITS != 0 {
        let cosine = -p.side * p.shading.geometric.dot(p.shading.incoming);
        emission = scene.emission_of(p.material, p.uv, cosine);
    }
    emission
}

/// Back over what the camera sees of a surface point, times the derivatives of a loss by that: light that it emits, where
/// its place counts if that is a texture, its normal, and its distance, by which it returns the derivative.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn seen_backward(
    scene: &Scene,
    sums: &Sums,
    p: &Point,
    upstream: &Seen,
    by: &mut PointGradient,
) -> f32 {
    if p.side > 0.0 && scene.bits_of(p.material) & EMITS != 0 {
        if scene.glows(p.material) {
            by.emission = upstream.radiance;
        } else {
            scene.emission_backward(sums, p.material, p.uv, upstream.radiance);
        }
    }
    by.geometric += upstream.normal;
    upstream.depth
}
