//! Where light that a surface scatters comes from, for searches of edges.

#[cfg(feature = "wgpu")]
use super::ShadingExpand;
use super::{DIELECTRIC, PHONG, Shading};
use crate::cube::*;
use crate::model::cone::widened;
use crate::model::frame::SinCos;
use crate::model::{V3, splat};

/// Lobes of facets with a smaller cosine of their half-angle are looked for over the whole hemisphere.
const WIDEST: f32 = 0.36;
/// The probability of the inner part of a lobe of facets, which has a long tail.
const INNER: f32 = 0.75;

/// Directions of a lobe in which edges are looked for, or a part of them.
#[apply(record!)]
pub(crate) struct Lobe {
    /// A cone that holds them, by the cosine and sine of its half-angle: about the normal it is the hemisphere.
    pub axis: V3,
    pub cos: f32,
    pub sin: f32,
    /// How fast the lobe falls from its axis.
    pub exponent: f32,
    /// The part of them: within a cone about the lobe of facets or outside of it.
    core: V3,
    core_cos: f32,
    inside: bool,
    /// The probability with which the part was chosen, and a uniform number that is left.
    pub chance: f32,
    pub rest: f32,
}

#[cfg_attr(feature = "wgpu", cube)]
impl Lobe {
    /// The hemisphere about a normal.
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

    /// Whether a direction belongs to the part.
    #[inline(always)]
    pub fn holds(&self, direction: V3) -> bool {
        // Vulkan's kernels don't compare what is true or false.
        let mut held = direction.dot(self.core) >= self.core_cos;
        if !self.inside {
            held = !held;
        }
        held
    }

    /// Takes a cone, widened by that of the rays, of which `tangent` is that of the half-angle.
    #[inline(always)]
    fn narrow(&mut self, cos: f32, tangent: f32) {
        let half = SinCos {
            sin: (1.0 - cos * cos).max(0.0).sqrt(),
            cos,
        };
        self.cos = widened(half, tangent).cos.max(0.0);
        self.sin = (1.0 - self.cos * self.cos).max(0.0).sqrt();
    }
}

#[cfg_attr(feature = "wgpu", cube)]
impl Shading {
    /// The glossy lobe or the rest, widened by the cone of rays; of facets a part of it, chosen by a uniform number.
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
        if comptime!(self.models.facets()) {
            let of_facets = self.model != PHONG && (of_gloss || self.model == DIELECTRIC);
            if of_facets {
                self.lobe_of_facets(&mut lobe, of_gloss, tangent);
            }
        }
        if of_gloss && self.model == PHONG {
            lobe.axis = self.mirror();
            lobe.exponent = self.exponent;
            // The lobe has fallen to 1e-4 there.
            let exponent = self.exponent.max(1e-3);
            lobe.narrow((const { -9.2f32 } / exponent).exp(), tangent);
        }
        lobe
    }

    /// The lobe of light that facets reflect, or that passes them.
    #[inline(never)]
    fn lobe_of_facets(&self, lobe: &mut Lobe, of_gloss: bool, tangent: f32) {
        let f = self.facets_about(self.normal);
        // The direction of smooth facets, the normal on that side, and how far a direction turns when its facet does.
        let mut turns = 2.0f32;
        if of_gloss {
            lobe.core = self.reflected_at(&f, self.normal);
        } else {
            lobe.axis = -self.normal;
            if comptime!(self.models.dielectric) {
                lobe.core = self.refracted_at(&f, self.normal).normalize();
                turns = self.bending();
            }
        }
        // A cone that holds 94 % of facets' light.
        let half = 2.0 * turns * f.alpha;
        let square = half * half;
        let cos = (1.0 - square) / (1.0 + square);
        if cos > WIDEST {
            lobe.core_cos = cos;
            lobe.inside = lobe.rest < INNER;
            if lobe.inside {
                lobe.chance = INNER;
                let rest = lobe.rest;
                lobe.rest = rest / INNER;
                let width = turns * f.alpha;
                lobe.axis = lobe.core;
                // It falls about as 1/(1 + (1 − cos) (n − 1))².
                lobe.exponent = 1.0 + 2.0 / (width * width);
                lobe.narrow(cos, tangent);
            } else {
                lobe.chance = const { 1.0 - INNER };
                lobe.rest = (lobe.rest - INNER) / const { 1.0 - INNER };
            }
        } else {
            lobe.core_cos = const { -2.0f32 };
        }
    }
}
