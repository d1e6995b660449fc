//! Half vectors of facets that reflect or refract at a dielectric interface, and the directions that they turn the
//! view into.

#[cfg(feature = "gpu")]
use super::ShadingExpand;
use super::facets::{Facets, FacetsGradient};
use super::fresnel::dielectric;
use super::scatter::{Scatter, Turning};
use super::{IMPOSSIBLE, Shading, ShadingGradient, is};
use crate::cube::*;
use crate::model::{V3, select_vector, splat};

/// The refraction factor for facets with n·h near 0 is min(1, this times n·h).
pub const UPRIGHT: f32 = 64.0;

/// The sine of the angle between a refracted direction and its facet's plane below which the direction is held in part.
const HELD_BELOW: f32 = 0.3;

/// The facet that turns the view into a direction, above or below the surface.
#[apply(record!)]
pub(super) struct Turn {
    /// Whether light is reflected, so that the direction is above the surface.
    pub above: bool,
    /// H, its length, and the sign in H = ± (v + η l).
    pub half: V3,
    pub length: f32,
    pub sign: f32,
    /// v·H and −l·H, neither of which is negative where a facet refracts, and v·h.
    pub a: f32,
    pub b: f32,
    pub cosine: f32,
    /// The fraction of light that goes this way, and its derivatives with respect to the cosine and η.
    pub part: V3,
    pub k: f32,
    /// The factor of K for facets with n·h near 0.
    pub upright: f32,
}

#[cfg_attr(feature = "gpu", cube)]
impl Shading {
    /// Returns the index of refraction on the other side over the index on the view's side.
    #[inline(always)]
    pub(super) fn eta(&self) -> f32 {
        let eta = self.ior();
        select(self.inside, 1.0 / eta, eta)
    }

    /// Returns the rate at which a refracted direction turns with its facet, at normal incidence.
    #[inline(always)]
    pub(super) fn bending(&self) -> f32 {
        (1.0 - 1.0 / self.eta()).abs()
    }

    #[inline(always)]
    pub(super) fn eta_backward(&self, g: f32, gradient: &mut ShadingGradient) {
        let mut by = g;
        if self.inside {
            let eta = self.eta();
            by = -g * eta * eta;
        }
        if self.has_own_ior() {
            gradient.specular.x += by;
        }
    }

    /// Returns the facet that turns the view into a direction.
    #[inline(always)]
    pub(super) fn turn(&self, f: &Facets, outgoing: V3) -> Turn {
        let above = f.normal.dot(outgoing) > 0.0;
        let eta = self.eta();
        let mut half = f.view + outgoing;
        let mut sign = 1.0f32;
        if !above {
            half = f.view + outgoing * eta;
            if half.dot(f.normal) < 0.0 {
                sign = -1.0f32;
                half = -half;
            }
        }
        let length = max(half.length(), IMPOSSIBLE);
        let a = max(f.view.dot(half), 0.0);
        let b = max(-outgoing.dot(half), 0.0);
        let cosine = min(a / length, 1.0);
        let mut part = dielectric(cosine, eta);
        let mut k = 1.0f32;
        let mut upright = 1.0f32;
        if !above {
            upright = min(UPRIGHT * half.dot(f.normal) / length, 1.0);
            part = splat(0.0) - part;
            part.x += 1.0;
            let square = 1.0 / (length * length);
            k = 4.0 * a * b * square * square;
        }
        Turn {
            above,
            half,
            length,
            sign,
            a,
            b,
            cosine,
            part,
            k,
            upright,
        }
    }

    /// Returns the fraction of light that a facet with a half vector reflects.
    #[inline(always)]
    pub(super) fn part_reflected(&self, f: &Facets, half: V3) -> f32 {
        dielectric(f.view.dot(half).clamp(0.0, 1.0), self.eta()).x
    }

    /// Returns the direction into which a facet with a half vector refracts the view.
    #[inline(always)]
    pub(super) fn refracted_at(&self, f: &Facets, half: V3) -> V3 {
        let eta = self.eta();
        let c = f.view.dot(half);
        let passed = max(1.0 - (1.0 - c * c) / (eta * eta), IMPOSSIBLE).sqrt();
        half * (c / eta - passed) - f.view * (1.0 / eta)
    }

    /// Adds the derivatives of g·direction of a direction that a facet refracted, at fixed random numbers.
    #[inline(never)]
    pub(super) fn refracted_backward(
        &self,
        drawn: &Scatter,
        g: V3,
        gradient: &mut ShadingGradient,
    ) {
        let f = self.facets_about(self.normal);
        let half = f.draw(drawn.u, drawn.v);
        let eta = self.eta();
        let inverse = 1.0 / eta;
        let c = f.view.dot(half);
        let square = (1.0 - c * c) * inverse * inverse;
        let passed = max(1.0 - square, 1e-8).sqrt();
        let along = g.dot(half);
        let by_c = along * (inverse - c * inverse * inverse / passed);
        let mut by = FacetsGradient::zero();
        by.view = half * by_c - g * inverse;
        let by_half = g * (c * inverse - passed) + f.view * by_c;
        f.draw_backward(drawn.u, drawn.v, by_half, &mut by);
        self.add_facets(&f, &by, gradient);
    }

    /// Returns how much a sampled direction turns. A direction that is refracted along its facet is held: near the critical
    /// angle it turns infinitely fast, and so does the transmitted fraction change.
    #[inline(always)]
    pub fn turning(&self, direction: V3, of_gloss: bool) -> Turning {
        let mut found = Turning::freely();
        let refracts = !of_gloss && is::dielectric(self);
        if comptime!(self.models.dielectric) && refracts {
            let half = self.half_of(&self.facets_about(self.normal), direction, false);
            let per_length = 1.0 / max(half.length(), IMPOSSIBLE);
            let half = half * per_length;
            let sine = max(-direction.dot(half), 0.0) * (1.0 / HELD_BELOW);
            let square = sine * sine;
            if square < 1.0 {
                found.part = square * (2.0 - square);
                // The sine is −l·h, and h turns with l, since H = ± (v + η l).
                let by_sine = (1.0 - square) * sine * (4.0f32 / HELD_BELOW);
                let side = select(self.eta() < 1.0, 1.0f32, -1.0f32);
                let across = direction.reject_from_normalized(half);
                found.by_direction = (half + across * (side * self.eta() * per_length)) * -by_sine;
            }
        }
        found
    }

    /// Returns a vector along the half vector of the facet that turns the view into a direction; `of_gloss` is true
    /// if it reflects.
    #[inline(always)]
    pub(super) fn half_of(&self, f: &Facets, outgoing: V3, of_gloss: bool) -> V3 {
        let mut half = f.view + outgoing;
        if !of_gloss {
            half = f.view + outgoing * self.eta();
            half = select_vector(half.dot(f.normal) < 0.0, -half, half);
        }
        half
    }
}
