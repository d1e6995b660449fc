//! The ranges of the parameters of facets. A value outside of its range, which a fit may step to, counts as the nearest
//! one in it, so that nothing depends on it there: its derivative is 0, as that of a clamp is.

#[cfg(feature = "wgpu")]
use super::ShadingExpand;
use super::{Shading, ShadingGradient};
use crate::cube::*;
use crate::model::{V3, splat, v3};
use crate::scene::{self, Bsdf};

pub(super) const METALLIC: u32 = Bsdf::MetallicRoughness as u32;
pub(super) const CONDUCTOR: u32 = Bsdf::Conductor as u32;

const MOST_OF_METAL: f32 = scene::MOST_OF_METAL as f32;
const LEAST_IOR: f32 = scene::LEAST_IOR as f32;
const MOST_IOR: f32 = scene::MOST_IOR as f32;
const LEAST_CONTRAST: f32 = scene::LEAST_CONTRAST as f32;

/// A derivative by a number that is clamped.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
fn clamped(g: f32, x: f32, most: f32) -> f32 {
    select(x < 0.0 || x > most, 0.0, g)
}

/// A roughness in [0, 1].
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(super) fn roughness_of(number: f32) -> f32 {
    number.max(0.0).min(1.0)
}

#[cfg_attr(feature = "wgpu", cube)]
impl Shading {
    /// The share of metal.
    #[inline(always)]
    pub(super) fn metallic(&self) -> f32 {
        self.specular.x.max(0.0).min(1.0)
    }

    /// η of a conductor.
    #[inline(always)]
    pub(super) fn eta_of_metal(&self) -> V3 {
        self.diffuse.max(splat(0.0)).min(splat(MOST_OF_METAL))
    }

    /// k of a conductor.
    #[inline(always)]
    pub(super) fn extinction(&self) -> V3 {
        self.specular.max(splat(0.0)).min(splat(MOST_OF_METAL))
    }

    /// Drops derivatives by what is clamped of a conductor or of metallic–roughness.
    #[inline(always)]
    pub(super) fn clamp_backward(&self, gradient: &mut ShadingGradient) {
        let x = self.specular;
        let g = gradient.specular;
        if self.model == METALLIC {
            gradient.specular.x = clamped(g.x, x.x, 1.0);
        }
        if self.model == CONDUCTOR {
            gradient.specular = v3(
                clamped(g.x, x.x, MOST_OF_METAL),
                clamped(g.y, x.y, MOST_OF_METAL),
                clamped(g.z, x.z, MOST_OF_METAL),
            );
            let x = self.diffuse;
            let g = gradient.diffuse;
            gradient.diffuse = v3(
                clamped(g.x, x.x, MOST_OF_METAL),
                clamped(g.y, x.y, MOST_OF_METAL),
                clamped(g.z, x.z, MOST_OF_METAL),
            );
        }
    }

    /// The index of refraction of the inside over that of the outside.
    #[inline(always)]
    pub(super) fn ior(&self) -> f32 {
        let mut ior = self.specular.x.max(LEAST_IOR).min(MOST_IOR);
        if (ior - 1.0).abs() < LEAST_CONTRAST {
            ior = const { 1.0 + LEAST_CONTRAST };
        }
        ior
    }

    /// Whether it is that of the material.
    #[inline(always)]
    pub(super) fn has_own_ior(&self) -> bool {
        self.ior() == self.specular.x
    }
}
