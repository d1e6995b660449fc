//! Ranges of the microfacet parameters. A value outside its range, which an optimizer may step to, is clamped to the
//! nearest value inside. Its derivative is 0 there, as the derivative of a clamp is.

#[cfg(feature = "gpu")]
use super::ShadingExpand;
use super::{Shading, ShadingGradient};
use crate::cube::*;
use crate::host::{self, BsdfKind};
use crate::model::{V3, splat, v3};

pub(super) const METALLIC: u32 = BsdfKind::MetallicRoughness as u32;
pub(super) const CONDUCTOR: u32 = BsdfKind::Conductor as u32;

const MAX_METAL_IOR: f32 = host::MAX_METAL_IOR as f32;
const MIN_IOR: f32 = host::MIN_IOR as f32;
const MAX_IOR: f32 = host::MAX_IOR as f32;
const MIN_CONTRAST: f32 = host::MIN_CONTRAST as f32;

/// Returns the derivative with respect to a clamped number: 0 outside [0, `most`].
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn clamped(g: f32, x: f32, most: f32) -> f32 {
    select(x < 0.0 || x > most, 0.0, g)
}

/// Clamps a roughness to [0, 1].
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn roughness_of(number: f32) -> f32 {
    min(max(number, 0.0), 1.0)
}

#[cfg_attr(feature = "gpu", cube)]
impl Shading {
    /// Raises the roughness of a glossy material to a least value r > 0. Phong's exponent falls to 2/r⁴ − 2, with which its
    /// lobe is as wide as that of facets with α = r² (Walter et al. 2007). Returns whether there was a change.
    #[inline(always)]
    pub fn roughen(&mut self, least: f32) -> bool {
        let own = self.exponent;
        self.exponent = max(own, least);
        if self.model == const { BsdfKind::Phong as u32 } {
            self.exponent = min(own, 2.0 / (least * least * least * least) - 2.0);
        }
        self.exponent != own
    }

    /// Returns whether the surface is glossy and its lobe is narrower than that of facets of a roughness r > 0.
    #[inline(always)]
    pub fn is_smoother_than(&self, r: f32) -> bool {
        let mut smoother = self.exponent < r;
        if self.model == const { BsdfKind::Phong as u32 } {
            smoother = self.exponent > 2.0 / (r * r * r * r) - 2.0;
        }
        self.glossy && smoother
    }

    /// Returns the clamped metallic parameter.
    #[inline(always)]
    pub(super) fn metallic(&self) -> f32 {
        min(max(self.specular.x, 0.0), 1.0)
    }

    /// Returns the clamped η of a conductor.
    #[inline(always)]
    pub(super) fn eta_of_metal(&self) -> V3 {
        self.diffuse.max(splat(0.0)).min(splat(MAX_METAL_IOR))
    }

    /// Returns the clamped k of a conductor.
    #[inline(always)]
    pub(super) fn extinction(&self) -> V3 {
        self.specular.max(splat(0.0)).min(splat(MAX_METAL_IOR))
    }

    /// Sets derivatives with respect to clamped parameters of a conductor or of metallic-roughness to 0.
    #[inline(always)]
    pub(super) fn clamp_backward(&self, gradient: &mut ShadingGradient) {
        let x = self.specular;
        let g = gradient.specular;
        if self.model == METALLIC {
            gradient.specular.x = clamped(g.x, x.x, 1.0);
        }
        if self.model == CONDUCTOR {
            gradient.specular = v3(
                clamped(g.x, x.x, MAX_METAL_IOR),
                clamped(g.y, x.y, MAX_METAL_IOR),
                clamped(g.z, x.z, MAX_METAL_IOR),
            );
            let x = self.diffuse;
            let g = gradient.diffuse;
            gradient.diffuse = v3(
                clamped(g.x, x.x, MAX_METAL_IOR),
                clamped(g.y, x.y, MAX_METAL_IOR),
                clamped(g.z, x.z, MAX_METAL_IOR),
            );
        }
    }

    /// Returns the clamped index of refraction of the inside over the outside.
    #[inline(always)]
    pub(super) fn ior(&self) -> f32 {
        let mut ior = min(max(self.specular.x, MIN_IOR), MAX_IOR);
        if (ior - 1.0).abs() < MIN_CONTRAST {
            ior = const { 1.0 + MIN_CONTRAST };
        }
        ior
    }

    /// Returns whether [`Shading::ior`] is the material's own value, not clamped.
    #[inline(always)]
    pub(super) fn has_own_ior(&self) -> bool {
        self.ior() == self.specular.x
    }
}
