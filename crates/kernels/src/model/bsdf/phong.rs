//! Lambert plus normalized Phong: f = k_d/π + k_s (n + 2)/(2π) cosⁿα, on both sides of a surface.

use std::f32::consts::{FRAC_1_PI, TAU};

#[cfg(feature = "gpu")]
use super::ShadingExpand;
use super::{EPSILON, IMPOSSIBLE, Lobe, Scatter, Shading, ShadingGradient};
use crate::cube::*;
use crate::model::frame::{
    arc_tangent_of, from_local, from_local_backward, sin_cos_of_turns, to_local,
};
use crate::model::{V3, splat, v3};

/// Returns the sum of both lobes' albedos.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn albedo(shading: &Shading) -> V3 {
    shading.diffuse + shading.specular
}

/// Returns the fraction of the albedo that is due to the specular lobe.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn gloss(shading: &Shading) -> f32 {
    let mut share = 0.0;
    if shading.glossy {
        let specular = shading.specular.element_sum().abs();
        share = specular / max(shading.diffuse.element_sum().abs() + specular, IMPOSSIBLE);
    }
    share
}

/// Returns f·cos θ.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn evaluate(shading: &Shading, outgoing: V3) -> V3 {
    let mut f = shading.matt(outgoing);
    if shading.glossy {
        f += shading.specular(outgoing);
    }
    f
}

/// Adds the derivatives of g·f·cos θ, and returns the one with respect to the outgoing direction.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn evaluate_backward(
    shading: &Shading,
    outgoing: V3,
    g: V3,
    gradient: &mut ShadingGradient,
) -> V3 {
    let cosine = shading.cosine(outgoing);
    let mut by_outgoing = splat(0.0);
    if cosine > 0.0 {
        gradient.diffuse += g * (cosine * FRAC_1_PI);
        let mut by_cosine = g.dot(shading.diffuse) * FRAC_1_PI;
        if shading.glossy {
            let lobe = phong(shading.exponent, shading.mirror().dot(outgoing));
            let norm = (shading.exponent + 2.0) / TAU;
            let along = g.dot(shading.specular);
            gradient.specular += g * (lobe * norm * cosine);
            gradient.exponent += along * lobe * cosine / TAU;
            by_cosine += along * lobe * norm;
            by_outgoing += shading.lobe_backward(outgoing, lobe, along * norm * cosine, gradient);
        }
        by_outgoing += shading.cosine_backward(outgoing, by_cosine, gradient);
    }
    by_outgoing
}

/// Returns the densities of the lobe about the mirror direction and of the cosine lobe, each times its probability.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn densities(shading: &Shading, normal: V3, outgoing: V3) -> V3 {
    let mut found = v3(0.0, max(normal.dot(outgoing), 0.0) * FRAC_1_PI, 0.0);
    if shading.glossy {
        let share = gloss(shading);
        let lobe = phong(shading.exponent, shading.mirror_about(normal).dot(outgoing));
        found.x = lobe * (shading.exponent + 1.0) / TAU * share;
        found.y *= 1.0 - share;
    }
    found
}

/// Samples the cosine lobe about a normal, or the lobe about the mirror direction.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn draw(shading: &Shading, drawn: &mut Scatter, normal: V3, lobe: f32) {
    drawn.of_gloss = shading.glossy && lobe < gloss(shading);
    let mut axis = normal;
    if drawn.of_gloss {
        axis = shading.mirror_about(normal);
        drawn.local = shading.phong_local(drawn.u, drawn.v);
    }
    drawn.direction = from_local(axis, drawn.local);
    drawn.weight = splat(1.0);
}

/// Adds the derivatives of g·weight of a sampled direction, and returns the one with respect to the direction.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn weight_backward(
    shading: &Shading,
    drawn: &Scatter,
    g: V3,
    gradient: &mut ShadingGradient,
) -> V3 {
    let direction = drawn.direction;
    let mut by_drawn = splat(0.0);
    if !shading.glossy && !shading.smooth {
        gradient.diffuse += g;
    } else {
        let densities = densities(shading, shading.normal, direction);
        let density = densities.x + densities.y;
        if density > IMPOSSIBLE {
            by_drawn += evaluate_backward(shading, direction, g * (1.0 / density), gradient);
            let by_density = -g.dot(drawn.weight) / density;
            let share = gloss(shading);
            if shading.normal.dot(direction) > 0.0 {
                let by_cosine = by_density * (1.0 - share) * FRAC_1_PI;
                gradient.normal += direction * by_cosine;
                by_drawn += shading.normal * by_cosine;
            }
            let lobe = phong(shading.exponent, shading.mirror().dot(direction));
            gradient.exponent += by_density * lobe * share / TAU;
            let by_lobe = by_density * (shading.exponent + 1.0) / TAU * share;
            by_drawn += shading.lobe_backward(direction, lobe, by_lobe, gradient);
        }
    }
    by_drawn
}

/// Sets the random numbers that would have sampled a direction of the specular lobe.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn as_drawn(shading: &Shading, drawn: &mut Scatter) {
    if drawn.of_gloss {
        let local = to_local(shading.mirror(), drawn.direction);
        let turn = arc_tangent_of(local.y, local.x) / TAU;
        drawn.local = local;
        drawn.u = phong(shading.exponent + 1.0, local.z);
        drawn.v = turn - turn.floor();
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
        let by = from_local_backward(shading.mirror(), drawn.local, g);
        shading.mirror_backward(by.axis, gradient);
    } else {
        gradient.normal += from_local_backward(shading.normal, drawn.local, g).axis;
    }
}

/// Narrows a lobe to the cone about the mirror direction outside of which the specular lobe is nearly 0.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn lobe(shading: &Shading, lobe: &mut Lobe, of_gloss: bool, tangent: f32) {
    if of_gloss {
        lobe.axis = shading.mirror();
        lobe.exponent = shading.exponent;
        // The lobe has fallen to 1e-4 there.
        let exponent = max(shading.exponent, 1e-3);
        lobe.narrow((const { -9.2f32 } / exponent).exp(), tangent);
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Shading {
    /// Returns f·cos θ of the diffuse lobe.
    #[inline(always)]
    fn matt(&self, outgoing: V3) -> V3 {
        self.diffuse * (FRAC_1_PI * self.cosine(outgoing))
    }

    /// Returns f·cos θ of the specular lobe.
    #[inline(always)]
    fn specular(&self, outgoing: V3) -> V3 {
        let lobe = phong(self.exponent, self.mirror().dot(outgoing));
        self.specular * (lobe * (self.exponent + 2.0) / TAU * self.cosine(outgoing))
    }

    /// Adds the derivatives of g·cosⁿα, and returns the one with respect to the outgoing direction.
    #[inline(always)]
    fn lobe_backward(&self, outgoing: V3, lobe: f32, g: f32, gradient: &mut ShadingGradient) -> V3 {
        let mirror = self.mirror();
        let c = mirror.dot(outgoing);
        let mut by_outgoing = splat(0.0);
        if c > EPSILON && c <= 1.0 {
            gradient.exponent += g * lobe * c.ln();
            let by_c = g * lobe * self.exponent / c;
            self.mirror_backward(outgoing * by_c, gradient);
            by_outgoing = mirror * by_c;
        }
        by_outgoing
    }

    /// Returns a direction of the specular lobe in the frame of the mirror direction.
    #[inline(always)]
    fn phong_local(&self, u: f32, v: f32) -> V3 {
        let turn = sin_cos_of_turns(v);
        let log = u.clamp(EPSILON, 1.0 - EPSILON).ln() / (self.exponent + 1.0);
        let sine = max(-(2.0 * log).exp_m1(), EPSILON).sqrt();
        v3(sine * turn.cos, sine * turn.sin, log.exp())
    }
}

/// Returns cosⁿα, or 0 for α over 90°.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn phong(exponent: f32, cosine: f32) -> f32 {
    let lobe = (min(max(cosine, EPSILON), 1.0).ln() * exponent).exp();
    select(cosine > EPSILON, lobe, 0.0)
}
