//! Facets of clear matter, which reflect and refract (Walter et al. 2007).
//!
//! With v the view, l the direction, η the index of refraction on the other side over that on the view's, and the
//! facet's normal h along H = ± (v + η l), refracted is f·cos θ = T D V K cos θ with K = 4 (v·H) (−l·H)/|H|⁴: radiance
//! counts, which is less by η² where it is spread over as much more directions. What is reflected downwards or
//! refracted upwards by a slanted facet is lost, and what facets hide. All is given back by 1/E, where E is the albedo
//! by the view, α and η (Turquin 2019), if the material is compensated.
//!
//! Facets that stand upright still refract, where D does not vanish there, and those beyond don't exist. So K has a
//! factor that falls to 0 at n·h = 0: light through the surface has no jump, which gradients would have to follow.

#[cfg(feature = "wgpu")]
use super::ShadingExpand;
use super::albedo::Fit;
use super::facets::{Facets, FacetsGradient};
use super::fresnel::dielectric;
use super::glass_albedo::given_back;
use super::{IMPOSSIBLE, Scatter, Shading, ShadingGradient};
use crate::cube::*;
use crate::model::{V3, splat};

/// Facets refract in proportion to so many times n·h, up to all.
pub(crate) const UPRIGHT: f32 = 64.0;

/// Derivatives of a loss by D, V, the part of light that the interface reflects or lets pass, K, n·v + r_v, which
/// densities are divided by, cos θ, 1/E and the factor of upright facets.
#[apply(record!)]
struct FactorsGradient {
    d: f32,
    v: f32,
    part: f32,
    k: f32,
    sum: f32,
    cosine: f32,
    back: f32,
    upright: f32,
}

/// A facet that turns the view into a direction, above the surface or below.
#[apply(record!)]
struct Turn {
    /// Whether light is reflected.
    above: bool,
    /// H, its length, and 1 or −1 with H = ± (v + η l).
    half: V3,
    length: f32,
    sign: f32,
    /// v·H and −l·H, of which none is negative where a facet refracts, and v·h.
    a: f32,
    b: f32,
    cosine: f32,
    /// The part of light that goes this way, and its derivatives by the cosine and η.
    part: V3,
    k: f32,
    /// The factor of K of upright facets.
    upright: f32,
}

#[cfg_attr(feature = "wgpu", cube)]
impl Shading {
    /// The index of refraction on the other side over that on the view's.
    #[inline(always)]
    fn eta(&self) -> f32 {
        let mut eta = self.ior();
        if self.inside {
            eta = 1.0 / eta;
        }
        eta
    }

    /// How far a refracted direction turns when its facet does, along the normal.
    #[inline(always)]
    pub(super) fn bending(&self) -> f32 {
        (1.0 - 1.0 / self.eta()).abs()
    }

    #[inline(always)]
    fn eta_backward(&self, g: f32, gradient: &mut ShadingGradient) {
        let mut by = g;
        if self.inside {
            let eta = self.eta();
            by = -g * eta * eta;
        }
        if self.has_own_ior() {
            gradient.specular.x += by;
        }
    }

    /// What light is multiplied by, so that none is lost between facets.
    #[inline(always)]
    fn back(&self, f: &Facets) -> Fit {
        let mut found = Fit {
            value: 1.0f32,
            by_cosine: 0.0f32,
            by_alpha: 0.0f32,
            by_eta: 0.0f32,
        };
        if self.compensated {
            found = given_back(f.nv, f.alpha, self.eta());
        }
        found
    }

    #[inline(always)]
    fn turn(&self, f: &Facets, outgoing: V3) -> Turn {
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
        let length = half.length().max(IMPOSSIBLE);
        let a = f.view.dot(half).max(0.0);
        let b = (-outgoing.dot(half)).max(0.0);
        let cosine = (a / length).min(1.0);
        let mut part = dielectric(cosine, eta);
        let mut k = 1.0f32;
        let mut upright = 1.0f32;
        if !above {
            upright = (UPRIGHT * half.dot(f.normal) / length).min(1.0);
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

    /// cos θ on the side that a direction is on, limited at the horizon.
    #[inline(always)]
    fn cosine_on_side(&self, outgoing: V3, above: bool) -> f32 {
        let mut towards = outgoing;
        if !above {
            towards = -outgoing;
        }
        self.cosine(towards)
    }

    /// The colour of what is reflected, or refracted.
    #[inline(always)]
    fn tint(&self, above: bool) -> V3 {
        let mut tint = splat(1.0);
        if !above {
            tint = self.diffuse;
        }
        tint
    }

    /// f·cos θ.
    #[inline(never)]
    pub(super) fn interface(&self, outgoing: V3) -> V3 {
        let f = self.facets_about(self.normal);
        let nl = self.normal.dot(outgoing);
        let cosine = self.cosine_on_side(outgoing, nl > 0.0);
        let mut sum = splat(0.0);
        if cosine > 0.0 {
            let t = self.turn(&f, outgoing);
            let v = f.visibility(nl.abs());
            let back = self.back(&f).value;
            sum = self.tint(t.above)
                * (t.part.x * f.distribution(t.half) * v * t.k * t.upright * cosine * back);
        }
        sum
    }

    /// Adds the derivatives of g·f·cos θ; returns that by the outgoing direction.
    #[inline(never)]
    pub(super) fn interface_backward(
        &self,
        outgoing: V3,
        g: V3,
        gradient: &mut ShadingGradient,
    ) -> V3 {
        let f = self.facets_about(self.normal);
        let nl = self.normal.dot(outgoing);
        let cosine = self.cosine_on_side(outgoing, nl > 0.0);
        let mut by_outgoing = splat(0.0);
        let t = self.turn(&f, outgoing);
        if cosine > 0.0 && t.k > 0.0 {
            let v = f.visibility(nl.abs());
            let d = f.distribution(t.half);
            let p = t.part.x;
            let k = t.k * t.upright;
            let back = self.back(&f).value;
            if !t.above {
                gradient.diffuse += g * (p * d * v * k * cosine * back);
            }
            let whole = g.dot(self.tint(t.above));
            let g = whole * back;
            let by = FactorsGradient {
                d: g * p * v * k * cosine,
                v: g * p * d * k * cosine,
                part: g * d * v * k * cosine,
                k: g * p * d * v * t.upright * cosine,
                sum: 0.0,
                cosine: g * p * d * v * k,
                back: whole * p * d * v * k * cosine,
                upright: g * p * d * v * t.k * cosine,
            };
            by_outgoing = self.factors_backward(&f, &t, outgoing, &by, gradient);
        }
        by_outgoing
    }

    /// Adds the derivatives of the factors; returns that by the outgoing direction.
    #[inline(always)]
    fn factors_backward(
        &self,
        f: &Facets,
        t: &Turn,
        outgoing: V3,
        g: &FactorsGradient,
        gradient: &mut ShadingGradient,
    ) -> V3 {
        let mut by = FacetsGradient::zero();
        let mut by_half = f.distribution_backward(t.half, g.d, &mut by);
        // v·h = (v·H)/|H|.
        let per = 1.0 / t.length;
        let by_vh = g.part * t.part.y;
        let mut by_a = by_vh * per;
        let mut by_square = -0.5f32 * by_vh * t.cosine * per * per;
        let mut by_eta = g.part * t.part.z;
        let mut by_outgoing = splat(0.0);
        if t.above {
            by_half += f.view * by_a + t.half * (2.0 * by_square);
            by.view += t.half * by_a + by_half;
            by_outgoing = by_half;
        } else {
            let fourth = 4.0 * per * per * per * per * g.k;
            by_a += fourth * t.b;
            let by_b = fourth * t.a;
            by_square -= 2.0 * g.k * t.k * per * per;
            if t.upright < 1.0 {
                let by_nh = UPRIGHT * g.upright * per;
                by_half += f.normal * by_nh;
                by.normal += t.half * by_nh;
                by_square -= 0.5 * t.upright * g.upright * per * per;
            }
            by_half += f.view * by_a - outgoing * by_b + t.half * (2.0 * by_square);
            let by_half = by_half * t.sign;
            by.view += t.half * by_a + by_half;
            by_outgoing = by_half * self.eta() - t.half * by_b;
            by_eta += by_half.dot(outgoing);
        }
        let back = self.back(f);
        by_eta += g.back * back.by_eta;
        by.alpha += g.back * back.by_alpha;
        let by_nv = g.back * back.by_cosine;
        self.eta_backward(by_eta, gradient);
        let nl = self.normal.dot(outgoing);
        let slopes = f.visibility_slopes(nl.abs()) * g.v;
        let by_sum = f.slant_slopes() * g.sum;
        f.nv_backward(slopes.x + by_sum.x + by_nv, &mut by);
        by.alpha += slopes.z + by_sum.y;
        let mut side = 1.0f32;
        if !t.above {
            side = -1.0f32;
        }
        by.normal += outgoing * (slopes.y * side);
        by_outgoing += self.normal * (slopes.y * side);
        self.add_facets(f, &by, gradient);
        by_outgoing + self.cosine_backward(outgoing * side, g.cosine, gradient) * side
    }

    /// The density of directions about a normal.
    #[inline(always)]
    pub(super) fn interface_density(&self, normal: V3, outgoing: V3) -> f32 {
        let f = self.facets_about(normal);
        let t = self.turn(&f, outgoing);
        let mut jacobian = 0.25f32;
        if !t.above {
            let eta = self.eta();
            jacobian = 0.25 * eta * eta * t.k;
        }
        t.part.x * f.visible(t.half) * jacobian
    }

    /// The probability with which reflected light is chosen before a facet is drawn. Slanted facets let light pass
    /// where one along the normal reflects all of it, so neither choice is impossible.
    #[inline(always)]
    pub(super) fn interface_gloss(&self) -> f32 {
        let nv = self.normal.dot(self.incoming).abs();
        dielectric(nv.min(1.0), self.eta()).x.clamp(0.05, 0.5)
    }

    /// The part of light that a facet with a half vector reflects.
    #[inline(always)]
    pub(super) fn part_reflected(&self, f: &Facets, half: V3) -> f32 {
        dielectric(f.view.dot(half).clamp(0.0, 1.0), self.eta()).x
    }

    /// The direction in which a facet with a half vector refracts the view.
    #[inline(always)]
    pub(super) fn refracted_at(&self, f: &Facets, half: V3) -> V3 {
        let eta = self.eta();
        let c = f.view.dot(half);
        let passed = (1.0 - (1.0 - c * c) / (eta * eta)).max(IMPOSSIBLE).sqrt();
        half * (c / eta - passed) - f.view * (1.0 / eta)
    }

    /// Adds the derivatives of g·weight of a direction that was drawn; returns that by the direction.
    #[inline(never)]
    pub(super) fn interface_weight_backward(
        &self,
        s: &Scatter,
        g: V3,
        gradient: &mut ShadingGradient,
    ) -> V3 {
        let f = self.facets_about(self.normal);
        let outgoing = s.direction;
        let mut by_outgoing = splat(0.0);
        if !s.weight.is_zero() {
            let t = self.turn(&f, outgoing);
            let nl = self.normal.dot(outgoing).abs();
            let cosine = self.cosine_on_side(outgoing, t.above);
            let v = f.visibility(nl);
            let sum = f.nv + f.rv;
            let back = self.back(&f).value;
            let mut scale = 2.0f32 * t.upright;
            if !t.above {
                let eta = self.eta();
                scale = 2.0 * t.upright / (eta * eta);
                let weight = scale * v * sum * cosine * back;
                gradient.diffuse += g * weight;
                self.eta_backward(-2.0f32 * g.dot(self.diffuse) * weight / eta, gradient);
            }
            let whole = g.dot(self.tint(t.above)) * scale;
            let g = whole * back;
            let by = FactorsGradient {
                d: 0.0,
                v: g * sum * cosine,
                part: g * v * sum * cosine / t.part.x.max(IMPOSSIBLE),
                k: 0.0,
                sum: g * v * cosine,
                cosine: g * v * sum,
                back: whole * v * sum * cosine,
                upright: whole * v * sum * cosine * back / t.upright,
            };
            by_outgoing = self.factors_backward(&f, &t, outgoing, &by, gradient);
        }
        by_outgoing
    }

    /// Adds the derivatives of g·direction of a direction that a facet refracted, at fixed random numbers.
    #[inline(never)]
    pub(super) fn refracted_backward(&self, s: &Scatter, g: V3, gradient: &mut ShadingGradient) {
        let f = self.facets_about(self.normal);
        let half = f.draw(s.u, s.v);
        let eta = self.eta();
        let inverse = 1.0 / eta;
        let c = f.view.dot(half);
        let square = (1.0 - c * c) * inverse * inverse;
        let passed = (1.0 - square).max(1e-8).sqrt();
        let along = g.dot(half);
        let by_c = along * (inverse - c * inverse * inverse / passed);
        let by_eta = g.dot(f.view) * inverse * inverse
            - along * (c * inverse * inverse + square * inverse / passed);
        self.eta_backward(by_eta, gradient);
        let mut by = FacetsGradient::zero();
        by.view = half * by_c - g * inverse;
        let by_half = g * (c * inverse - passed) + f.view * by_c;
        f.draw_backward(s.u, s.v, by_half, &mut by);
        self.add_facets(&f, &by, gradient);
    }

    /// A vector along the half vector of the facet that turns the view into a direction, and whether it reflects.
    #[inline(always)]
    pub(super) fn half_of(&self, f: &Facets, outgoing: V3, of_gloss: bool) -> V3 {
        let mut half = f.view + outgoing;
        if !of_gloss {
            half = f.view + outgoing * self.eta();
            if half.dot(f.normal) < 0.0 {
                half = -half;
            }
        }
        half
    }
}
