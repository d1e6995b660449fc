//! How surfaces scatter light, a file a model ([`models`]), on both sides of a surface.
//!
//! cos θ is that to the shading normal, but where a direction comes close to the geometric horizon, at
//! most four times the cosine to the geometric normal: so what is reflected vanishes at the horizon, where
//! the surface begins to hide the light, and does not jump.

#![allow(unused_assignments)] // Variables of a kernel need a first value.

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
#[cfg(test)]
mod tests;

use super::{Pair, V3, splat};
use crate::cube::*;
use crate::scene::Bsdf;

pub(crate) use albedo::{Fit, dielectric_facets, lost, mean_of_dielectric_facets};
pub(crate) use glass_albedo::given_back;
pub(crate) use lobe::Lobe;
use models::models;
pub(crate) use reflectance::DIELECTRIC_F0;
pub(crate) use refraction::UPRIGHT;
pub(crate) use sample::Scatter;

models! {
    phong: Phong;
    metal: MetallicRoughness | Conductor;
    dielectric: Dielectric;
}

/// A shaded point: directions, and what its material is there.
#[apply(zeroed!)]
pub(crate) struct Shading {
    /// Unit normals on the side that the ray came from.
    pub geometric: V3,
    pub normal: V3,
    /// The ray's direction.
    pub incoming: V3,
    /// The parameters of the material, by its model: k_d, base colour or η.
    pub diffuse: V3,
    /// k_s, where the material is glossy; k; metallic or the index of refraction, the first number.
    pub specular: V3,
    /// n, where the material is glossy, or the roughness.
    pub exponent: f32,
    pub glossy: bool,
    /// Whether the two normals are not the same.
    pub smooth: bool,
    /// The number of its [`Bsdf`].
    pub model: u32,
    /// Whether light that facets lose is given back.
    pub compensated: bool,
    /// Whether the ray came from behind the front, which is inside of a dielectric.
    pub inside: bool,
    #[cfg_attr(feature = "wgpu", cube(comptime))]
    pub models: Models,
    /// Two normals, about one of which directions are drawn in place of its own: those of both faces of a
    /// crease, so that a path on either side goes the same way and their difference is as small as the
    /// crease is flat.
    pub pair: Pair,
    pub paired: bool,
    /// Whether the direction is mirrored in the plane between both: with the light along it and its mirror image
    /// together, none of the difference is left where light is the same from all directions.
    pub mirrored: bool,
}

impl Shading {
    /// Whether it is matt alone: what it scatters then takes the same steps for every direction.
    #[inline(always)]
    pub fn is_matt(&self) -> bool {
        self.scatters_evenly() && !self.paired
    }

    /// It as one that is known to be matt.
    #[inline(always)]
    pub fn as_matt(mut self) -> Self {
        self.model = Bsdf::Phong as u32;
        self.models = Models::MATT;
        (self.glossy, self.paired) = (false, false);
        self
    }
}

#[cfg_attr(feature = "wgpu", cube)]
impl Shading {
    /// Whether it has no lobe but the matt one, so that directions about two normals may be mirrored.
    #[inline(always)]
    pub fn scatters_evenly(&self) -> bool {
        self.model == Bsdf::Phong as u32 && !self.glossy
    }
}

/// Derivatives by what a shaded point is made of.
#[apply(zeroed!)]
pub(crate) struct ShadingGradient {
    pub geometric: V3,
    pub normal: V3,
    pub incoming: V3,
    pub diffuse: V3,
    pub specular: V3,
    pub exponent: f32,
}

/// Directions drawn by a number nearer to 0 or 1 have derivatives without bound.
const LEAST: f32 = 1e-7;
/// The cosine to the shading normal counts up to so many times that to the geometric one.
pub(crate) const HORIZON: f32 = 4.0;
/// Densities under this can't have been drawn.
const IMPOSSIBLE: f32 = 1e-20;

#[cfg_attr(feature = "wgpu", cube)]
impl Shading {
    /// The mirror direction.
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

    /// cos θ, 0 below the surface.
    #[inline(always)]
    pub(super) fn cosine(&self, outgoing: V3) -> f32 {
        let shaded = self.normal.dot(outgoing);
        shaded.min(HORIZON * self.geometric.dot(outgoing)).max(0.0)
    }

    /// Adds the derivatives of g·cos θ where it is not 0; returns that by the outgoing direction.
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

    /// The density per solid angle with which [`Shading::sample`] draws a direction.
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
        // A kernel has one place for each function that is called.
        let mut density = 0.0f32;
        while left > 0 {
            let densities = self.densities(normal, outgoing);
            density += share * (densities.x + densities.y);
            normal = self.pair.second;
            left -= 1;
        }
        density
    }

    /// The share of a lobe in the density of a direction.
    #[inline(always)]
    pub fn share_of_lobe(&self, outgoing: V3, of_gloss: bool) -> f32 {
        let densities = self.densities(self.normal, outgoing);
        let mut own = densities.y;
        if of_gloss {
            own = densities.x;
        }
        own / (densities.x + densities.y).max(IMPOSSIBLE)
    }
}
