//! Facets that reflect: a metal by Fresnel's equations, and glTF's metallic–roughness with what lies below its facets.
//!
//! f·cos θ = D X + Y with X = R V cos θ of facets, R their reflectance with what is given back, and Y of what lies
//! below; directions have the density D S + T. So derivatives of a sample's weight hold no difference of terms with
//! the derivative of D, which is steep where facets are smooth.

use std::f32::consts::FRAC_1_PI;

#[cfg(feature = "wgpu")]
use super::ShadingExpand;
use super::albedo::{Fit, dielectric_facets, lost, mean_of_dielectric_facets};
use super::facets::{Facets, FacetsGradient};
use super::fresnel::{conductor, conductor_slopes, schlick, schlick_slope};
use super::{CONDUCTOR, IMPOSSIBLE, METALLIC, Scatter, Shading, ShadingGradient};
use crate::cube::*;
use crate::model::{V3, splat, v3};

/// The reflectance of what is no metal along the normal.
pub(crate) const DIELECTRIC_F0: f32 = 0.04;
/// What is left of all light.
const REST: f32 = 1.0 - DIELECTRIC_F0;
/// The least probability of each of two lobes that there are.
const LEAST_SHARE: f32 = 0.05;

/// Derivatives of a loss by the terms X, Y, D, S and T.
#[apply(record!)]
struct TermsGradient {
    x: V3,
    y: V3,
    d: f32,
    s: f32,
    t: f32,
}

#[cfg_attr(feature = "wgpu", cube)]
impl Shading {
    #[inline(always)]
    pub(super) fn facets_about(&self, normal: V3) -> Facets {
        Facets::new(normal, self.incoming, self.exponent)
    }

    /// Fresnel's reflectance of a conductor by the cosine to its facets' normal.
    #[inline(always)]
    fn fresnel(&self, cosine: f32) -> V3 {
        let eta = self.eta_of_metal();
        let k = self.extinction();
        v3(
            conductor(cosine, eta.x, k.x),
            conductor(cosine, eta.y, k.y),
            conductor(cosine, eta.z, k.z),
        )
    }

    /// Adds the derivatives of g·F of a conductor; returns that by the cosine.
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

    /// How much more than what facets of F₀ = 1 reflect they lose, where that is given back.
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

    /// What facets reflect, times what is given back of the light that they lose: of metallic–roughness that of
    /// metal and that of what is none, each by its share.
    #[inline(always)]
    fn reflectance(&self, f: &Facets, cosine: f32) -> V3 {
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

    /// Adds the derivatives of g·R; returns that by the cosine.
    #[inline(always)]
    fn reflectance_backward(
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

    /// The part of the light that comes through facets of what is no metal, is scattered below and comes out again:
    /// for its view and light.
    #[inline(always)]
    fn through(&self, f: &Facets, nl: f32) -> f32 {
        let seen = 1.0 - dielectric_facets(f.nv, f.alpha).value;
        let lit = 1.0 - dielectric_facets(nl, f.alpha).value;
        seen * lit / (1.0 - mean_of_dielectric_facets(f.alpha).x)
    }

    /// f·cos θ of metal and of metallic–roughness.
    #[inline(never)]
    pub(super) fn metal(&self, outgoing: V3) -> V3 {
        let cosine = self.cosine(outgoing);
        let mut sum = splat(0.0);
        if cosine > 0.0 {
            let f = self.facets_about(self.normal);
            let nl = self.normal.dot(outgoing);
            let half = f.view + outgoing;
            let reflected = f.distribution(half) * f.visibility(nl) * cosine;
            sum = self.reflectance(&f, 0.5 * half.length()) * reflected;
            if self.model == METALLIC {
                let below = (1.0 - self.metallic()) * FRAC_1_PI * cosine;
                sum += self.diffuse * (below * self.through(&f, nl));
            }
        }
        sum
    }

    /// Adds the derivatives of g·f·cos θ; returns that by the outgoing direction.
    #[inline(never)]
    pub(super) fn metal_backward(&self, outgoing: V3, g: V3, gradient: &mut ShadingGradient) -> V3 {
        let cosine = self.cosine(outgoing);
        let mut by_outgoing = splat(0.0);
        if cosine > 0.0 {
            let f = self.facets_about(self.normal);
            let half = f.view + outgoing;
            let facing = f.visibility(self.normal.dot(outgoing)) * cosine;
            let x = self.reflectance(&f, 0.5 * half.length()) * facing;
            let by = TermsGradient {
                x: g * f.distribution(half),
                y: g,
                d: g.dot(x),
                s: 0.0,
                t: 0.0,
            };
            by_outgoing = self.terms_backward(&f, outgoing, &by, gradient);
        }
        by_outgoing
    }

    /// Adds the derivatives of the terms; returns that by the outgoing direction, which is above the surface.
    #[inline(always)]
    fn terms_backward(
        &self,
        f: &Facets,
        outgoing: V3,
        g: &TermsGradient,
        gradient: &mut ShadingGradient,
    ) -> V3 {
        let mut by = FacetsGradient::zero();
        let nl = self.normal.dot(outgoing);
        let cosine = self.cosine(outgoing);
        let half = f.view + outgoing;
        let length = half.length();
        // X.
        let v = f.visibility(nl);
        let r = self.reflectance(f, 0.5 * length);
        let along = g.x.dot(r);
        let slopes = f.visibility_slopes(nl) * (along * cosine);
        let mut by_cosine = along * v;
        let by_vh =
            self.reflectance_backward(f, 0.5 * length, g.x * (v * cosine), &mut by, gradient);
        // D.
        let mut by_half = f.distribution_backward(half, g.d, &mut by);
        by_half += half * (0.5 * by_vh / length.max(IMPOSSIBLE));
        // S and T.
        let gloss = self.metal_gloss();
        let sum = f.nv + f.rv;
        let by_sum = f.slant_slopes() * (-0.5f32 * g.s * gloss / (sum * sum));
        let mut by_nv = slopes.x + by_sum.x;
        let mut by_nl = slopes.y + g.t * (1.0 - gloss) * FRAC_1_PI;
        by.alpha += slopes.z + by_sum.y;
        // Y.
        if self.model == METALLIC {
            let seen = dielectric_facets(f.nv, f.alpha);
            let lit = dielectric_facets(nl, f.alpha);
            let mean = mean_of_dielectric_facets(f.alpha);
            let rest = 1.0 / (1.0 - mean.x);
            let a = 1.0 - seen.value;
            let b = 1.0 - lit.value;
            let through = a * b * rest;
            let share = (1.0 - self.metallic()) * FRAC_1_PI;
            let along = g.y.dot(self.diffuse);
            gradient.diffuse += g.y * (share * cosine * through);
            gradient.specular.x -= along * FRAC_1_PI * cosine * through;
            by_cosine += along * share * through;
            let by_through = along * share * cosine * rest;
            by_nv -= by_through * b * seen.by_cosine;
            by_nl -= by_through * a * lit.by_cosine;
            by.alpha += by_through * (a * b * rest * mean.y - b * seen.by_alpha - a * lit.by_alpha);
        }
        self.clamp_backward(gradient);
        by.view += by_half;
        f.nv_backward(by_nv, &mut by);
        by.normal += outgoing * by_nl;
        let by_outgoing = by_half + self.normal * by_nl;
        self.add_facets(f, &by, gradient);
        by_outgoing + self.cosine_backward(outgoing, by_cosine, gradient)
    }

    /// Adds the derivatives by facets.
    #[inline(always)]
    pub(super) fn add_facets(
        &self,
        f: &Facets,
        by: &FacetsGradient,
        gradient: &mut ShadingGradient,
    ) {
        let found = f.backward(self.incoming, self.exponent, by);
        gradient.normal += found.normal;
        gradient.incoming += found.incoming;
        gradient.exponent += found.roughness;
    }

    /// The probability of a direction of facets, about their share of what is reflected.
    #[inline(always)]
    pub(super) fn metal_gloss(&self) -> f32 {
        let mut share = 1.0f32;
        if self.model == METALLIC {
            let metal = self.metallic();
            let nv = self.normal.dot(self.incoming).abs();
            let f0 = splat(DIELECTRIC_F0 * (1.0 - metal)) + self.diffuse * metal;
            let f = f0 + (splat(1.0) - f0) * schlick(nv);
            let reflected = f.abs().element_sum();
            let below = (1.0 - metal) * self.diffuse.abs().element_sum();
            if below > 0.0 {
                share = (reflected / (reflected + below))
                    .clamp(LEAST_SHARE, const { 1.0 - LEAST_SHARE });
            }
        }
        share
    }

    /// The density of directions of facets, and of those from below, about a normal: each times its probability.
    #[inline(always)]
    pub(super) fn metal_densities(&self, normal: V3, outgoing: V3) -> V3 {
        let gloss = self.metal_gloss();
        let f = self.facets_about(normal);
        let facets = 0.25 * f.visible(f.view + outgoing);
        let below = normal.dot(outgoing).max(0.0) * FRAC_1_PI;
        v3(gloss * facets, (1.0 - gloss) * below, 0.0)
    }

    /// The direction in which a facet with a half vector reflects the view.
    #[inline(always)]
    pub(super) fn reflected_at(&self, f: &Facets, half: V3) -> V3 {
        half * (2.0 * f.view.dot(half)) - f.view
    }

    /// Adds the derivatives of g·weight of a direction that was drawn; returns that by the direction.
    #[inline(never)]
    pub(super) fn metal_weight_backward(
        &self,
        s: &Scatter,
        g: V3,
        gradient: &mut ShadingGradient,
    ) -> V3 {
        let outgoing = s.direction;
        let mut by_outgoing = splat(0.0);
        let cosine = self.cosine(outgoing);
        let density = self.metal_densities(self.normal, outgoing).element_sum();
        if cosine > 0.0 && density > IMPOSSIBLE {
            let f = self.facets_about(self.normal);
            let nl = self.normal.dot(outgoing);
            let half = f.view + outgoing;
            let d = f.distribution(half);
            let x = self.reflectance(&f, 0.5 * half.length()) * (f.visibility(nl) * cosine);
            let mut y = splat(0.0);
            if self.model == METALLIC {
                let below = (1.0 - self.metallic()) * FRAC_1_PI * cosine;
                y = self.diffuse * (below * self.through(&f, nl));
            }
            let gloss = self.metal_gloss();
            let of_facets = 0.5 * gloss / (f.nv + f.rv);
            let of_below = (1.0 - gloss) * nl * FRAC_1_PI;
            let inverse = 1.0 / density;
            let by_density = -g.dot(s.weight) * inverse;
            let by = TermsGradient {
                x: g * (d * inverse),
                y: g * inverse,
                d: g.dot(x * of_below - y * of_facets) * inverse * inverse,
                s: by_density * d,
                t: by_density,
            };
            by_outgoing = self.terms_backward(&f, outgoing, &by, gradient);
        }
        by_outgoing
    }

    /// Adds the derivatives of g·direction of a direction that facets reflected, at fixed random numbers.
    #[inline(never)]
    pub(super) fn reflected_backward(&self, s: &Scatter, g: V3, gradient: &mut ShadingGradient) {
        let f = self.facets_about(self.normal);
        let half = f.draw(s.u, s.v);
        let mut by = FacetsGradient::zero();
        by.view = half * (2.0 * g.dot(half)) - g;
        let by_half = g * (2.0 * f.view.dot(half)) + f.view * (2.0 * g.dot(half));
        f.draw_backward(s.u, s.v, by_half, &mut by);
        self.add_facets(&f, &by, gradient);
    }
}
