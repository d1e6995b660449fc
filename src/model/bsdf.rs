//! Lambert plus normalised Phong: f = k_d/π + k_s (n + 2)/(2π) cosⁿα, on both sides of a surface.
//!
//! cos θ is that to the shading normal, but where a direction comes close to the geometric horizon, at
//! most four times the cosine to the geometric normal: so what is reflected vanishes at the horizon, where
//! the surface begins to hide the light, and does not jump.

use std::f32::consts::{FRAC_1_PI, TAU};

use super::frame::{from_local, from_local_backward, sin_cos_of_turns, to_local};
use super::{Pair, V3, splat, v3};
use crate::scene::{CHANNELS, Channel, MaterialKind};
#[cfg(feature = "wgpu")]
use burn::cubecl::{self, prelude::*};

#[cfg(test)]
mod tests;

/// A shaded point: directions, and what its material is there.
#[cfg_attr(
    feature = "wgpu",
    derive(CubeType, CubeTypeMut),
    expand(derive(Clone, Copy))
)]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Shading {
    /// Unit normals on the side that the ray came from.
    pub geometric: V3,
    pub normal: V3,
    /// The ray's direction.
    pub incoming: V3,
    /// k_d.
    pub diffuse: V3,
    /// k_s and n, where the material is glossy.
    pub specular: V3,
    pub exponent: f32,
    pub glossy: bool,
    /// Whether the two normals are not the same.
    pub smooth: bool,
    /// Two normals, about one of which directions are drawn in place of its own: those of both faces of a
    /// crease, so that a path on either side goes the same way and their difference is as small as the
    /// crease is flat.
    pub pair: Pair,
    pub paired: bool,
}

/// Derivatives by what a shaded point is made of.
#[cfg_attr(
    feature = "wgpu",
    derive(CubeType, CubeTypeMut),
    expand(derive(Clone, Copy))
)]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ShadingGradient {
    pub geometric: V3,
    pub normal: V3,
    pub incoming: V3,
    pub diffuse: V3,
    pub specular: V3,
    pub exponent: f32,
}

impl ShadingGradient {
    /// The derivatives by a material's parameters, in the order of [`Channel::ALL`].
    #[inline(always)]
    pub fn channels(&self) -> [V3; CHANNELS] {
        let mut by = [V3::ZERO; CHANNELS];
        by[Channel::Diffuse as usize] = self.diffuse;
        by[Channel::Specular as usize] = self.specular;
        by[Channel::Shininess as usize] = v3(self.exponent, 0.0, 0.0);
        by
    }
}

/// A direction drawn from the BSDF.
#[cfg_attr(
    feature = "wgpu",
    derive(CubeType, CubeTypeMut),
    expand(derive(Clone, Copy))
)]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Scatter {
    pub direction: V3,
    /// f·cos θ over the density of the direction.
    pub weight: V3,
    /// The direction in the frame of the lobe's axis: the normal, or the mirror direction.
    pub local: V3,
    /// Whether the specular lobe was drawn.
    pub of_gloss: bool,
    pub u: f32,
    pub v: f32,
}

/// Directions drawn by a number nearer to 0 or 1 have derivatives without bound.
const LEAST: f32 = 1e-7;
/// The cosine to the shading normal counts up to so many times that to the geometric one.
pub(crate) const HORIZON: f32 = 4.0;
/// Densities under this can't have been drawn.
const IMPOSSIBLE: f32 = 1e-20;

impl Shading {
    /// The shading of a material with these parameters at the point.
    #[inline(always)]
    pub fn of(values: [V3; CHANNELS], kind: MaterialKind) -> Self {
        Self {
            diffuse: values[Channel::Diffuse as usize],
            specular: values[Channel::Specular as usize],
            exponent: values[Channel::Shininess as usize].x,
            glossy: kind.glossy,
            ..Self::default()
        }
    }
}

#[cfg_attr(feature = "wgpu", cube)]
impl Shading {
    /// The mirror direction.
    #[inline(always)]
    pub fn mirror(&self) -> V3 {
        self.mirror_about(self.normal)
    }

    #[inline(always)]
    fn mirror_about(&self, normal: V3) -> V3 {
        self.incoming - normal * (2.0 * normal.dot(self.incoming))
    }

    #[inline(always)]
    pub fn mirror_backward(&self, g: V3, gradient: &mut ShadingGradient) {
        let along = self.normal.dot(g);
        gradient.incoming += g - self.normal * (2.0 * along);
        gradient.normal -=
            g * (2.0 * self.normal.dot(self.incoming)) + self.incoming * (2.0 * along);
    }

    /// The probability of the specular lobe: its share of the albedo.
    #[inline(always)]
    pub fn gloss(&self) -> f32 {
        let mut share = 0.0;
        if self.glossy {
            let specular = self.specular.element_sum().abs();
            share = specular / (self.diffuse.element_sum().abs() + specular).max(IMPOSSIBLE);
        }
        share
    }

    /// cos θ, 0 below the surface.
    #[inline(always)]
    fn cosine(&self, outgoing: V3) -> f32 {
        let shaded = self.normal.dot(outgoing);
        shaded.min(HORIZON * self.geometric.dot(outgoing)).max(0.0)
    }

    /// Adds the derivatives of g·cos θ where it is not 0; returns that by the outgoing direction.
    #[inline(always)]
    fn cosine_backward(&self, outgoing: V3, g: f32, gradient: &mut ShadingGradient) -> V3 {
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

    /// f·cos θ of the matt lobe.
    #[inline(always)]
    pub fn matt(&self, outgoing: V3) -> V3 {
        self.diffuse * (FRAC_1_PI * self.cosine(outgoing))
    }

    /// f·cos θ of the glossy lobe.
    #[inline(always)]
    pub fn specular(&self, outgoing: V3) -> V3 {
        let lobe = phong(self.exponent, self.mirror().dot(outgoing));
        self.specular * (lobe * (self.exponent + 2.0) / TAU * self.cosine(outgoing))
    }

    /// f·cos θ.
    #[inline(always)]
    pub fn evaluate(&self, outgoing: V3) -> V3 {
        let mut f = self.matt(outgoing);
        if self.glossy {
            f += self.specular(outgoing);
        }
        f
    }

    /// Adds the derivatives of g·f·cos θ; returns that by the outgoing direction.
    #[inline(always)]
    pub fn evaluate_backward(&self, outgoing: V3, g: V3, gradient: &mut ShadingGradient) -> V3 {
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

    /// The density per solid angle with which [`Shading::sample`] draws a direction.
    #[inline(always)]
    pub fn density(&self, outgoing: V3) -> f32 {
        if self.paired {
            0.5 * self.density_about(self.pair.first, outgoing)
                + 0.5 * self.density_about(self.pair.second, outgoing)
        } else {
            self.density_about(self.normal, outgoing)
        }
    }

    #[inline(always)]
    fn density_about(&self, normal: V3, outgoing: V3) -> f32 {
        let mut density = normal.dot(outgoing).max(0.0) * FRAC_1_PI;
        if self.glossy {
            let gloss = self.gloss();
            let lobe = phong(self.exponent, self.mirror_about(normal).dot(outgoing));
            density = density * (1.0 - gloss) + lobe * (self.exponent + 1.0) / TAU * gloss;
        }
        density
    }

    /// The share of a lobe in the density of a direction.
    #[inline(always)]
    pub fn share_of_lobe(&self, outgoing: V3, of_gloss: bool) -> f32 {
        let gloss = self.gloss();
        let lobe = phong(self.exponent, self.mirror().dot(outgoing));
        let specular = lobe * (self.exponent + 1.0) / TAU * gloss;
        let matt = self.normal.dot(outgoing).max(0.0) * FRAC_1_PI * (1.0 - gloss);
        let mut own = matt;
        if of_gloss {
            own = specular;
        }
        own / (specular + matt).max(IMPOSSIBLE)
    }

    /// Draws a lobe in proportion to its albedo, and a direction from it.
    #[inline(always)]
    pub fn sample(&self, u: f32, v: f32, lobe: f32) -> Scatter {
        let turn = sin_cos_of_turns(v);
        let of_gloss = self.glossy && lobe < self.gloss();
        let mut height = u;
        let mut normal = self.normal;
        if self.paired {
            normal = self.pair.first;
            height = 2.0 * u;
            if u >= 0.5 {
                normal = self.pair.second;
                height -= 1.0;
            }
        }
        let mut axis = normal;
        let mut sine = height.sqrt();
        let mut cosine = (1.0 - height).max(0.0).sqrt();
        if of_gloss {
            axis = self.mirror_about(normal);
            let log = height.clamp(LEAST, 1.0 - LEAST).ln() / (self.exponent + 1.0);
            cosine = log.exp();
            sine = (-(2.0 * log).exp_m1()).max(LEAST).sqrt();
        }
        let local = v3(sine * turn.cos, sine * turn.sin, cosine);
        let direction = from_local(axis, local);
        // Without gloss, on a flat surface, f·cos θ over the density is k_d, whatever the direction.
        let mut weight = self.diffuse;
        if self.glossy || self.smooth || self.paired {
            let density = self.density(direction);
            weight = splat(0.0);
            if density > IMPOSSIBLE {
                weight = self.evaluate(direction) * (1.0 / density);
            }
        }
        Scatter {
            direction,
            weight,
            local,
            of_gloss,
            u: height,
            v,
        }
    }

    /// Adds the derivatives of g·weight + by_direction·direction.
    #[inline(always)]
    pub fn sample_backward(
        &self,
        s: &Scatter,
        g: V3,
        by_direction: V3,
        gradient: &mut ShadingGradient,
    ) {
        let direction = s.direction;
        let mut by_drawn = by_direction;
        if !self.glossy && !self.smooth {
            gradient.diffuse += g;
        } else {
            let density = self.density(direction);
            if density > IMPOSSIBLE {
                by_drawn += self.evaluate_backward(direction, g * (1.0 / density), gradient);
                let by_density = -g.dot(s.weight) / density;
                let gloss = self.gloss();
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
        self.direction_backward(s, by_drawn, gradient);
    }

    /// A direction as if it had been drawn from a lobe.
    #[inline(always)]
    pub fn as_drawn(&self, direction: V3, of_gloss: bool) -> Scatter {
        let mut axis = self.normal;
        let mut height = 0.0f32;
        if of_gloss {
            axis = self.mirror();
        }
        let local = to_local(axis, direction);
        let mut turn = 0.0f32;
        if of_gloss {
            height = phong(self.exponent + 1.0, local.z);
            turn = local.y.atan2(local.x) / TAU;
            turn -= turn.floor();
        }
        Scatter {
            direction,
            weight: splat(0.0),
            local,
            of_gloss,
            u: height,
            v: turn,
        }
    }

    /// Adds the derivatives of g·direction of a direction that was drawn, at fixed random numbers.
    #[inline(always)]
    pub fn direction_backward(&self, s: &Scatter, g: V3, gradient: &mut ShadingGradient) {
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
