//! Lambert plus normalised Phong: f = k_d/π + k_s (n + 2)/(2π) cosⁿα, on both sides of a surface.

use std::f32::consts::{FRAC_1_PI, TAU};

#[cfg(feature = "wgpu")]
use super::ShadingExpand;
use super::{IMPOSSIBLE, LEAST, Scatter, Shading, ShadingGradient};
#[cfg(feature = "wgpu")]
use crate::cube::*;
use crate::model::frame::{from_local_backward, sin_cos_of_turns};
use crate::model::{V3, splat, v3};

#[cfg_attr(feature = "wgpu", cube)]
impl Shading {
    /// The probability of the specular lobe: its share of the albedo.
    #[inline(always)]
    pub(super) fn phong_gloss(&self) -> f32 {
        let mut share = 0.0;
        if self.glossy {
            let specular = self.specular.element_sum().abs();
            share = specular / (self.diffuse.element_sum().abs() + specular).max(IMPOSSIBLE);
        }
        share
    }

    /// f·cos θ of the matt lobe.
    #[inline(always)]
    fn matt(&self, outgoing: V3) -> V3 {
        self.diffuse * (FRAC_1_PI * self.cosine(outgoing))
    }

    /// f·cos θ of the glossy lobe.
    #[inline(always)]
    fn specular(&self, outgoing: V3) -> V3 {
        let lobe = phong(self.exponent, self.mirror().dot(outgoing));
        self.specular * (lobe * (self.exponent + 2.0) / TAU * self.cosine(outgoing))
    }

    /// f·cos θ.
    #[inline(always)]
    pub(super) fn phong(&self, outgoing: V3) -> V3 {
        let mut f = self.matt(outgoing);
        if self.glossy {
            f += self.specular(outgoing);
        }
        f
    }

    /// Adds the derivatives of g·f·cos θ; returns that by the outgoing direction.
    #[inline(always)]
    pub(super) fn phong_backward(&self, outgoing: V3, g: V3, gradient: &mut ShadingGradient) -> V3 {
        let cosine = self.cosine(outgoing);
        let mut by_outgoing = splat(0.0);
        if cosine > 0.0 {
            gradient.diffuse += g * (cosine * FRAC_1_PI);
            let mut by_cosine = g.dot(self.diffuse) * FRAC_1_PI;
            if self.glossy {
                let lobe = phong(self.exponent, self.mirror().dot(outgoing));
                let norm = (self.exponent + 2.0) / TAU;
                let along = g.dot(self.specular);
                gradient.specular += g * (lobe * norm * cosine);
                gradient.exponent += along * lobe * cosine / TAU;
                by_cosine += along * lobe * norm;
                by_outgoing += self.lobe_backward(outgoing, lobe, along * norm * cosine, gradient);
            }
            by_outgoing += self.cosine_backward(outgoing, by_cosine, gradient);
        }
        by_outgoing
    }

    /// Derivatives of g·cosⁿα; returns that by the outgoing direction.
    #[inline(always)]
    fn lobe_backward(&self, outgoing: V3, lobe: f32, g: f32, gradient: &mut ShadingGradient) -> V3 {
        let mirror = self.mirror();
        let c = mirror.dot(outgoing);
        let mut by_outgoing = splat(0.0);
        if c > LEAST && c <= 1.0 {
            gradient.exponent += g * lobe * c.ln();
            let by_c = g * lobe * self.exponent / c;
            self.mirror_backward(outgoing * by_c, gradient);
            by_outgoing = mirror * by_c;
        }
        by_outgoing
    }

    #[inline(always)]
    pub(super) fn phong_density(&self, normal: V3, outgoing: V3) -> f32 {
        let mut density = normal.dot(outgoing).max(0.0) * FRAC_1_PI;
        if self.glossy {
            let gloss = self.phong_gloss();
            let lobe = phong(self.exponent, self.mirror_about(normal).dot(outgoing));
            density = density * (1.0 - gloss) + lobe * (self.exponent + 1.0) / TAU * gloss;
        }
        density
    }

    /// The density of directions of the specular lobe, and of the matt one: each times its probability.
    #[inline(always)]
    pub(super) fn phong_densities(&self, outgoing: V3) -> V3 {
        let gloss = self.phong_gloss();
        let lobe = phong(self.exponent, self.mirror().dot(outgoing));
        let matt = self.normal.dot(outgoing).max(0.0) * FRAC_1_PI * (1.0 - gloss);
        v3(lobe * (self.exponent + 1.0) / TAU * gloss, matt, 0.0)
    }

    /// A direction of the specular lobe about the mirror direction.
    #[inline(always)]
    pub(super) fn phong_local(&self, u: f32, v: f32) -> V3 {
        let turn = sin_cos_of_turns(v);
        let log = u.clamp(LEAST, 1.0 - LEAST).ln() / (self.exponent + 1.0);
        let sine = (-(2.0 * log).exp_m1()).max(LEAST).sqrt();
        v3(sine * turn.cos, sine * turn.sin, log.exp())
    }

    /// Adds the derivatives of g·weight of a direction that was drawn; returns that by the direction.
    #[inline(always)]
    pub(super) fn phong_weight_backward(
        &self,
        s: &Scatter,
        g: V3,
        gradient: &mut ShadingGradient,
    ) -> V3 {
        let direction = s.direction;
        let mut by_drawn = splat(0.0);
        if !self.glossy && !self.smooth {
            gradient.diffuse += g;
        } else {
            let density = self.phong_density(self.normal, direction);
            if density > IMPOSSIBLE {
                by_drawn += self.phong_backward(direction, g * (1.0 / density), gradient);
                let by_density = -g.dot(s.weight) / density;
                let gloss = self.phong_gloss();
                if self.normal.dot(direction) > 0.0 {
                    let by_cosine = by_density * (1.0 - gloss) * FRAC_1_PI;
                    gradient.normal += direction * by_cosine;
                    by_drawn += self.normal * by_cosine;
                }
                let lobe = phong(self.exponent, self.mirror().dot(direction));
                gradient.exponent += by_density * lobe * gloss / TAU;
                let by_lobe = by_density * (self.exponent + 1.0) / TAU * gloss;
                by_drawn += self.lobe_backward(direction, lobe, by_lobe, gradient);
            }
        }
        by_drawn
    }

    /// The numbers that a direction of the specular lobe would have been drawn by.
    #[inline(always)]
    pub(super) fn phong_numbers(&self, local: V3) -> V3 {
        let mut turn = local.y.atan2(local.x) / TAU;
        turn -= turn.floor();
        v3(phong(self.exponent + 1.0, local.z), turn, 0.0)
    }

    /// Adds the derivatives of g·direction of a direction that was drawn, at fixed random numbers.
    #[inline(always)]
    pub(super) fn phong_direction_backward(
        &self,
        s: &Scatter,
        g: V3,
        gradient: &mut ShadingGradient,
    ) {
        if s.of_gloss {
            let by = from_local_backward(self.mirror(), s.local, g);
            self.mirror_backward(by.axis, gradient);
            let turn = sin_cos_of_turns(s.v);
            let log = s.u.clamp(LEAST, 1.0 - LEAST).ln() / (self.exponent + 1.0);
            let square = (2.0 * log).exp();
            let mut by_log = by.local.z * log.exp();
            let rest = -(2.0 * log).exp_m1();
            if rest > LEAST {
                let by_sine = by.local.x * turn.cos + by.local.y * turn.sin;
                by_log -= by_sine * square / rest.sqrt();
            }
            gradient.exponent -= by_log * log / (self.exponent + 1.0);
        } else {
            gradient.normal += from_local_backward(self.normal, s.local, g).axis;
        }
    }
}

/// cosⁿα, 0 for α over 90°.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
fn phong(exponent: f32, cosine: f32) -> f32 {
    let mut lobe = 0.0;
    if cosine > LEAST {
        lobe = (cosine.min(1.0).ln() * exponent).exp();
    }
    lobe
}
