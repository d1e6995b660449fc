//! Fits of how much light facets reflect altogether, by the cosine to the view and α: polynomials, fitted to sums over
//! 65,536 half vectors each, for cosines over 0.15 and α up to 1. Less than what is reflected is given back rather
//! than more.

use crate::model::{V2, v2};
#[cfg(feature = "wgpu")]
use burn::cubecl::{self, prelude::*};

/// a + b x + c x² + d x³ and its derivative.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
fn cubic(x: f32, a: f32, b: f32, c: f32, d: f32) -> V2 {
    v2(
        a + x * (b + x * (c + x * d)),
        b + x * (2.0 * c + x * (3.0 * d)),
    )
}

/// The most by which the fit of lost light is too much.
const MARGIN: f32 = 0.004;

/// A number that depends on a cosine and α, with its derivatives.
#[cfg_attr(
    feature = "wgpu",
    derive(CubeType, CubeTypeMut),
    expand(derive(Clone, Copy))
)]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fit {
    pub value: f32,
    pub by_cosine: f32,
    pub by_alpha: f32,
}

/// (1 − E)/E, where E is the albedo of facets that reflect all light, whose light is lost where facets hide each
/// other: by at most 2.2 % of E too little.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn lost(cosine: f32, alpha: f32) -> Fit {
    let sum = 1.0 / (cosine + alpha);
    let t = cosine * sum;
    let root = alpha.sqrt();
    let a = cubic(root, -6.3718f32, 21.0336, -22.8598f32, 8.2363);
    let b = cubic(root, 40.5848, -130.3038f32, 141.449, -49.4173f32);
    let c = cubic(root, -49.3034f32, 154.0924, -152.3343f32, 44.6219);
    let d = cubic(root, 15.192, -50.3444f32, 46.3515, -9.4056f32);
    let at = cubic(t, a.x, b.x, c.x, d.x);
    let by_root = a.y + t * (b.y + t * (c.y + t * d.y));
    // Less by what the fit is too much.
    let loss = (alpha * at.x - MARGIN).max(0.0);
    let rest = 1.0 / (1.0 - loss);
    let mut scale = rest * rest;
    if loss <= 0.0 {
        scale = 0.0;
    }
    Fit {
        value: loss * rest,
        by_cosine: scale * alpha * at.y * alpha * sum * sum,
        by_alpha: scale * (at.x + 0.5 * root * by_root - alpha * at.y * cosine * sum * sum),
    }
}

/// The albedo of facets of F₀ = 0.04, with what is given back: by at most 0.03 too much.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn dielectric_facets(cosine: f32, alpha: f32) -> Fit {
    let square = alpha * alpha;
    let slant = (square + (1.0 - square) * cosine * cosine).sqrt();
    let x = 1.0 - slant;
    let fourth = x * x * x * x;
    let a = cubic(alpha, 0.09949, -0.0281f32, -0.01215f32, 0.0);
    let b = cubic(alpha, -0.05941f32, 0.03223, -0.01768f32, 0.0);
    let c = cubic(alpha, 0.89463, -4.12061f32, 9.03501, 0.0);
    let by_slant = -5.0f32 * fourth * c.x;
    let inverse = 1.0 / slant;
    Fit {
        value: a.x + cosine * b.x + fourth * x * c.x,
        by_cosine: b.x + by_slant * (1.0 - square) * cosine * inverse,
        by_alpha: a.y
            + cosine * b.y
            + fourth * x * c.y
            + by_slant * alpha * (1.0 - cosine * cosine) * inverse,
    }
}

/// The mean of [`dielectric_facets`] over the hemisphere, weighed by the cosine, and its derivative by α.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn mean_of_dielectric_facets(alpha: f32) -> V2 {
    cubic(alpha, 0.098836, -0.171464f32, 0.220745, -0.121166f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_of_fits() {
        let h = 1e-3;
        for (c, a) in [(0.2, 0.1), (0.9, 0.3), (0.5, 0.9), (0.7, 0.02)] {
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

    /// The mean is that of the fit.
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
