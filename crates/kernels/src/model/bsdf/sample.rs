//! Sampling of directions from a BSDF, and derivatives of samples at fixed random numbers.

use super::scatter::{Scatter, Turning};
use super::{IMPOSSIBLE, Shading, ShadingGradient};
#[cfg(feature = "gpu")]
use super::{ShadingExpand, ShadingGradientExpand};
use crate::cube::*;
use crate::model::frame::{sin_cos_of_turns, to_local};
use crate::model::{V3, splat, v3};

#[cfg_attr(feature = "gpu", cube)]
impl Shading {
    /// Samples a lobe about in proportion to its albedo, and a direction from it.
    #[inline(always)]
    pub fn sample(&self, u: f32, v: f32, lobe: f32) -> Scatter {
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
        let mut drawn = Scatter {
            direction: splat(0.0),
            weight: splat(0.0),
            local: matt_local(height, v),
            of_gloss: false,
            u: height,
            v,
        };
        self.draw(&mut drawn, normal, lobe);
        if self.mirrored {
            let across = self.pair.first - self.pair.second;
            let per_square = 1.0 / across.dot(across);
            drawn.direction -= across * (2.0 * drawn.direction.dot(across) * per_square);
        }
        // On a flat surface without a specular lobe, f·cos θ over the density is k_d for all directions.
        if !self.glossy && !self.smooth && !self.paired {
            drawn.weight = self.diffuse;
        } else if !drawn.weight.is_zero() {
            drawn.weight = self.weight(drawn.direction);
        }
        drawn
    }

    /// Returns f·cos θ over the density of a direction.
    #[inline(always)]
    fn weight(&self, direction: V3) -> V3 {
        let density = self.density(direction);
        let mut weight = splat(0.0);
        if density > IMPOSSIBLE {
            weight = self.evaluate(direction) * (1.0 / density);
        }
        weight
    }

    /// Adds the derivatives of g·weight + by_direction·direction of a sampled direction. With respect to the parameters of
    /// the specular lobe, they are those of f·cos θ at a fixed direction and density (detached sampling: Zeltner et al.
    /// 2021, *Monte Carlo estimators for differential light transport*), so that no edge moves with these parameters. With
    /// respect to the normals and the view, they are mixed of both: the direction turns by `turning`. Those of the lobe's
    /// parameters are right only if `of_parameters`.
    #[inline(always)]
    pub fn sample_backward(
        &self,
        s: &Scatter,
        g: V3,
        by_direction: V3,
        turning: &Turning,
        of_parameters: bool,
        gradient: &mut ShadingGradient,
    ) {
        let mut own = ShadingGradient::default();
        self.turned(s, g, by_direction, turning, &mut own);
        let mut fixed = ShadingGradient::default();
        let of_parameters = of_parameters && !self.scatters_evenly();
        if (of_parameters || turning.part < 1.0) && !s.weight.is_zero() {
            let density = self.density(s.direction);
            if density > IMPOSSIBLE {
                self.evaluate_backward(s.direction, g * (1.0 / density), &mut fixed);
            }
        }
        gradient.add_turned(&own, &fixed, 1.0 - turning.part);
        gradient.specular += fixed.specular;
        gradient.exponent += fixed.exponent;
    }

    /// Adds the derivatives of g·weight + by_direction·direction of a direction that turns at fixed random numbers.
    #[inline(always)]
    fn turned(
        &self,
        s: &Scatter,
        g: V3,
        by_direction: V3,
        turning: &Turning,
        own: &mut ShadingGradient,
    ) {
        let mut by_drawn = by_direction * turning.part;
        by_drawn += self.weight_backward(s, g * turning.part, own);
        by_drawn += turning.by_direction * g.dot(s.weight);
        self.direction_backward(s, by_drawn, own);
    }

    /// Adds ∇·(F V₀) for a direction from any source, where F is the light g·f·cos θ that arrives along it and V₀ the velocity
    /// of directions that are sampled from one of the lobes. `by_direction` is the derivative of F with respect to the
    /// direction due to the light that arrives.
    #[inline(always)]
    pub fn turn_backward(
        &self,
        direction: V3,
        of_gloss: bool,
        g: V3,
        by_direction: V3,
        turning: &Turning,
        gradient: &mut ShadingGradient,
    ) {
        let share = self.share_of_lobe(direction, of_gloss);
        if share > 0.0 {
            let mut drawn = self.as_drawn(direction, of_gloss);
            drawn.weight = self.weight(direction);
            let mut own = ShadingGradient::default();
            let by_weight = g * (share * self.density(direction));
            self.turned(&drawn, by_weight, by_direction * share, turning, &mut own);
            let mut fixed = ShadingGradient::default();
            self.evaluate_backward(direction, g * share, &mut fixed);
            gradient.add_turned(&own, &fixed, -turning.part);
        }
    }

    /// Returns the sample of a lobe that has a given direction.
    #[inline(always)]
    pub fn as_drawn(&self, direction: V3, of_gloss: bool) -> Scatter {
        let mut drawn = Scatter {
            direction,
            weight: splat(0.0),
            local: to_local(self.normal, direction),
            of_gloss,
            u: 0.0,
            v: 0.0,
        };
        self.set_numbers(&mut drawn);
        drawn
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl ShadingGradient {
    /// Adds derivatives along a direction that turns, and those along a fixed one times a factor, with respect to what turns
    /// directions.
    #[inline(always)]
    fn add_turned(&mut self, turned: &ShadingGradient, fixed: &ShadingGradient, factor: f32) {
        self.geometric += turned.geometric + fixed.geometric * factor;
        self.normal += turned.normal + fixed.normal * factor;
        self.incoming += turned.incoming + fixed.incoming * factor;
        self.diffuse += turned.diffuse + fixed.diffuse * factor;
    }
}

/// Returns a cosine-distributed direction in the frame of a normal, for two uniform numbers.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn matt_local(u: f32, v: f32) -> V3 {
    let turn = sin_cos_of_turns(v);
    let sine = u.sqrt();
    v3(sine * turn.cos, sine * turn.sin, max(1.0 - u, 0.0).sqrt())
}
