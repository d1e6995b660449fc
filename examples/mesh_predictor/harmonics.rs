//! Smooth functions on a sphere. The offsets of its vertices are sums of them.

use std::f64::consts::{FRAC_1_PI, SQRT_2};

use glam::DVec3;

/// Returns real spherical harmonics of degree 1 to `degree` in a direction of length 1. They are orthonormal over the
/// sphere, and sorted by degree l, then by order from −l to l: degree·(degree + 2) numbers. The constant function is
/// left out, since offsets by it would be a translation.
pub fn harmonics(degree: usize, direction: DVec3) -> Vec<f64> {
    let legendre = legendre(degree, direction.y);
    let around = direction.x.atan2(direction.z);
    let mut values = Vec::with_capacity(degree * (degree + 2));
    for row in legendre.iter().skip(1) {
        let l = row.len() as i64 - 1;
        for m in -l..=l {
            let order = m.unsigned_abs() as usize;
            let angle = order as f64 * around;
            values.push(match m {
                0 => row[0],
                1.. => SQRT_2 * row[order] * angle.cos(),
                _ => SQRT_2 * row[order] * angle.sin(),
            });
        }
    }
    values
}

/// Returns the degree of each of these functions.
pub fn degrees(degree: usize) -> Vec<usize> {
    (1..=degree).flat_map(|l| vec![l; 2 * l + 1]).collect()
}

/// Returns associated Legendre functions of a cosine, normalized for the sphere, [l][m] for 0 ≤ m ≤ l, by the
/// recurrences of Press et al., *Numerical Recipes*, 6.7.
fn legendre(degree: usize, x: f64) -> Vec<Vec<f64>> {
    let sin = (1.0 - x * x).max(0.0).sqrt();
    let mut rows: Vec<Vec<f64>> = Vec::with_capacity(degree + 1);
    let mut diagonal = (0.25 * FRAC_1_PI).sqrt();
    for l in 0..=degree {
        if l > 0 {
            diagonal *= -sin * ((2 * l + 1) as f64 / (2 * l) as f64).sqrt();
        }
        let mut row = Vec::with_capacity(l + 1);
        for m in 0..l {
            let factor = |l: usize| ((4 * l * l - 1) as f64 / (l * l - m * m) as f64).sqrt();
            let before = match l.checked_sub(2).and_then(|i| rows[i].get(m)) {
                Some(p) => p / factor(l - 1),
                None => 0.0,
            };
            row.push(factor(l) * (x * rows[l - 1][m] - before));
        }
        row.push(diagonal);
        rows.push(row);
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// Uses a midpoint rule that integrates the products almost exactly.
    #[test]
    fn harmonics_are_orthonormal() {
        const STEPS: usize = 400;
        const AROUND: usize = 32;
        let count = degrees(6).len();
        let mut products = vec![0.0; count * count];
        for i in 0..STEPS {
            let y = (2 * i + 1) as f64 / STEPS as f64 - 1.0;
            for j in 0..AROUND {
                let (s, c) = (TAU * j as f64 / AROUND as f64).sin_cos();
                let r = (1.0 - y * y).sqrt();
                let values = harmonics(6, DVec3::new(r * c, y, r * s));
                for (p, a) in values.iter().enumerate() {
                    for (q, b) in values.iter().enumerate() {
                        products[p * count + q] += a * b * 2.0 * TAU / (STEPS * AROUND) as f64;
                    }
                }
            }
        }
        for (k, product) in products.iter().enumerate() {
            let expected = f64::from(k / count == k % count);
            assert!((product - expected).abs() < 1e-3, "{k}: {product}");
        }
    }
}
