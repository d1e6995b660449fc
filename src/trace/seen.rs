//! What a camera ray sees.

use crate::cube::*;
use crate::model::V3;

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
}

impl Seen {
    pub fn times(&self, factor: f32) -> Self {
        Self {
            radiance: self.radiance * factor,
            opacity: self.opacity * factor,
            depth: self.depth * factor,
            normal: self.normal * factor,
        }
    }
}
