//! Reflectance of the microfacets of conductors and metallic-roughness, and transmission to and from the base below
//! them.

#[cfg(feature = "gpu")]
use super::ShadingExpand;
use super::albedo::{Fit, dielectric_facets, lost, mean_of_dielectric_facets};
use super::facets::{Facets, FacetsGradient};
use super::fresnel::{conductor, conductor_slopes, schlick, schlick_slope};
use super::ranges::CONDUCTOR;
use super::{Shading, ShadingGradient};
#[cfg(feature = "gpu")]
use crate::cube::*;
use crate::model::{V3, splat, v3};

/// Reflectance of a non-metal along the normal.
pub const DIELECTRIC_F0: f32 = 0.04;
/// 1 − F₀ of a non-metal.
const REST: f32 = 1.0 - DIELECTRIC_F0;
#[cfg_attr(feature = "gpu", cube)]
impl Shading {
    /// Returns the Fresnel reflectance of a conductor for the cosine to the facet normal.
    #[inline(always)]
    pub(super) fn fresnel(&self, cosine: f32) -> V3 {
        let eta = self.eta_of_metal();
        let k = self.extinction();
        v3(
            conductor(cosine, eta.x, k.x),
            conductor(cosine, eta.y, k.y),
            conductor(cosine, eta.z, k.z),
        )
    }

    /// Adds the derivatives of g·F of a conductor, and returns the one with respect to the cosine.
    #[inline(always)]
    fn fresnel_backward(&self, cosine: f32, g: V3, gradient: &mut ShadingGradient) -> f32 {
        let eta = self.eta_of_metal();
        let k = self.extinction();
        let red = conductor_slopes(cosine, eta.x, k.x);
        let green = conductor_slopes(cosine, eta.y, k.y);
        let blue = conductor_slopes(cosine, eta.z, k.z);
        gradient.diffuse += v3(red.y * g.x, green.y * g.y, blue.y * g.z);
        gradient.specular += v3(red.z * g.x, green.z * g.y, blue.z * g.z);
        red.x * g.x + green.x * g.y + blue.x * g.z
    }

    /// Returns the light lost by facets with F₀ = 1 relative to the light they reflect, or 0 without compensation.
    #[inline(always)]
    fn given_back(&self, f: &Facets) -> Fit {
        let mut found = Fit {
            value: 0.0f32,
            by_cosine: 0.0f32,
            by_alpha: 0.0f32,
            by_eta: 0.0f32,
        };
        if self.compensated {
            found = lost(f.nv, f.alpha);
        }
        found
    }

    /// Returns the reflectance of the facets including compensation. For metallic-roughness it is the sum of the
    /// metal's and the non-metal's, each weighted by its fraction.
    #[inline(always)]
    pub(super) fn reflectance(&self, f: &Facets, cosine: f32) -> V3 {
        let lost = self.given_back(f).value;
        let mut r = splat(0.0);
        if self.model == CONDUCTOR {
            r = self.fresnel(cosine);
            if self.compensated {
                r = r.times(splat(1.0) + self.fresnel(1.0) * lost);
            }
        } else {
            let metal = self.metallic();
            let base = self.diffuse;
            let white = schlick(cosine);
            let rest = DIELECTRIC_F0 + REST * white;
            let of_metal = base + (splat(1.0) - base) * white;
            r = splat((1.0 - metal) * rest * (1.0 + DIELECTRIC_F0 * lost))
                + of_metal.times(splat(1.0) + base * lost) * metal;
        }
        r
    }

    /// Adds the derivatives of g·R, and returns the one with respect to the cosine.
    #[inline(always)]
    pub(super) fn reflectance_backward(
        &self,
        f: &Facets,
        cosine: f32,
        g: V3,
        by: &mut FacetsGradient,
        gradient: &mut ShadingGradient,
    ) -> f32 {
        let lost = self.given_back(f);
        let mut by_lost = 0.0f32;
        let mut by_cosine = 0.0f32;
        if self.model == CONDUCTOR {
            let mut by_fresnel = g;
            if self.compensated {
                let f0 = self.fresnel(1.0);
                by_fresnel = g.times(splat(1.0) + f0 * lost.value);
                let by_f0 = g.times(self.fresnel(cosine));
                by_lost = by_f0.dot(f0);
                self.fresnel_backward(1.0, by_f0 * lost.value, gradient);
            }
            by_cosine = self.fresnel_backward(cosine, by_fresnel, gradient);
        } else {
            let metal = self.metallic();
            let base = self.diffuse;
            let white = schlick(cosine);
            let rest = DIELECTRIC_F0 + REST * white;
            let of_metal = base + (splat(1.0) - base) * white;
            let more_of_rest = 1.0 + DIELECTRIC_F0 * lost.value;
            let more = splat(1.0) + base * lost.value;
            let all = g.element_sum();
            gradient.diffuse += g.times(more * (1.0 - white) + of_metal * lost.value) * metal;
            gradient.specular.x += g.dot(of_metal.times(more)) - all * rest * more_of_rest;
            by_lost =
                all * (1.0 - metal) * rest * DIELECTRIC_F0 + metal * g.dot(of_metal.times(base));
            let by_white = all * (1.0 - metal) * REST * more_of_rest
                + metal * g.dot((splat(1.0) - base).times(more));
            by_cosine = by_white * schlick_slope(cosine);
        }
        f.nv_backward(by_lost * lost.by_cosine, by);
        by.alpha += by_lost * lost.by_alpha;
        by_cosine
    }

    /// Returns the fraction of light that is transmitted by the facets of a non-metal, scattered by the base and
    /// transmitted again, for the view and a light direction.
    #[inline(always)]
    pub(super) fn through(&self, f: &Facets, nl: f32) -> f32 {
        let seen = 1.0 - dielectric_facets(f.nv, f.alpha).value;
        let lit = 1.0 - dielectric_facets(nl, f.alpha).value;
        seen * lit / (1.0 - mean_of_dielectric_facets(f.alpha).x)
    }
}
