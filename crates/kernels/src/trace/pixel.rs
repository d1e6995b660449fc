//! The visible quantities of a primary ray.

use crate::cube::*;
use crate::model::V3;

/// The surface that a primary ray sees and the light that its path returns, or the derivatives of a loss with respect
/// to these.
#[apply(zeroed!)]
#[derive(PartialEq)]
pub struct Seen {
    pub radiance: V3,
    /// 1 where there is a surface.
    pub opacity: f32,
    /// Distance to the surface.
    pub depth: f32,
    /// Geometric normal on the visible side.
    pub normal: V3,
}

#[cfg_attr(feature = "gpu", cube)]
impl Seen {
    /// Returns the sum of the absolute values of all numbers.
    #[inline(always)]
    pub fn size(&self) -> f32 {
        self.radiance.abs().element_sum()
            + self.opacity.abs()
            + self.depth.abs()
            + self.normal.abs().element_sum()
    }

    /// Adds `other` times a factor.
    #[inline(always)]
    pub fn add(&mut self, other: &Seen, factor: f32) {
        self.radiance += other.radiance * factor;
        self.opacity += other.opacity * factor;
        self.depth += other.depth * factor;
        self.normal += other.normal * factor;
    }

    /// Returns the jump of the loss across an edge, for derivatives `self`. `light` is the quantities seen on the −
    /// side minus those on the + side.
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

    /// Returns the product of each number with that of `mask`.
    pub fn masked(&self, mask: &Self) -> Self {
        Self {
            radiance: self.radiance.times(mask.radiance),
            opacity: self.opacity * mask.opacity,
            depth: self.depth * mask.depth,
            normal: self.normal.times(mask.normal),
        }
    }
}
