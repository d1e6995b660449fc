//! A fit of the directional albedo of a dielectric interface as a function of the view's cosine, α and the index of
//! refraction.
//!
//! Facets turn some light to the wrong side, and occlude some that they turn to the right side. So the albedo for a
//! single reflection or refraction is 1 − L with L = √α fade(cos) P(t, r, s). Here t = cos/(cos + α), r = √α, and s
//! is a function of the index, each scaled to about [−1, 1].
//!
//! The polynomials P minimize the largest relative error against sums of 6,000 half vectors each, for cosines from
//! 0.03, α up to 1 and indices up to 2.6. They were fitted by least squares. The error is at most 1.6 %, or 2.6 %
//! where light leaves an index below 1.3. Margins of that size keep the albedo at most 1.

use super::albedo::{Fit, cubic};
use crate::cube::*;
use crate::model::{V2, V3, splat, v2, v3};

/// Largest index of the fit; a larger index loses light.
const MAX_INDEX: f32 = 2.6;
/// Lowest cosine of the fit for low contrasts.
const MIN_COSINE: f32 = 0.08;
/// Compensation near the horizon is reduced by cos/(cos + this).
const FADE: f32 = 0.005;
/// Indices between which the two fits for leaving light are blended, and the speed of the blend. It is slow, so that
/// the small difference between the fits hardly affects derivatives with respect to the index.
const FAINT: f32 = 1.22;
const CLEAR: f32 = 1.38;
const BLEND: f32 = 1.0 / (CLEAR - FAINT);
/// Scale of s in the cosine of the critical angle, or in its square root for low contrasts.
const SPEED_ENTERING: f32 = 1.0 / 0.46;
const SPEED_LEAVING: f32 = 1.0 / 0.16;
const SPEED_FAINT: f32 = 1.0 / 0.3;
/// Safety factors of the fitted albedo.
const MORE_ENTERING: f32 = 1.0118;
const MORE_LEAVING: f32 = 1.015;
const MORE_FAINT: f32 = 1.0255;

/// Value of a polynomial in t, r and s, with its derivatives.
#[apply(record!)]
struct Lost {
    value: f32,
    by_t: f32,
    by_r: f32,
    by_s: f32,
}

/// The albedo, and its derivatives with respect to the cosine, α and the index.
#[apply(record!)]
struct Left {
    value: f32,
    by: V3,
}

/// Returns a + b x + c x² + d x³ + e x⁴ and its derivative.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn quartic(x: f32, a: f32, b: f32, c: f32, d: f32, e: f32) -> V2 {
    let rest = cubic(x, b, c, d, e);
    v2(a + x * rest.x, rest.x + x * rest.y)
}

/// Evaluates a polynomial in r whose coefficients depend on s: its value and its derivatives with respect to r and s.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn along_r(r: f32, a: V2, b: V2, c: V2, d: V2, e: V2) -> V3 {
    let along = quartic(r, a.x, b.x, c.x, d.x, e.x);
    let across = quartic(r, a.y, b.y, c.y, d.y, e.y);
    v3(along.x, along.y, across.x)
}

/// Evaluates a polynomial in t whose coefficients depend on r and s.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn along_t(t: f32, a: V3, b: V3, c: V3, d: V3) -> Lost {
    let along = cubic(t, a.x, b.x, c.x, d.x);
    Lost {
        value: along.x,
        by_t: along.y,
        by_r: cubic(t, a.y, b.y, c.y, d.y).x,
        by_s: cubic(t, a.z, b.z, c.z, d.z).x,
    }
}

/// Returns P where light enters the denser side.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn entering(t: f32, r: f32, s: f32) -> Lost {
    let none = v2(0.0, 0.0);
    let a = along_r(
        r,
        cubic(s, 0.1868, -0.047f32, 0.0483, -0.0282f32),
        cubic(s, -0.1224f32, -0.0601f32, -0.0788f32, 0.2032),
        cubic(s, 0.081, 0.2753, 0.2039, -0.2392f32),
        cubic(s, -0.1052f32, -0.1159f32, -0.1118f32, 0.1385),
        none,
    );
    let b = along_r(
        r,
        cubic(s, -0.3509f32, 0.4229, -0.1193f32, -0.0903f32),
        cubic(s, -0.3568f32, 0.041, 0.7252, -0.5848f32),
        cubic(s, 0.3487, -1.6964f32, -0.6712f32, 2.2515),
        cubic(s, -0.2779f32, 1.4638, -0.0466f32, -1.4316f32),
        none,
    );
    let c = along_r(
        r,
        cubic(s, -0.1721f32, -0.2626f32, 0.2317, -0.0433f32),
        cubic(s, 0.8413, -0.8546f32, -0.9279f32, 1.4728),
        cubic(s, -0.6362f32, 1.05, 0.1364, -1.3471f32),
        cubic(s, 0.0471, 0.3709, -0.2732f32, 0.0841),
        none,
    );
    let d = along_r(
        r,
        cubic(s, 0.4477, -0.6824f32, -0.2956f32, 0.7344),
        cubic(s, 0.0594, 0.1697, -0.2784f32, -0.0739f32),
        cubic(s, 0.1447, 1.6807, -0.3059f32, -1.3847f32),
        cubic(s, -0.1633f32, -0.7767f32, 0.1232, 0.8135),
        none,
    );
    along_t(t, a, b, c, d)
}

/// Returns P where light leaves the denser side, for an index of about 1.3 or more.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn leaving(t: f32, r: f32, s: f32) -> Lost {
    let a = along_r(
        r,
        cubic(s, 0.4247, -0.0998f32, 0.0178, 0.0014),
        cubic(s, 0.1614, 0.0369, -0.1378f32, 0.0291),
        cubic(s, 0.1918, 0.4492, -0.0452f32, -0.0148f32),
        cubic(s, -0.8213f32, 0.087, 0.6008, -0.2741f32),
        cubic(s, 0.6474, -0.3078f32, -0.5087f32, 0.2617),
    );
    let b = along_r(
        r,
        cubic(s, -0.0174f32, 0.177, -0.0673f32, -0.041f32),
        cubic(s, -0.0973f32, 0.4786, -0.121f32, 0.0128),
        cubic(s, -0.9244f32, 0.3027, 0.6039, -0.1287f32),
        cubic(s, 0.9522, -0.3184f32, -0.1219f32, -0.1795f32),
        cubic(s, 0.7831, -0.5f32, -0.8932f32, 0.5411),
    );
    let c = along_r(
        r,
        cubic(s, -0.4972f32, 0.0998, -0.0825f32, 0.0331),
        cubic(s, -0.3465f32, 0.1714, 0.2596, 0.1073),
        cubic(s, -0.5411f32, -0.0842f32, 0.3465, -0.4785f32),
        cubic(s, 2.9716, -0.3165f32, -2.45f32, 1.4149),
        cubic(s, -0.1726f32, -0.5203f32, 0.4512, -0.332f32),
    );
    let d = along_r(
        r,
        cubic(s, -0.3982f32, 0.011, 0.0882, 0.1009),
        cubic(s, -0.7371f32, -0.0337f32, 0.1809, -0.1536f32),
        cubic(s, 2.048, -0.0203f32, -1.4002f32, 0.8869),
        cubic(s, -0.2915f32, -0.1981f32, 0.1845, -0.2557f32),
        cubic(s, 0.2496, -0.1638f32, -0.038f32, 0.0228),
    );
    along_t(t, a, b, c, d)
}

/// Returns P where light leaves the denser side, for an index close to 1.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn leaving_faintly(t: f32, r: f32, s: f32) -> Lost {
    let a = along_r(
        r,
        quartic(s, 0.5904, 0.2557, -0.4035f32, -0.1503f32, 0.1901),
        quartic(s, -1.026f32, 0.9729, 1.7692, -0.8794f32, -0.8298f32),
        quartic(s, 0.1243, -2.855f32, 1.2619, 2.5889, -1.0702f32),
        quartic(s, 1.4091, 1.4314, -6.9671f32, -0.8476f32, 4.3975),
        quartic(s, -1.0404f32, 0.3902, 4.5248, -0.6903f32, -2.6884f32),
    );
    let b = along_r(
        r,
        quartic(s, -1.0559f32, 0.5285, 0.985, -0.2182f32, -0.4025f32),
        quartic(s, 0.3292, -2.5841f32, -0.2569f32, 1.9227, 0.2764),
        quartic(s, 1.8277, 2.0451, -6.3419f32, -1.3206f32, 3.3064),
        quartic(s, -3.0287f32, 0.6692, 8.3878, -1.4535f32, -4.9494f32),
        quartic(s, 1.0342, -0.3355f32, -2.074f32, 1.3253, 1.7123),
    );
    let c = along_r(
        r,
        quartic(s, -0.2386f32, -0.9307f32, -0.0846f32, 0.4365, 0.2936),
        quartic(s, 1.636, -1.3346f32, -3.4923f32, 1.6741, 1.3018),
        quartic(s, -2.562f32, 2.1649, -0.7921f32, -2.4375f32, 2.4654),
        quartic(s, 0.3825, -0.1867f32, 9.24, 1.7926, -7.3857f32),
        quartic(s, 0.0418, 0.6083, -3.2735f32, -1.0257f32, 2.8556),
    );
    let d = along_r(
        r,
        quartic(s, 0.4456, -0.9299f32, -0.6312f32, 0.5358, 0.1614),
        quartic(s, -1.1068f32, 0.0529, -1.9513f32, -0.1528f32, 2.66),
        quartic(s, 0.4092, -1.5017f32, 4.8486, 2.9307, -4.4732f32),
        quartic(s, 0.606, 1.2615, -4.5331f32, -1.0271f32, 3.3882),
        quartic(s, -0.7951f32, 1.0442, 3.4335, -1.8363f32, -2.0969f32),
    );
    along_t(t, a, b, c, d)
}

/// Returns the albedo at a cosine and α, from the value of the polynomial P and the derivative of s with respect to
/// the index.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn left(cosine: f32, alpha: f32, lost: Lost, by_index: f32, more: f32, fade: V2) -> Left {
    let sum = 1.0 / (cosine + alpha);
    let root = alpha.sqrt();
    let scale = root * fade.x;
    // t and r are scaled to [−1, 1], which doubles their derivatives.
    let by_t = 2.0 * scale * lost.by_t * sum * sum;
    let by_cosine = by_t * alpha + root * fade.y * lost.value;
    let by_alpha = (0.5 * fade.x * lost.value) / root + fade.x * lost.by_r - by_t * cosine;
    let found = more * (1.0 - scale * lost.value);
    let mut value = 1.0f32;
    let mut slope = 0.0f32;
    if found < 1.0 {
        value = found;
        slope = -more;
    }
    Left {
        value,
        by: v3(by_cosine, by_alpha, scale * lost.by_s * by_index) * slope,
    }
}

/// Returns 1/E, where E is the albedo of an interface without absorption. `eta` is the index of refraction on the
/// other side over the index on the view's side.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn given_back(cosine: f32, alpha: f32, eta: f32) -> Fit {
    let mut index = eta;
    let mut by_eta = 1.0f32;
    if eta < 1.0 {
        index = 1.0 / eta;
        by_eta = -index * index;
    }
    if index > MAX_INDEX {
        index = MAX_INDEX;
        by_eta = 0.0;
    }
    // The cosine of the critical angle.
    let inverse = 1.0 / index;
    let critical = (1.0 - inverse * inverse).sqrt();
    let by_index = inverse * inverse * inverse / critical;
    let r = 2.0 * alpha.sqrt() - 1.0;
    let t = 2.0 * cosine / (cosine + alpha) - 1.0;
    let per = 1.0 / (cosine + FADE);
    let fade = v2(cosine * per, FADE * per * per);
    let mut found = Left {
        value: 1.0f32,
        by: splat(0.0),
    };
    if eta >= 1.0 {
        let lost = entering(t, r, (critical - 0.46) * SPEED_ENTERING);
        found = left(
            cosine,
            alpha,
            lost,
            by_index * SPEED_ENTERING,
            MORE_ENTERING,
            fade,
        );
    } else {
        // Blend the two fits by x² (3 − 2 x).
        let x = min(max((index - FAINT) * BLEND, 0.0), 1.0);
        let share = x * x * (3.0 - 2.0 * x);
        let by_share = 6.0 * x * (1.0 - x) * BLEND;
        let mut faint = found;
        if share < 1.0 {
            let c = max(cosine, MIN_COSINE);
            let t = 2.0 * c / (c + alpha) - 1.0;
            let root = critical.sqrt();
            let lost = leaving_faintly(t, r, (root - 0.51) * SPEED_FAINT);
            let by_root = by_index * 0.5 / root * SPEED_FAINT;
            faint = left(c, alpha, lost, by_root, MORE_FAINT, v2(1.0, 0.0));
            if cosine < MIN_COSINE {
                faint.by.x = 0.0;
            }
        }
        let mut clear = found;
        if share > 0.0 {
            let lost = leaving(t, r, (critical - 0.76) * SPEED_LEAVING);
            clear = left(
                cosine,
                alpha,
                lost,
                by_index * SPEED_LEAVING,
                MORE_LEAVING,
                fade,
            );
        }
        let by = faint.by * (1.0 - share) + clear.by * share;
        let by_blend = (clear.value - faint.value) * by_share;
        found = Left {
            value: faint.value * (1.0 - share) + clear.value * share,
            by: v3(by.x, by.y, by.z + by_blend),
        };
    }
    let value = 1.0 / found.value;
    let slope = -value * value;
    Fit {
        value,
        by_cosine: slope * found.by.x,
        by_alpha: slope * found.by.y,
        by_eta: slope * found.by.z * by_eta,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// On both sides, in each fit, between the fits, and where the index or the cosine is clamped.
    #[test]
    fn derivatives_of_what_is_given_back() {
        let h = 1e-3;
        let slope = |f: &dyn Fn(f32) -> f32| (f(h) - f(-h)) / (2.0 * h);
        let close = |x: f32, y: f32| (x - y).abs() < 1e-2 * y.abs().max(0.3);
        for eta in [1.1, 1.5, 3.0, 0.92, 0.755, 0.667, 0.5, 0.3] {
            for (c, a) in [(0.9, 0.3), (0.5, 0.9), (0.2, 0.1), (0.05, 0.5), (0.7, 0.03)] {
                let at = given_back(c, a, eta);
                let what = format!("{c} {a} {eta}: {at:?}");
                let by_cosine = slope(&|h| given_back(c + h, a, eta).value);
                assert!(close(at.by_cosine, by_cosine), "{what} {by_cosine}");
                let by_alpha = slope(&|h| given_back(c, a + h, eta).value);
                assert!(close(at.by_alpha, by_alpha), "{what} {by_alpha}");
                let by_eta = slope(&|h| given_back(c, a, eta + h).value);
                assert!(close(at.by_eta, by_eta), "{what} {by_eta}");
            }
        }
    }
}
