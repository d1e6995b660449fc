//! BSDFs of surfaces, one file per model (`models`), on both sides of a surface.
//!
//! cos θ is the cosine to the shading normal, but at most four times the cosine to the geometric normal. So near the
//! geometric horizon, where the surface begins to occlude the light, the reflected light goes to 0 and does not jump.

#![allow(unused_assignments)] // Kernel variables need an initial value.

mod albedo;
mod dielectric;
mod facets;
mod fresnel;
mod glass_albedo;
mod lobe;
mod metal;
mod models;
mod phong;
mod ranges;
mod reflectance;
mod refraction;
mod sample;
mod scatter;
#[cfg(test)]
mod tests;

use super::{Pair, V3, splat};
use crate::cube::*;
use crate::host::BsdfKind;

pub use albedo::{Fit, dielectric_facets, lost, mean_of_dielectric_facets};
pub use glass_albedo::given_back;
pub use lobe::Lobe;
use models::models;
pub use reflectance::DIELECTRIC_F0;
pub use refraction::UPRIGHT;
pub use scatter::{Scatter, Turning};

models! {
    phong: Phong;
    metal: MetallicRoughness | Conductor;
    dielectric: Dielectric;
}

/// A shading point: its directions, and the material parameters there.
#[apply(zeroed!)]
pub struct Shading {
    /// Unit normals on the side that the ray came from: the geometric and the shading normal.
    pub geometric: V3,
    pub normal: V3,
    /// Direction of the incoming ray.
    pub incoming: V3,
    /// Material parameter by model: k_d, base color or η.
    pub diffuse: V3,
    /// k_s of a glossy Phong material; k of a conductor; or, in the first component, metallic or the index of
    /// refraction.
    pub specular: V3,
    /// The Phong exponent n of a glossy material, or the roughness.
    pub exponent: f32,
    pub glossy: bool,
    /// Whether the two normals may differ.
    pub smooth: bool,
    /// The integer value of its [`BsdfKind`].
    pub model: u32,
    /// Whether multiple-scattering compensation is enabled: light lost between microfacets is added back.
    pub compensated: bool,
    /// Whether the ray came from behind the front side, which is the inside of a dielectric.
    pub inside: bool,
    #[cfg_attr(feature = "gpu", cube(comptime))]
    pub models: Models,
    /// Two normals, about one of which directions are sampled instead of the shading normal: the normals of both
    /// faces of a crease of a matt surface. Paths on either side then go the same way, and their difference is as small
    /// as the crease is flat.
    pub pair: Pair,
    pub paired: bool,
    /// Whether the sampled direction is mirrored in the plane between the two normals. The sum over a direction and
    /// its mirror image leaves no difference where light is the same from all directions.
    pub mirrored: bool,
}

impl Shading {
    /// Returns whether the material is purely diffuse and `pair` is not used: sampling then takes the same steps for
    /// every direction.
    #[inline(always)]
    pub fn is_matt(&self) -> bool {
        self.scatters_evenly() && !self.paired && !self.mirrored
    }

    /// Returns it with the fields that are known for a purely diffuse material.
    #[inline(always)]
    pub fn as_matt(mut self) -> Self {
        self.model = BsdfKind::Phong as u32;
        self.models = Models::MATT;
        (self.glossy, self.paired, self.mirrored) = (false, false, false);
        self
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Shading {
    /// Returns whether the diffuse lobe is the only one, so that directions about two normals may be mirrored.
    #[inline(always)]
    pub fn scatters_evenly(&self) -> bool {
        self.model == BsdfKind::Phong as u32 && !self.glossy
    }
}

/// Normals whose squared difference is at most this are equal up to rounding.
const ALIKE: f32 = 1e-6;

/// Returns whether two normals differ, so that there is a plane between them to mirror directions in.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn normals_differ(pair: &Pair) -> bool {
    let across = pair.first - pair.second;
    across.dot(across) > ALIKE
}

/// Derivatives with respect to the fields of [`Shading`].
#[apply(zeroed!)]
pub struct ShadingGradient {
    pub geometric: V3,
    pub normal: V3,
    pub incoming: V3,
    pub diffuse: V3,
    pub specular: V3,
    pub exponent: f32,
}

/// Random numbers are kept this far from 0 and 1, where derivatives of sampled directions are unbounded.
const EPSILON: f32 = 1e-7;
/// The cosine to the shading normal is at most this multiple of the cosine to the geometric normal.
pub const HORIZON: f32 = 4.0;
/// Directions with a smaller density cannot have been sampled.
const IMPOSSIBLE: f32 = 1e-20;

#[cfg_attr(feature = "gpu", cube)]
impl Shading {
    /// Returns the mirror direction about the shading normal.
    #[inline(always)]
    pub fn mirror(&self) -> V3 {
        self.mirror_about(self.normal)
    }

    #[inline(always)]
    pub(super) fn mirror_about(&self, normal: V3) -> V3 {
        self.incoming - normal * (2.0 * normal.dot(self.incoming))
    }

    #[inline(always)]
    pub fn mirror_backward(&self, g: V3, gradient: &mut ShadingGradient) {
        let along = self.normal.dot(g);
        gradient.incoming += g - self.normal * (2.0 * along);
        gradient.normal -=
            g * (2.0 * self.normal.dot(self.incoming)) + self.incoming * (2.0 * along);
    }

    /// Returns cos θ, limited near the geometric horizon and 0 below the surface.
    #[inline(always)]
    pub(super) fn cosine(&self, outgoing: V3) -> f32 {
        let shaded = self.normal.dot(outgoing);
        max(min(shaded, HORIZON * self.geometric.dot(outgoing)), 0.0)
    }

    /// Adds the derivatives of g·cos θ where it is not 0, and returns the one with respect to the outgoing direction.
    #[inline(always)]
    pub(super) fn cosine_backward(
        &self,
        outgoing: V3,
        g: f32,
        gradient: &mut ShadingGradient,
    ) -> V3 {
        let horizon = HORIZON * self.geometric.dot(outgoing);
        let mut by_outgoing = self.normal * g;
        if self.normal.dot(outgoing) <= horizon {
            gradient.normal += outgoing * g;
        } else {
            gradient.geometric += outgoing * (HORIZON * g);
            by_outgoing = self.geometric * (HORIZON * g);
        }
        by_outgoing
    }

    /// Returns the solid-angle density with which [`Shading::sample`] samples a direction.
    #[inline(always)]
    pub fn density(&self, outgoing: V3) -> f32 {
        let mut normal = self.normal;
        let mut share = 1.0f32;
        let mut left = 1u32;
        if self.paired {
            normal = self.pair.first;
            share = 0.5f32;
            left = 2u32;
        }
        // A loop, so that a kernel contains the called function only once.
        let mut density = 0.0f32;
        while left > 0 {
            let densities = self.densities(normal, outgoing);
            density += share * (densities.x + densities.y);
            normal = self.pair.second;
            left -= 1;
        }
        density
    }

    /// Returns the fraction of a direction's density that is due to one lobe.
    #[inline(always)]
    pub fn share_of_lobe(&self, outgoing: V3, of_gloss: bool) -> f32 {
        let densities = self.densities(self.normal, outgoing);
        let mut own = densities.y;
        if of_gloss {
            own = densities.x;
        }
        own / max(densities.x + densities.y, IMPOSSIBLE)
    }
}
