//! Dielectric microfacets, which reflect and refract (Walter et al. 2007).
//!
//! Let v be the view, l the direction, η the index of refraction on the other side over the index on the view's side,
//! and h the facet normal along H = ± (v + η l). Then refraction has f·cos θ = T D V K cos θ with K = 4 (v·H)
//! (−l·H)/|H|⁴. f applies to radiance, which is smaller by η² if it is spread over η² times the solid angle.
//!
//! Light that a slanted facet reflects downward or refracts upward is lost, and so is light that facets occlude. If
//! the material is compensated, f is multiplied by 1/E, where E is the albedo as a function of the view, α and η
//! (Turquin 2019).
//!
//! Facets with n·h near 0 still refract, where D does not vanish there, while facets with n·h < 0 do not exist. So K
//! has a factor that falls to 0 at n·h = 0. The transmitted light then has no jump, which gradients would have to
//! account for.

#[cfg(feature = "gpu")]
use super::ShadingExpand;
use super::albedo::Fit;
use super::facets::{Facets, FacetsGradient};
use super::fresnel::dielectric;
use super::glass_albedo::given_back;
use super::refraction::{Turn, UPRIGHT};
use super::{IMPOSSIBLE, Lobe, Scatter, Shading, ShadingGradient};
use crate::cube::*;
use crate::model::{V3, select_vector, splat, v3};

/// Derivatives of a loss with respect to the factors: D, V, the reflected or transmitted fraction of light, K, n·v +
/// r_v, which densities are divided by, cos θ, 1/E, and the factor for facets with n·h near 0.
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

/// Returns the tint, which is 1 for clear glass.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn albedo(shading: &Shading) -> V3 {
    shading.diffuse
}

/// Returns the probability of choosing reflection before a facet is sampled. Slanted facets transmit light where a
/// facet along the normal reflects all of it, so neither choice has probability 0.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn gloss(shading: &Shading) -> f32 {
    let nv = shading.normal.dot(shading.incoming).abs();
    dielectric(min(nv, 1.0), shading.eta()).x.clamp(0.05, 0.5)
}

/// Returns f·cos θ.
#[cfg_attr(feature = "gpu", cube)]
#[inline(never)]
pub(super) fn evaluate(shading: &Shading, outgoing: V3) -> V3 {
    let f = shading.facets_about(shading.normal);
    let nl = shading.normal.dot(outgoing);
    let cosine = shading.cosine_on_side(outgoing, nl > 0.0);
    let mut sum = splat(0.0);
    if cosine > 0.0 {
        let t = shading.turn(&f, outgoing);
        let v = f.visibility(nl.abs());
        let back = shading.back(&f).value;
        sum = shading.tint(t.above)
            * (t.part.x * f.distribution(t.half) * v * t.k * t.upright * cosine * back);
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
    let f = shading.facets_about(shading.normal);
    let nl = shading.normal.dot(outgoing);
    let cosine = shading.cosine_on_side(outgoing, nl > 0.0);
    let mut by_outgoing = splat(0.0);
    let t = shading.turn(&f, outgoing);
    if cosine > 0.0 && t.k > 0.0 {
        let v = f.visibility(nl.abs());
        let d = f.distribution(t.half);
        let p = t.part.x;
        let k = t.k * t.upright;
        let back = shading.back(&f).value;
        if !t.above {
            gradient.diffuse += g * (p * d * v * k * cosine * back);
        }
        let whole = g.dot(shading.tint(t.above));
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
        by_outgoing = shading.factors_backward(&f, &t, outgoing, &by, gradient);
    }
    by_outgoing
}

/// Returns the density of a direction, about a normal: first component if it is reflected, above the surface; second
/// if it is refracted, below.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn densities(shading: &Shading, normal: V3, outgoing: V3) -> V3 {
    let f = shading.facets_about(normal);
    let t = shading.turn(&f, outgoing);
    let mut jacobian = 0.25f32;
    if !t.above {
        let eta = shading.eta();
        jacobian = 0.25 * eta * eta * t.k;
    }
    let density = t.part.x * f.visible(t.half) * jacobian;
    let mut found = v3(0.0, density, 0.0);
    if t.above {
        found = v3(density, 0.0, 0.0);
    }
    found
}

/// Samples a facet, then reflects or refracts.
#[cfg_attr(feature = "gpu", cube)]
#[inline(never)]
pub(super) fn draw(shading: &Shading, drawn: &mut Scatter, normal: V3, lobe: f32) {
    let f = shading.facets_about(normal);
    let half = f.draw(drawn.u, drawn.v);
    drawn.of_gloss = lobe < shading.part_reflected(&f, half);
    if drawn.of_gloss {
        drawn.direction = f.reflected(half);
    } else {
        drawn.direction = shading.refracted_at(&f, half);
    }
    // Light that a slanted facet turns to the wrong side is lost.
    let kept = normal.dot(drawn.direction) > 0.0;
    let kept = select(!drawn.of_gloss, !kept, kept);
    if kept {
        drawn.weight = splat(1.0);
    }
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
    let f = shading.facets_about(shading.normal);
    let outgoing = drawn.direction;
    let mut by_outgoing = splat(0.0);
    if !drawn.weight.is_zero() {
        let t = shading.turn(&f, outgoing);
        let nl = shading.normal.dot(outgoing).abs();
        let cosine = shading.cosine_on_side(outgoing, t.above);
        let v = f.visibility(nl);
        let sum = f.nv + f.rv;
        let back = shading.back(&f).value;
        let mut scale = 2.0f32 * t.upright;
        if !t.above {
            let eta = shading.eta();
            scale = 2.0 * t.upright / (eta * eta);
            let weight = scale * v * sum * cosine * back;
            gradient.diffuse += g * weight;
            shading.eta_backward(-2.0f32 * g.dot(shading.diffuse) * weight / eta, gradient);
        }
        let whole = g.dot(shading.tint(t.above)) * scale;
        let g = whole * back;
        let by = FactorsGradient {
            d: 0.0,
            v: g * sum * cosine,
            part: g * v * sum * cosine / max(t.part.x, IMPOSSIBLE),
            k: 0.0,
            sum: g * v * cosine,
            cosine: g * v * sum,
            back: whole * v * sum * cosine,
            upright: whole * v * sum * cosine * back / t.upright,
        };
        by_outgoing = shading.factors_backward(&f, &t, outgoing, &by, gradient);
    }
    by_outgoing
}

/// Sets the random numbers that would have sampled the facet that turns the view into a direction.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn as_drawn(shading: &Shading, drawn: &mut Scatter) {
    let f = shading.facets_about(shading.normal);
    let numbers = f.numbers_of(shading.half_of(&f, drawn.direction, drawn.of_gloss));
    drawn.u = numbers.x;
    drawn.v = numbers.y;
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
        shading.refracted_backward(drawn, g, gradient);
    }
}

/// Narrows a lobe to the directions that microfacets reflect to, or refract to.
#[cfg_attr(feature = "gpu", cube)]
#[inline(never)]
pub(super) fn lobe(shading: &Shading, lobe: &mut Lobe, of_gloss: bool, tangent: f32) {
    let f = shading.facets_about(shading.normal);
    let mut core = splat(0.0);
    let mut turns = 2.0f32;
    if of_gloss {
        core = f.reflected(shading.normal);
    } else {
        lobe.axis = -shading.normal;
        core = shading.refracted_at(&f, shading.normal).normalize();
        turns = shading.bending();
    }
    lobe.take_facets(core, turns, f.alpha, tangent);
}

#[cfg_attr(feature = "gpu", cube)]
impl Shading {
    /// Returns the compensation factor 1/E, or 1 without compensation.
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

    /// Returns cos θ on the side that a direction is on, limited at the horizon.
    #[inline(always)]
    fn cosine_on_side(&self, outgoing: V3, above: bool) -> f32 {
        let towards = select_vector(above, outgoing, -outgoing);
        self.cosine(towards)
    }

    /// Returns the color factor of reflected or refracted light.
    #[inline(always)]
    fn tint(&self, above: bool) -> V3 {
        select_vector(above, splat(1.0), self.diffuse)
    }

    /// Adds the derivatives of the factors, and returns the one with respect to the outgoing direction.
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
        let side = select(t.above, 1.0f32, -1.0f32);
        by.normal += outgoing * (slopes.y * side);
        by_outgoing += self.normal * (slopes.y * side);
        self.add_facets(f, &by, gradient);
        by_outgoing + self.cosine_backward(outgoing * side, g.cosine, gradient) * side
    }
}
