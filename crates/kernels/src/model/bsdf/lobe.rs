//! Lobes of directions from which a surface scatters light, for edge searches.

use super::Shading;
#[cfg(feature = "gpu")]
use super::ShadingExpand;
use crate::cube::*;
use crate::model::cone::widened;
use crate::model::frame::SinCos;
use crate::model::{V3, splat};

/// Microfacet lobes with a smaller cosine of their half-angle are searched over the whole hemisphere.
const WIDEST: f32 = 0.36;
/// Probability of the inner part of a microfacet lobe, which has a long tail.
const INNER: f32 = 0.75;

/// Directions of a lobe, or of a part of it, in which edges are searched.
#[apply(record!)]
pub struct Lobe {
    /// A cone that contains them, with the cosine and sine of its half-angle; the cone about the normal is the
    /// hemisphere.
    pub axis: V3,
    pub cos: f32,
    pub sin: f32,
    /// Falloff of the lobe from its axis.
    pub exponent: f32,
    /// The part: inside or outside of a cone about the center of the microfacet lobe.
    core: V3,
    core_cos: f32,
    inside: bool,
    /// The probability with which the part was chosen, and the remaining uniform number.
    pub chance: f32,
    pub rest: f32,
}

#[cfg_attr(feature = "gpu", cube)]
impl Lobe {
    /// Returns the hemisphere about a normal.
    #[inline(always)]
    pub fn whole(normal: V3) -> Lobe {
        Lobe {
            axis: normal,
            cos: 0.0f32.runtime(),
            sin: 1.0f32.runtime(),
            exponent: 0.0f32.runtime(),
            core: splat(0.0),
            core_cos: (-1.0f32).runtime(),
            inside: true.runtime(),
            chance: 1.0f32.runtime(),
            rest: 0.0f32.runtime(),
        }
    }

    /// Returns whether a direction belongs to the part.
    #[inline(always)]
    pub fn holds(&self, direction: V3) -> bool {
        // Vulkan kernels do not support comparison of booleans.
        let held = direction.dot(self.core) >= self.core_cos;
        select(self.inside, held, !held)
    }

    /// Sets the cone's half-angle, widened by the cone of rays; `tangent` is the tangent of the rays' half-angle.
    #[inline(always)]
    pub(super) fn narrow(&mut self, cos: f32, tangent: f32) {
        let half = SinCos {
            sin: max(1.0 - cos * cos, 0.0).sqrt(),
            cos,
        };
        self.cos = max(widened(half, tangent).cos, 0.0);
        self.sin = max(1.0 - self.cos * self.cos, 0.0).sqrt();
    }

    /// Selects a part of the microfacet lobe. `core` is the direction for a smooth surface, and directions turn
    /// `turns` times as far as facets do.
    #[inline(always)]
    pub(super) fn take_facets(&mut self, core: V3, turns: f32, alpha: f32, tangent: f32) {
        self.core = core;
        // A cone that contains 94 % of the facets' light.
        let half = 2.0 * turns * alpha;
        let square = half * half;
        let cos = (1.0 - square) / (1.0 + square);
        if cos > WIDEST {
            self.core_cos = cos;
            self.inside = self.rest < INNER;
            if self.inside {
                self.chance = INNER;
                let rest = self.rest;
                self.rest = rest / INNER;
                let width = turns * alpha;
                self.axis = core;
                // It falls off roughly as 1/(1 + (1 − cos) (n − 1))².
                self.exponent = 1.0 + 2.0 / (width * width);
                self.narrow(cos, tangent);
            } else {
                self.chance = const { 1.0 - INNER };
                self.rest = (self.rest - INNER) / const { 1.0 - INNER };
            }
        } else {
            self.core_cos = const { -2.0f32 };
        }
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Shading {
    /// Returns the specular lobe or the other lobe, widened by the cone of rays. For microfacets it is a part of the
    /// lobe, chosen by a uniform number.
    #[inline(always)]
    pub fn lobe(&self, of_gloss: bool, choice: f32, tangent: f32) -> Lobe {
        let mut lobe = Lobe {
            axis: self.normal,
            cos: 0.0,
            sin: 1.0,
            exponent: 1.0,
            core: splat(0.0),
            core_cos: -1.0,
            inside: true,
            chance: 1.0,
            rest: choice,
        };
        self.narrow_lobe(&mut lobe, of_gloss, tangent);
        lobe
    }
}
