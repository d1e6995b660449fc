//! Records of a sampled direction.

use crate::cube::*;
use crate::model::{V3, splat};

/// A direction sampled from the BSDF.
#[apply(zeroed!)]
pub struct Scatter {
    pub direction: V3,
    /// f·cos θ over the density of the direction. It is 0 where the sample is lost: no light is gathered along its
    /// direction, although others may sample that direction.
    pub weight: V3,
    /// The direction in the frame of the lobe's axis: the normal, or the mirror direction.
    pub local: V3,
    /// Whether the specular lobe was sampled; for a dielectric, whether light is reflected.
    pub of_gloss: bool,
    pub u: f32,
    pub v: f32,
}

/// The part of its velocity with which a sampled direction turns at fixed random numbers, and the derivative of this part
/// with respect to the direction.
#[apply(record!)]
pub struct Turning {
    pub part: f32,
    pub by_direction: V3,
}

#[cfg_attr(feature = "gpu", cube)]
impl Turning {
    #[inline(always)]
    pub fn freely() -> Turning {
        Turning {
            part: 1.0f32.runtime(),
            by_direction: splat(0.0),
        }
    }
}
