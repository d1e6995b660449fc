//! Directions drawn from a BSDF, and their derivatives at fixed random numbers.

#[cfg(feature = "wgpu")]
use super::ShadingExpand;
use super::{DIELECTRIC, IMPOSSIBLE, Shading, ShadingGradient};
use crate::cube::*;
use crate::model::frame::{from_local, from_local_backward, sin_cos_of_turns, to_local};
use crate::model::{V3, splat, v3};

/// A direction drawn from the BSDF.
#[apply(zeroed!)]
pub(crate) struct Scatter {
    pub direction: V3,
    /// f·cos θ over the density of the direction.
    pub weight: V3,
    /// The direction in the frame of the lobe's axis: the normal, or the mirror direction.
    pub local: V3,
    /// Whether the specular lobe was drawn; of a dielectric that of reflected light.
    pub of_gloss: bool,
    pub u: f32,
    pub v: f32,
}

#[cfg_attr(feature = "wgpu", cube)]
impl Shading {
    /// Draws a lobe in proportion to its albedo, and a direction from it.
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
        if self.is_phong() {
            if comptime!(self.models.phong) {
                drawn = self.sample_phong(&drawn, normal, lobe);
            }
        } else if comptime!(self.models.facets()) {
            drawn = self.sample_facets(&drawn, normal, lobe);
        }
        drawn
    }

    #[inline(always)]
    fn sample_phong(&self, numbers: &Scatter, normal: V3, lobe: f32) -> Scatter {
        let of_gloss = self.glossy && lobe < self.phong_gloss();
        let mut axis = normal;
        let mut local = numbers.local;
        if of_gloss {
            axis = self.mirror_about(normal);
            local = self.phong_local(numbers.u, numbers.v);
        }
        let direction = from_local(axis, local);
        // Without gloss, on a flat surface, f·cos θ over the density is k_d, whatever the direction.
        let mut weight = self.diffuse;
        if self.glossy || self.smooth || self.paired {
            weight = self.weight(direction);
        }
        Scatter {
            direction,
            weight,
            local,
            of_gloss,
            u: numbers.u,
            v: numbers.v,
        }
    }

    /// f·cos θ over the density of a direction.
    #[inline(always)]
    fn weight(&self, direction: V3) -> V3 {
        let density = self.density(direction);
        let mut weight = splat(0.0);
        if density > IMPOSSIBLE {
            weight = self.evaluate(direction) * (1.0 / density);
        }
        weight
    }

    #[inline(never)]
    fn sample_facets(&self, numbers: &Scatter, normal: V3, lobe: f32) -> Scatter {
        let f = self.facets_about(normal);
        let half = f.draw(numbers.u, numbers.v);
        let mut is_interface = false;
        let mut chance = 0.0f32;
        if comptime!(self.models.dielectric) {
            is_interface = self.model == DIELECTRIC;
            if is_interface {
                chance = self.part_reflected(&f, half);
            }
        }
        if comptime!(self.models.metal) {
            if !is_interface {
                chance = self.metal_gloss();
            }
        }
        let of_gloss = lobe < chance;
        let mut direction = from_local(normal, numbers.local);
        if of_gloss {
            direction = self.reflected_at(&f, half);
        } else if comptime!(self.models.dielectric) {
            if is_interface {
                direction = self.refracted_at(&f, half);
            }
        }
        // What a slanted facet turns to the wrong side is lost.
        let mut kept = normal.dot(direction) > 0.0;
        if !of_gloss {
            kept = !kept;
        }
        let mut weight = splat(0.0);
        if !is_interface || kept {
            weight = self.weight(direction);
        }
        Scatter {
            direction,
            weight,
            local: numbers.local,
            of_gloss,
            u: numbers.u,
            v: numbers.v,
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
        let mut by_drawn = by_direction;
        if comptime!(self.models.phong) {
            if self.is_phong() {
                by_drawn += self.phong_weight_backward(s, g, gradient);
            }
        }
        if comptime!(self.models.metal) {
            if self.is_metal() {
                by_drawn += self.metal_weight_backward(s, g, gradient);
            }
        }
        if comptime!(self.models.dielectric) {
            if self.model == DIELECTRIC {
                by_drawn += self.interface_weight_backward(s, g, gradient);
            }
        }
        self.direction_backward(s, by_drawn, gradient);
    }

    /// A direction as if it had been drawn from a lobe.
    #[inline(always)]
    pub fn as_drawn(&self, direction: V3, of_gloss: bool) -> Scatter {
        let mut local = to_local(self.normal, direction);
        let mut numbers = splat(0.0);
        if self.is_phong() {
            if comptime!(self.models.phong) {
                if of_gloss {
                    local = to_local(self.mirror(), direction);
                    numbers = self.phong_numbers(local);
                }
            }
        } else if comptime!(self.models.facets()) {
            if of_gloss || self.model == DIELECTRIC {
                let f = self.facets_about(self.normal);
                numbers = f.numbers_of(self.half_of(&f, direction, of_gloss));
            }
        }
        Scatter {
            direction,
            weight: splat(0.0),
            local,
            of_gloss,
            u: numbers.x,
            v: numbers.y,
        }
    }

    /// Adds the derivatives of g·direction of a direction that was drawn, at fixed random numbers.
    #[inline(always)]
    pub fn direction_backward(&self, s: &Scatter, g: V3, gradient: &mut ShadingGradient) {
        if self.is_phong() {
            if comptime!(self.models.phong) {
                self.phong_direction_backward(s, g, gradient);
            }
        } else if comptime!(self.models.facets()) {
            self.facets_direction_backward(s, g, gradient);
        }
    }

    #[inline(always)]
    fn facets_direction_backward(&self, s: &Scatter, g: V3, gradient: &mut ShadingGradient) {
        if s.of_gloss {
            self.reflected_backward(s, g, gradient);
        } else {
            if comptime!(self.models.dielectric) {
                if self.model == DIELECTRIC {
                    self.refracted_backward(s, g, gradient);
                }
            }
            if comptime!(self.models.metal) {
                if self.is_metal() {
                    gradient.normal += from_local_backward(self.normal, s.local, g).axis;
                }
            }
        }
    }
}

/// A direction about a normal with a density in proportion to the cosine, for two uniform numbers.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
fn matt_local(u: f32, v: f32) -> V3 {
    let turn = sin_cos_of_turns(v);
    let sine = u.sqrt();
    v3(sine * turn.cos, sine * turn.sin, (1.0 - u).max(0.0).sqrt())
}
