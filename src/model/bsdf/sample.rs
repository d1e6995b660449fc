//! Sampling of directions from a BSDF, and derivatives of samples at fixed random numbers.

#[cfg(feature = "gpu")]
use super::ShadingExpand;
use super::scatter::{Scatter, Turning};
use super::{IMPOSSIBLE, Shading, ShadingGradient};
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
        let part = turning.part;
        let mut own = ShadingGradient::default();
        let mut by_drawn = by_direction * part + self.weight_backward(s, g * part, &mut own);
        by_drawn += turning.by_direction * g.dot(s.weight);
        self.direction_backward(s, by_drawn, &mut own);
        let mut fixed = ShadingGradient::default();
        let of_parameters = of_parameters && !self.scatters_evenly();
        if (of_parameters || part < 1.0) && !s.weight.is_zero() {
            let density = self.density(s.direction);
            if density > IMPOSSIBLE {
                self.evaluate_backward(s.direction, g * (1.0 / density), &mut fixed);
            }
        }
        let held = 1.0 - part;
        gradient.geometric += own.geometric + fixed.geometric * held;
        gradient.normal += own.normal + fixed.normal * held;
        gradient.incoming += own.incoming + fixed.incoming * held;
        gradient.diffuse += own.diffuse + fixed.diffuse * held;
        gradient.specular += fixed.specular;
        gradient.exponent += fixed.exponent;
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

/// Returns a cosine-distributed direction in the frame of a normal, for two uniform numbers.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn matt_local(u: f32, v: f32) -> V3 {
    let turn = sin_cos_of_turns(v);
    let sine = u.sqrt();
    v3(sine * turn.cos, sine * turn.sin, max(1.0 - u, 0.0).sqrt())
}
