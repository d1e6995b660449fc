//! Fits of the directional albedo of microfacets as functions of the view's cosine and α.
//!
//! The fits are polynomials that minimize the largest error against sums of 20,000 half vectors each, for cosines
//! from 0.03 and α up to 1. They err toward too little compensation rather than too much.

use crate::cube::*;
use crate::model::{V2, v2};

/// Returns a + b x + c x² + d x³ and its derivative.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn cubic(x: f32, a: f32, b: f32, c: f32, d: f32) -> V2 {
    v2(
        a + x * (b + x * (c + x * d)),
        b + x * (2.0 * c + x * (3.0 * d)),
    )
}

/// Safety factor: the albedo is taken as this multiple of its fit.
const MORE: f32 = 1.01;
/// Squared cosines are offset by this multiple of α, where the reflectance of facets rises toward the horizon.
const WIDTH: f32 = 0.35;

/// A function of a cosine, α and an index of refraction, with its derivatives.
#[apply(record!)]
pub struct Fit {
    pub value: f32,
    pub by_cosine: f32,
    pub by_alpha: f32,
    pub by_eta: f32,
}

/// Returns (1 − E)/E, where E is the albedo of facets that reflect all light and lose what they occlude from each
/// other. It is too small by at most 1.9 % of E, up to 5 % beyond 85°.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn lost(cosine: f32, alpha: f32) -> Fit {
    let sum = 1.0 / (cosine + alpha);
    let root = alpha.sqrt();
    let t = 2.0 * cosine * sum - 1.0;
    let r = 2.0 * root - 1.0;
    let a = cubic(r, 0.3061, 0.1093, 0.5738, -0.2933f32);
    let b = cubic(r, 0.0609, 0.2584, 0.0553, 0.1005);
    let c = cubic(r, -0.4035f32, 0.184, -0.3382f32, 0.8193);
    let d = cubic(r, -0.1115f32, -0.3186f32, 0.7078, 0.1753);
    let at = cubic(t, a.x, b.x, c.x, d.x);
    let by_r = a.y + t * (b.y + t * (c.y + t * d.y));
    let by_t = 2.0 * root * at.y * sum * sum;
    let albedo = MORE * (1.0 - root * at.x);
    let mut inverse = 1.0f32;
    let mut scale = 0.0f32;
    if albedo < 1.0 {
        inverse = 1.0 / albedo;
        scale = MORE * inverse * inverse;
    }
    Fit {
        value: inverse - 1.0,
        by_cosine: scale * alpha * by_t,
        by_alpha: scale * (0.5 * at.x / root + by_r - by_t * cosine),
        by_eta: 0.0f32,
    }
}

/// Returns the albedo of facets with F₀ = 0.04, including compensation, too large by at most 0.02.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn dielectric_facets(cosine: f32, alpha: f32) -> Fit {
    let per = 1.0 / (1.0 + WIDTH * alpha);
    let square = (cosine * cosine + WIDTH * alpha) * per;
    let slant = square.sqrt();
    let x = 1.0 - slant;
    let fourth = x * x * x * x;
    let root = alpha.sqrt();
    let a = cubic(root, 0.01292, 0.3276, -0.65677f32, 0.3079);
    let b = cubic(root, 0.04626, -0.41643f32, 0.77161, -0.36304f32);
    let c = cubic(root, 0.97575, 1.32648, -7.20601f32, 7.6076);
    let by_square = -2.5f32 * fourth * c.x / slant;
    let by_root = a.y + cosine * b.y + fourth * x * c.y;
    Fit {
        value: a.x + cosine * b.x + fourth * x * c.x,
        by_cosine: b.x + by_square * 2.0 * cosine * per,
        by_alpha: 0.5 * by_root / root + by_square * WIDTH * (1.0 - square) * per,
        by_eta: 0.0f32,
    }
}

/// Returns the cosine-weighted hemispherical mean of [`dielectric_facets`], and its derivative with respect to α.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn mean_of_dielectric_facets(alpha: f32) -> V2 {
    let root = alpha.sqrt();
    let rest = cubic(root, 0.06461, -0.575328f32, 0.764168, -0.319327f32);
    v2(
        0.092226 + root * rest.x,
        0.5 * (rest.x + root * rest.y) / root,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_of_fits() {
        let h = 1e-3;
        for (c, a) in [(0.2, 0.1), (0.9, 0.3), (0.5, 0.9), (0.7, 0.03), (0.06, 0.6)] {
            for f in [lost, dielectric_facets] {
                let at = f(c, a);
                let by_cosine = (f(c + h, a).value - f(c - h, a).value) / (2.0 * h);
                let by_alpha = (f(c, a + h).value - f(c, a - h).value) / (2.0 * h);
                let close = |x: f32, y: f32| (x - y).abs() < 1e-2 * y.abs().max(0.2);
                assert!(close(at.by_cosine, by_cosine), "{at:?} {by_cosine}");
                assert!(close(at.by_alpha, by_alpha), "{at:?} {by_alpha}");
            }
        }
    }

    /// The mean matches that of the fit.
    #[test]
    fn mean_of_the_fit() {
        for alpha in [0.01, 0.1, 0.5, 1.0] {
            let n = 2000;
            let mut mean = 0.0;
            for i in 0..n {
                let c = (i as f32 + 0.5) / n as f32;
                mean += dielectric_facets(c, alpha).value * 2.0 * c / n as f32;
            }
            let found = mean_of_dielectric_facets(alpha).x;
            assert!((found - mean).abs() < 4e-3, "{alpha}: {found} {mean}");
        }
    }
}
