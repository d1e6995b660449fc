//! Reflection by microfacets: conductors by Fresnel's equations, and glTF's metallic-roughness model with a diffuse
//! base below the facets.
//!
//! f·cos θ = D X + Y. X = R V cos θ belongs to the facets, with R their reflectance including compensation. Y belongs
//! to the diffuse base. Directions have the density D S + T. In this form the derivatives of a sample's weight
//! contain no difference of terms with the derivative of D, which is steep for smooth surfaces.

use std::f32::consts::FRAC_1_PI;

#[cfg(feature = "gpu")]
use super::ShadingExpand;
use super::albedo::{dielectric_facets, mean_of_dielectric_facets};
use super::facets::{Facets, FacetsGradient};
use super::fresnel::schlick;
use super::ranges::METALLIC;
use super::reflectance::DIELECTRIC_F0;
use super::{IMPOSSIBLE, Lobe, Scatter, Shading, ShadingGradient};
use crate::cube::*;
use crate::model::frame::{from_local, from_local_backward};
use crate::model::{V3, splat, v3};

/// Minimum probability of each of the two lobes if both exist.
const MIN_PROBABILITY: f32 = 0.05;

/// Derivatives of a loss with respect to the terms X, Y, D, S and T.
#[apply(record!)]
struct TermsGradient {
    x: V3,
    y: V3,
    d: f32,
    s: f32,
    t: f32,
}

/// Returns the reflectance of the metal along the normal, and for metallic-roughness the base color.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn albedo(shading: &Shading) -> V3 {
    let mut color = shading.diffuse;
    if shading.model != METALLIC {
        color = shading.fresnel(1.0);
    }
    color
}

/// Returns the probability of sampling the microfacet lobe, which is roughly its fraction of the reflected light.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn gloss(shading: &Shading) -> f32 {
    let mut share = 1.0f32;
    if shading.model == METALLIC {
        let metal = shading.metallic();
        let nv = shading.normal.dot(shading.incoming).abs();
        let f0 = splat(DIELECTRIC_F0 * (1.0 - metal)) + shading.diffuse * metal;
        let f = f0 + (splat(1.0) - f0) * schlick(nv);
        let reflected = f.abs().element_sum();
        let below = (1.0 - metal) * shading.diffuse.abs().element_sum();
        if below > 0.0 {
            share = (reflected / (reflected + below))
                .clamp(MIN_PROBABILITY, const { 1.0 - MIN_PROBABILITY });
        }
    }
    share
}

/// Returns f·cos θ of a conductor or of metallic-roughness.
#[cfg_attr(feature = "gpu", cube)]
#[inline(never)]
pub(super) fn evaluate(shading: &Shading, outgoing: V3) -> V3 {
    let cosine = shading.cosine(outgoing);
    let mut sum = splat(0.0);
    if cosine > 0.0 {
        let f = shading.facets_about(shading.normal);
        let nl = shading.normal.dot(outgoing);
        let half = f.view + outgoing;
        let reflected = f.distribution(half) * f.visibility(nl) * cosine;
        sum = shading.reflectance(&f, 0.5 * half.length()) * reflected;
        if shading.model == METALLIC {
            let below = (1.0 - shading.metallic()) * FRAC_1_PI * cosine;
            sum += shading.diffuse * (below * shading.through(&f, nl));
        }
    }
    sum
}

/// Adds the derivatives of g·f·cos θ, and returns the one with respect to the outgoing direction.
#[cfg_attr(feature = "gpu", cube)]
#[inline(never)]
pub(super) fn evaluate_backward(
    shading: &Shading,
    outgoing: V3,
    g: V3,
    gradient: &mut ShadingGradient,
) -> V3 {
    let cosine = shading.cosine(outgoing);
    let mut by_outgoing = splat(0.0);
    if cosine > 0.0 {
        let f = shading.facets_about(shading.normal);
        let half = f.view + outgoing;
        let facing = f.visibility(shading.normal.dot(outgoing)) * cosine;
        let x = shading.reflectance(&f, 0.5 * half.length()) * facing;
        let by = TermsGradient {
            x: g * f.distribution(half),
            y: g,
            d: g.dot(x),
            s: 0.0,
            t: 0.0,
        };
        by_outgoing = shading.terms_backward(&f, outgoing, &by, gradient);
    }
    by_outgoing
}

/// Returns the densities, about a normal, of the microfacet lobe and of the diffuse base, each times its probability.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn densities(shading: &Shading, normal: V3, outgoing: V3) -> V3 {
    let gloss = gloss(shading);
    let f = shading.facets_about(normal);
    let facets = 0.25 * f.visible(f.view + outgoing);
    let below = max(normal.dot(outgoing), 0.0) * FRAC_1_PI;
    v3(gloss * facets, (1.0 - gloss) * below, 0.0)
}

/// Samples a microfacet that reflects, or a cosine-distributed direction about a normal.
#[cfg_attr(feature = "gpu", cube)]
#[inline(never)]
pub(super) fn draw(shading: &Shading, drawn: &mut Scatter, normal: V3, lobe: f32) {
    let f = shading.facets_about(normal);
    drawn.of_gloss = lobe < gloss(shading);
    if drawn.of_gloss {
        drawn.direction = f.reflected(f.draw(drawn.u, drawn.v));
    } else {
        drawn.direction = from_local(normal, drawn.local);
    }
    drawn.weight = splat(1.0);
}

/// Adds the derivatives of g·weight of a sampled direction, and returns the one with respect to the direction.
#[cfg_attr(feature = "gpu", cube)]
#[inline(never)]
pub(super) fn weight_backward(
    shading: &Shading,
    drawn: &Scatter,
    g: V3,
    gradient: &mut ShadingGradient,
) -> V3 {
    let outgoing = drawn.direction;
    let mut by_outgoing = splat(0.0);
    let cosine = shading.cosine(outgoing);
    let density = densities(shading, shading.normal, outgoing).element_sum();
    if cosine > 0.0 && density > IMPOSSIBLE {
        let f = shading.facets_about(shading.normal);
        let nl = shading.normal.dot(outgoing);
        let half = f.view + outgoing;
        let d = f.distribution(half);
        let x = shading.reflectance(&f, 0.5 * half.length()) * (f.visibility(nl) * cosine);
        let mut y = splat(0.0);
        if shading.model == METALLIC {
            let below = (1.0 - shading.metallic()) * FRAC_1_PI * cosine;
            y = shading.diffuse * (below * shading.through(&f, nl));
        }
        let gloss = gloss(shading);
        let of_facets = 0.5 * gloss / (f.nv + f.rv);
        let of_below = (1.0 - gloss) * nl * FRAC_1_PI;
        let inverse = 1.0 / density;
        let by_density = -g.dot(drawn.weight) * inverse;
        let by = TermsGradient {
            x: g * (d * inverse),
            y: g * inverse,
            d: g.dot(x * of_below - y * of_facets) * inverse * inverse,
            s: by_density * d,
            t: by_density,
        };
        by_outgoing = shading.terms_backward(&f, outgoing, &by, gradient);
    }
    by_outgoing
}

/// Sets the random numbers that would have sampled the facet that reflects the view into a direction.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn as_drawn(shading: &Shading, drawn: &mut Scatter) {
    if drawn.of_gloss {
        let f = shading.facets_about(shading.normal);
        let numbers = f.numbers_of(f.view + drawn.direction);
        drawn.u = numbers.x;
        drawn.v = numbers.y;
    }
}

/// Adds the derivatives of g·direction of a sampled direction, at fixed random numbers.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn direction_backward(
    shading: &Shading,
    drawn: &Scatter,
    g: V3,
    gradient: &mut ShadingGradient,
) {
    if drawn.of_gloss {
        shading.reflected_backward(drawn, g, gradient);
    } else {
        gradient.normal += from_local_backward(shading.normal, drawn.local, g).axis;
    }
}

/// Narrows a lobe to the directions that microfacets reflect to.
#[cfg_attr(feature = "gpu", cube)]
#[inline(never)]
pub(super) fn lobe(shading: &Shading, lobe: &mut Lobe, of_gloss: bool, tangent: f32) {
    if of_gloss {
        let f = shading.facets_about(shading.normal);
        lobe.take_facets(f.reflected(shading.normal), 2.0, f.alpha, tangent);
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Shading {
    /// Adds the derivatives of the terms, and returns the one with respect to the outgoing direction, which is above
    /// the surface.
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
        by_half += half * (0.5 * by_vh / max(length, IMPOSSIBLE));
        // S and T.
        let gloss = gloss(self);
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
}
