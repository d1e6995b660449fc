//! Fresnel reflectances of interfaces, as functions of the cosine to the normal.

use crate::cube::*;
use crate::model::{V3, v3};

/// Lower bound of numbers that are divided by.
const TINY: f32 = 1e-12;

/// Returns the factor (1 − cos)⁵ of Schlick's F₀ + (1 − F₀) (1 − cos)⁵.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn schlick(cosine: f32) -> f32 {
    let x = max(1.0 - cosine, 0.0);
    x * x * x * x * x
}

/// Returns the derivative of [`schlick`].
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn schlick_slope(cosine: f32) -> f32 {
    let x = max(1.0 - cosine, 0.0);
    -5.0f32 * x * x * x * x
}

/// Returns √((√(t₀² + 4 η² k²) + t₀)/2). For t₀ ≤ 0 it avoids the difference of nearly equal numbers, which would
/// cancel where η is small.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn half_angle(t0: f32, sum: f32, product: f32) -> f32 {
    let far = max(0.5 * (sum + t0), 0.0).sqrt();
    let near = product * (2.0 / max(sum - t0, TINY)).sqrt();
    select(t0 <= 0.0, near, far)
}

/// Returns the reflectance for unpolarized light of a conductor with the complex index η − i k.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn conductor(cosine: f32, eta: f32, k: f32) -> f32 {
    let square = cosine * cosine;
    let rest = 1.0 - square;
    let t0 = eta * eta - k * k - rest;
    let sum = (t0 * t0 + 4.0 * eta * eta * k * k).sqrt();
    let a = half_angle(t0, sum, eta * k);
    let t1 = sum + square;
    let t2 = 2.0 * a * cosine;
    let t3 = square * sum + rest * rest;
    let t4 = t2 * rest;
    let across = (t1 - t2) / max(t1 + t2, TINY);
    let ratio = (t3 - t4) / max(t3 + t4, TINY);
    0.5 * across * (1.0 + ratio)
}

/// Returns the derivatives of [`conductor`] with respect to the cosine, η and k.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn conductor_slopes(cosine: f32, eta: f32, k: f32) -> V3 {
    let square = cosine * cosine;
    let rest = 1.0 - square;
    let t0 = eta * eta - k * k - rest;
    let sum = (t0 * t0 + 4.0 * eta * eta * k * k).sqrt();
    let product = eta * k;
    let a = half_angle(t0, sum, product);
    let t1 = sum + square;
    let t2 = 2.0 * a * cosine;
    let t3 = square * sum + rest * rest;
    let t4 = t2 * rest;
    let of_across = max(t1 + t2, TINY);
    let of_ratio = max(t3 + t4, TINY);
    let across = (t1 - t2) / of_across;
    let by_across = 0.5 * (1.0 + (t3 - t4) / of_ratio);
    let by_t3 = across * t4 / (of_ratio * of_ratio);
    let by_t4 = -across * t3 / (of_ratio * of_ratio);
    let by_t1 = 2.0 * by_across * t2 / (of_across * of_across);
    let by_t2 = by_t4 * rest - 2.0 * by_across * t1 / (of_across * of_across);
    let by_a = 2.0 * by_t2 * cosine;
    let mut by_sum = by_t3 * square + by_t1;
    let mut by_t0 = 0.0f32;
    let mut by_product = 0.0f32;
    if t0 > 0.0 {
        let by_half = 0.25 * by_a / max(a, TINY);
        by_sum += by_half;
        by_t0 = by_half;
    } else {
        let inverse = 1.0 / max(sum - t0, TINY);
        by_sum -= 0.5 * by_a * a * inverse;
        by_t0 = 0.5 * by_a * a * inverse;
        by_product = by_a * (2.0 * inverse).sqrt();
    }
    let by_sum = by_sum / max(sum, TINY);
    by_t0 += by_sum * t0;
    by_product += 4.0 * by_sum * product;
    let by_rest = by_t4 * t2 + 2.0 * by_t3 * rest - by_t0;
    let by_square = by_t3 * sum + by_t1 - by_rest;
    v3(
        2.0 * a * by_t2 + 2.0 * cosine * by_square,
        by_product * k + 2.0 * eta * by_t0,
        by_product * eta - 2.0 * k * by_t0,
    )
}

/// Returns the reflectance of a dielectric, and its derivatives with respect to the cosine and η. Light comes from
/// the side with index 1 to the side with index η. The reflectance is 1 under total internal reflection.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn dielectric(cosine: f32, eta: f32) -> V3 {
    let inverse = 1.0 / (eta * eta);
    let square = (1.0 - cosine * cosine) * inverse;
    let mut r = v3(1.0, 0.0, 0.0);
    if square < 1.0 {
        let passed = max(1.0 - square, TINY).sqrt();
        let of_p = eta * cosine + passed;
        let of_s = cosine + eta * passed;
        let p = (eta * cosine - passed) / of_p;
        let s = (cosine - eta * passed) / of_s;
        // Derivatives of the reflectance with respect to both amplitudes, times those of the amplitudes.
        let by_p = 2.0 * p / (of_p * of_p);
        let by_s = 2.0 * s / (of_s * of_s);
        let by_passed = -(by_p + by_s) * eta * cosine;
        let by_cosine = by_passed * cosine * inverse / passed + (by_p + by_s) * eta * passed;
        let by_eta = by_passed * square / (eta * passed) + (by_p - by_s) * cosine * passed;
        r = v3(0.5 * (p * p + s * s), by_cosine, by_eta);
    }
    r
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(found: f32, wanted: f32, what: &str) {
        assert!(
            (found - wanted).abs() < 2e-3 * wanted.abs().max(0.2),
            "{what}: {found} {wanted}"
        );
    }

    /// Gold in red light, against the complex amplitudes of Fresnel's equations, and glass along its normal.
    #[test]
    fn reflectances() {
        // Normal incidence, η − i k = 0.143 − 3.983 i.
        close(conductor(1.0, 0.143, 3.983), 0.966_63, "gold");
        close(dielectric(1.0, 1.5).x, 0.04, "glass");
        close(dielectric(0.0, 1.5).x, 1.0, "glass at the horizon");
        close(dielectric(0.5, 1.5).x, 0.089_18, "glass at 60°");
        assert_eq!(dielectric(0.5, 1.0 / 1.5).x, 1.0);
        // Without absorption a conductor is a dielectric.
        close(conductor(0.5, 1.5, 0.0), dielectric(0.5, 1.5).x, "as glass");
    }

    #[test]
    fn derivatives() {
        let h = 1e-3;
        for (c, eta, k) in [
            (0.9, 0.2, 3.9),
            (0.3, 1.4, 2.0),
            (0.6, 1.5, 0.3),
            (0.6, 0.002, 3.9),
        ] {
            let s = conductor_slopes(c, eta, k);
            let slope = |f: &dyn Fn(f32) -> f32| (f(h) - f(-h)) / (2.0 * h);
            close(s.x, slope(&|h| conductor(c + h, eta, k)), "cosine");
            close(s.y, slope(&|h| conductor(c, eta + h, k)), "eta");
            close(s.z, slope(&|h| conductor(c, eta, k + h)), "k");
        }
        for (c, eta) in [(0.9, 1.5), (0.2, 1.5), (0.9, 0.7), (0.8, 0.7)] {
            let s = dielectric(c, eta);
            let slope = |f: &dyn Fn(f32) -> f32| (f(h) - f(-h)) / (2.0 * h);
            close(s.y, slope(&|h| dielectric(c + h, eta).x), "cosine");
            close(s.z, slope(&|h| dielectric(c, eta + h).x), "eta");
        }
        close(
            schlick_slope(0.3),
            (schlick(0.301) - schlick(0.299)) / 2e-3,
            "schlick",
        );
    }
}
