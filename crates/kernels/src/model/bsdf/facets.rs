//! Microfacets with the GGX distribution (Walter et al. 2007) and height-correlated Smith masking-shadowing (Heitz
//! 2014). Half vectors of visible facets are sampled by spherical caps (Dupuy and Benyoub 2023).
//!
//! Where an interpolated normal faces away from the view, the view is mirrored in the plane perpendicular to that
//! normal, so that nothing jumps there.

use std::f32::consts::{FRAC_1_PI, TAU};

#[cfg(feature = "gpu")]
use super::ShadingExpand;
use super::ranges::roughness_of;
use super::{Scatter, Shading, ShadingGradient};
use crate::cube::*;
use crate::model::frame::{
    arc_tangent_of, from_local, from_local_backward, sin_cos_of_turns, to_local,
};
use crate::model::{V3, splat, v3};

/// Minimum α: a lobe of a twentieth of a degree, which f32 still resolves.
const MIN_ALPHA: f32 = 1e-3;
/// Lower bound of squares that are divided by.
const TINY: f32 = 1e-12;
/// Lower bound of squared sines of caps, where the square root has a derivative.
const MIN_SQUARED_SINE: f32 = 1e-7;

/// Microfacets about a normal, and the direction that they are seen from.
#[apply(record!)]
pub(super) struct Facets {
    pub normal: V3,
    /// Toward the eye, on the normal's side.
    pub view: V3,
    pub alpha: f32,
    /// n·v ≥ 0.
    pub nv: f32,
    /// √(α² + (1 − α²) (n·v)²).
    pub rv: f32,
}

/// Derivatives with respect to the fields of [`Facets`].
#[apply(record!)]
pub(super) struct FacetsGradient {
    pub normal: V3,
    pub view: V3,
    pub alpha: f32,
}

#[cfg_attr(feature = "gpu", cube)]
impl FacetsGradient {
    #[inline(always)]
    pub fn zero() -> FacetsGradient {
        FacetsGradient {
            normal: splat(0.0),
            view: splat(0.0),
            alpha: 0.0,
        }
    }
}

/// Derivatives with respect to the normal, the direction of the incoming ray, and the roughness.
#[apply(record!)]
pub(super) struct SurfaceGradient {
    pub normal: V3,
    pub incoming: V3,
    pub roughness: f32,
}

/// Returns √(α² + (1 − α²) c²), for the square α² and the cosine c.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn slant(square: f32, cosine: f32) -> f32 {
    (square + (1.0 - square) * cosine * cosine).sqrt()
}

/// Returns α of a roughness: its square, at least the minimum.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn alpha_of(roughness: f32) -> f32 {
    let roughness = roughness_of(roughness);
    max(roughness * roughness, MIN_ALPHA)
}

#[cfg_attr(feature = "gpu", cube)]
impl Facets {
    /// Makes the facets for a ray with direction `incoming`.
    #[inline(always)]
    pub fn new(normal: V3, incoming: V3, roughness: f32) -> Facets {
        let along = normal.dot(incoming);
        let mut view = -incoming;
        if along > 0.0 {
            view += normal * (2.0 * along);
        }
        let alpha = alpha_of(roughness);
        let nv = along.abs();
        Facets {
            normal,
            view,
            alpha,
            nv,
            rv: slant(alpha * alpha, nv),
        }
    }

    /// Turns derivatives with respect to normal, view and α into those with respect to the arguments of
    /// [`Facets::new`].
    #[inline(always)]
    pub fn backward(&self, incoming: V3, roughness: f32, by: &FacetsGradient) -> SurfaceGradient {
        let along = self.normal.dot(incoming);
        let mut by_incoming = -by.view;
        let mut by_normal = by.normal;
        if along > 0.0 {
            let through = self.normal.dot(by.view);
            by_incoming += self.normal * (2.0 * through);
            by_normal += by.view * (2.0 * along) + incoming * (2.0 * through);
        }
        let by_roughness = select(
            roughness > 0.0 && roughness <= 1.0 && roughness * roughness > MIN_ALPHA,
            2.0 * roughness * by.alpha,
            0.0f32,
        );
        SurfaceGradient {
            normal: by_normal,
            incoming: by_incoming,
            roughness: by_roughness,
        }
    }

    /// Returns D(h) for a vector along h, 0 below the surface.
    #[inline(always)]
    pub fn distribution(&self, half: V3) -> f32 {
        let square = self.alpha * self.alpha;
        let height = self.normal.dot(half);
        let length = half.length_squared();
        let mut d = 0.0f32;
        if height > 0.0 && length > TINY {
            let across = half - self.normal * height;
            let e = square + (1.0 - square) * (across.length_squared() / length);
            d = square * FRAC_1_PI / (e * e);
        }
        d
    }

    /// Adds the derivatives of g·D(h), and returns the one with respect to the vector along h.
    #[inline(always)]
    pub fn distribution_backward(&self, half: V3, g: f32, by: &mut FacetsGradient) -> V3 {
        let square = self.alpha * self.alpha;
        let height = self.normal.dot(half);
        let length = half.length_squared();
        let mut by_half = splat(0.0);
        if height > 0.0 && length > TINY {
            let inverse = 1.0 / length;
            let across = half - self.normal * height;
            let share = across.length_squared() * inverse;
            let e = square + (1.0 - square) * share;
            let d = square * FRAC_1_PI / (e * e);
            let by_e = -2.0f32 * g * d / e;
            by.alpha += 2.0 * self.alpha * (g * d / square + by_e * (1.0 - share));
            let by_share = by_e * (1.0 - square);
            by_half = (across - half * share) * (2.0 * by_share * inverse);
            by.normal -= across * (2.0 * by_share * inverse * height);
        }
        by_half
    }

    /// Returns V = G/(4 n·v n·l) for a light direction above the surface.
    #[inline(always)]
    pub fn visibility(&self, nl: f32) -> f32 {
        let rl = slant(self.alpha * self.alpha, nl);
        0.5 / (nl * self.rv + self.nv * rl)
    }

    /// Returns the derivatives of V with respect to n·v, n·l and α.
    #[inline(always)]
    pub fn visibility_slopes(&self, nl: f32) -> V3 {
        let square = self.alpha * self.alpha;
        let rv = self.rv;
        let nv = self.nv;
        let rl = slant(square, nl);
        let sum = nl * rv + nv * rl;
        let scale = -0.5f32 / (sum * sum);
        let rest = 1.0 - square;
        let by_nv = rl + nl * rest * nv / rv;
        let by_nl = rv + nv * rest * nl / rl;
        let by_square = 0.5 * (nl * (1.0 - nv * nv) / rv + nv * (1.0 - nl * nl) / rl);
        v3(by_nv, by_nl, 2.0 * self.alpha * by_square) * scale
    }

    /// Returns the derivatives of n·v + √(α² + (1 − α²) (n·v)²), which densities are divided by, with respect to n·v
    /// and α.
    #[inline(always)]
    pub fn slant_slopes(&self) -> V3 {
        let rest = 1.0 - self.alpha * self.alpha;
        let by_nv = 1.0 + rest * self.nv / self.rv;
        v3(by_nv, self.alpha * (1.0 - self.nv * self.nv) / self.rv, 0.0)
    }

    /// Adds a derivative with respect to n·v.
    #[inline(always)]
    pub fn nv_backward(&self, g: f32, by: &mut FacetsGradient) {
        by.normal += self.view * g;
        by.view += self.normal * g;
    }

    /// Returns the density of visible facets, D max(0, v·h) G₁/(n·v), divided by max(0, v·h).
    #[inline(always)]
    pub fn visible(&self, half: V3) -> f32 {
        2.0 * self.distribution(half) / (self.nv + self.rv)
    }

    /// Returns the direction into which a facet with a half vector reflects the view.
    #[inline(always)]
    pub fn reflected(&self, half: V3) -> V3 {
        half * (2.0 * self.view.dot(half)) - self.view
    }
}

/// A sampled half vector, with the intermediate values of its computation.
#[apply(record!)]
struct Drawn {
    /// The unit vector of the stretched view in the normal's frame, and the inverse of its length before
    /// normalization.
    stretched: V3,
    inverse: f32,
    /// The sine of the sampled point of the cap.
    sine: f32,
    /// The sum of the sampled point of the cap and the stretched view.
    sum: V3,
    /// The half vector in the normal's frame, and the inverse of its length before normalization.
    local: V3,
    per_length: f32,
}

#[cfg_attr(feature = "gpu", cube)]
impl Facets {
    #[inline(always)]
    fn drawn(&self, u: f32, v: f32) -> Drawn {
        let view = to_local(self.normal, self.view);
        let stretched = v3(self.alpha * view.x, self.alpha * view.y, view.z);
        let inverse = 1.0 / stretched.length();
        let stretched = stretched * inverse;
        let z = 1.0 - u - u * stretched.z;
        let sine = max(1.0 - z * z, MIN_SQUARED_SINE).sqrt();
        let turn = sin_cos_of_turns(v);
        let sum = stretched + v3(sine * turn.cos, sine * turn.sin, z);
        let half = v3(self.alpha * sum.x, self.alpha * sum.y, max(sum.z, 0.0));
        let per_length = 1.0 / max(half.length_squared(), TINY).sqrt();
        Drawn {
            stretched,
            inverse,
            sine,
            sum,
            local: half * per_length,
            per_length,
        }
    }

    /// Samples the half vector of a visible facet, for two uniform numbers.
    #[inline(always)]
    pub fn draw(&self, u: f32, v: f32) -> V3 {
        from_local(self.normal, self.drawn(u, v).local)
    }

    /// Adds the derivatives of g·h of a sampled half vector with respect to normal and view, at fixed random numbers.
    #[inline(always)]
    pub fn draw_backward(&self, u: f32, v: f32, g: V3, by: &mut FacetsGradient) {
        let d = self.drawn(u, v);
        let by_half = from_local_backward(self.normal, d.local, g);
        by.normal += by_half.axis;
        let by_sum = by_half.local.reject_from_normalized(d.local) * d.per_length;
        let turn = sin_cos_of_turns(v);
        let by_sum = v3(by_sum.x * self.alpha, by_sum.y * self.alpha, by_sum.z);
        let z = 1.0 - u - u * d.stretched.z;
        let mut by_z = by_sum.z;
        if 1.0 - z * z > MIN_SQUARED_SINE {
            by_z -= (by_sum.x * turn.cos + by_sum.y * turn.sin) * z / d.sine;
        }
        let by_unit = by_sum - v3(0.0, 0.0, by_z * u);
        let by_stretched = by_unit.reject_from_normalized(d.stretched) * d.inverse;
        let by_view = v3(
            by_stretched.x * self.alpha,
            by_stretched.y * self.alpha,
            by_stretched.z,
        );
        by.normal += from_local_backward(self.normal, by_view, self.view).axis;
        by.view += from_local(self.normal, by_view);
    }

    /// Returns the two random numbers that would have sampled a half vector.
    #[inline(always)]
    pub fn numbers_of(&self, half: V3) -> V3 {
        let view = to_local(self.normal, self.view);
        let stretched = v3(self.alpha * view.x, self.alpha * view.y, view.z);
        let stretched = stretched * (1.0 / stretched.length());
        let local = to_local(self.normal, half);
        let sum = v3(local.x, local.y, self.alpha * local.z);
        let sum = sum * (1.0 / max(sum.length_squared(), TINY).sqrt());
        let cap = sum * (2.0 * sum.dot(stretched)) - stretched;
        let mut turn = arc_tangent_of(cap.y, cap.x) / TAU;
        turn -= turn.floor();
        let u = ((1.0 - cap.z) / (1.0 + stretched.z)).clamp(0.0, 1.0);
        v3(u, turn, 0.0)
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Shading {
    /// Returns the microfacets about a normal.
    #[inline(always)]
    pub(super) fn facets_about(&self, normal: V3) -> Facets {
        Facets::new(normal, self.incoming, self.exponent)
    }

    /// Adds derivatives with respect to the facets.
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

    /// Adds the derivatives of g·direction of a direction that a facet reflected, at fixed random numbers.
    #[inline(never)]
    pub(super) fn reflected_backward(
        &self,
        drawn: &Scatter,
        g: V3,
        gradient: &mut ShadingGradient,
    ) {
        let f = self.facets_about(self.normal);
        let half = f.draw(drawn.u, drawn.v);
        let mut by = FacetsGradient::zero();
        by.view = half * (2.0 * g.dot(half)) - g;
        let by_half = g * (2.0 * f.view.dot(half)) + f.view * (2.0 * g.dot(half));
        f.draw_backward(drawn.u, drawn.v, by_half, &mut by);
        self.add_facets(&f, &by, gradient);
    }
}
