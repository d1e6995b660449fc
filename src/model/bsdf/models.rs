//! The models of BSDFs, by number, and which of them a shading may be of.

use crate::cube::*;
use crate::scene::Bsdf;

/// Models of [`Shading::model`](super::Shading::model).
pub(super) const PHONG: u32 = 0;
pub(super) const METALLIC: u32 = 1;
pub(super) const CONDUCTOR: u32 = 2;
pub(super) const DIELECTRIC: u32 = 3;

/// The number of a BSDF.
#[inline(always)]
pub(crate) fn model_of(bsdf: Bsdf) -> u32 {
    match bsdf {
        Bsdf::Phong => PHONG,
        Bsdf::MetallicRoughness => METALLIC,
        Bsdf::Conductor => CONDUCTOR,
        Bsdf::Dielectric => DIELECTRIC,
    }
}

/// The models that a shading may be of. Kernels on GPUs know them when they are compiled, so that they need not hold
/// what a scene does not have.
#[derive(Clone, Copy, Debug, Hash, PartialEq, Eq)]
pub(crate) struct Models {
    pub phong: bool,
    /// [`METALLIC`] and [`CONDUCTOR`].
    pub metal: bool,
    pub dielectric: bool,
}

impl Default for Models {
    fn default() -> Self {
        Self::of(Bsdf::Phong)
    }
}

impl Models {
    pub const MATT: Self = Self {
        phong: true,
        metal: false,
        dielectric: false,
    };

    #[inline(always)]
    pub fn of(bsdf: Bsdf) -> Self {
        Self {
            phong: bsdf == Bsdf::Phong,
            metal: matches!(bsdf, Bsdf::MetallicRoughness | Bsdf::Conductor),
            dielectric: bsdf == Bsdf::Dielectric,
        }
    }

    /// Whether any is of facets.
    #[inline(always)]
    pub fn facets(self) -> bool {
        self.metal || self.dielectric
    }

    pub fn or(self, other: Self) -> Self {
        Self {
            phong: self.phong || other.phong,
            metal: self.metal || other.metal,
            dielectric: self.dielectric || other.dielectric,
        }
    }
}

known_to_kernels!(Models);
