//! Structural similarity against plain loops, and its gradients against central differences.

use super::losses::{Place, close, gradient_agrees, noise, of};
use crate::common::tensors::{gradient, scalar};
use softray::loss::{dssim, multi_scale, ssim};

/// Mean structural similarity by the definition: a loop over windows, with variances about the mean.
fn ssim_by_loops(x: &[f64], y: &[f64], [height, width, channels]: [usize; 3], range: f64) -> f64 {
    let (rows, columns) = (height.min(11), width.min(11));
    let (c1, c2) = ((0.01 * range).powi(2), (0.03 * range).powi(2));
    let weight = |i: usize, j: usize| {
        let v = i as f64 - (rows - 1) as f64 / 2.0;
        let u = j as f64 - (columns - 1) as f64 / 2.0;
        (-(u * u + v * v) / (2.0 * 1.5 * 1.5)).exp()
    };
    let (mut sum, mut windows) = (0.0, 0);
    for channel in 0..channels {
        for top in 0..=height - rows {
            for left in 0..=width - columns {
                let mut samples = Vec::new();
                for i in 0..rows {
                    for j in 0..columns {
                        let at = ((top + i) * width + left + j) * channels + channel;
                        samples.push((weight(i, j), x[at], y[at]));
                    }
                }
                let total: f64 = samples.iter().map(|s| s.0).sum();
                let mean = |f: &dyn Fn(f64, f64) -> f64| {
                    samples.iter().map(|&(w, x, y)| w * f(x, y)).sum::<f64>() / total
                };
                let (mx, my) = (mean(&|x, _| x), mean(&|_, y| y));
                let vx = mean(&|x, _| (x - mx).powi(2));
                let vy = mean(&|_, y| (y - my).powi(2));
                let vxy = mean(&|x, y| (x - mx) * (y - my));
                sum += (2.0 * mx * my + c1) * (2.0 * vxy + c2)
                    / ((mx * mx + my * my + c1) * (vx + vy + c2));
                windows += 1;
            }
        }
    }
    sum / f64::from(windows)
}

/// As large as a window, larger, smaller along one axis or both.
#[test]
fn structural_similarity_is_that_of_loops() {
    let shapes = [
        [11, 11, 1],
        [13, 17, 3],
        [4, 14, 2],
        [12, 1, 1],
        [2, 3, 1],
        [1, 1, 3],
    ];
    for (shape, range) in shapes.into_iter().flat_map(|s| [(s, 1.0), (s, 255.0)]) {
        let count = shape.iter().product();
        let image: Vec<f64> = noise(8, count).iter().map(|v| range * v).collect();
        let apart = noise(9, count);
        let near: Vec<f64> = image
            .iter()
            .zip(&apart)
            .map(|(i, n)| 0.7 * i + 0.2 * range * n)
            .collect();
        let far: Vec<f64> = apart.iter().map(|v| range * v).collect();
        for target in [&near, &far, &image] {
            let expected = ssim_by_loops(&image, target, shape, range);
            for place in Place::all() {
                let tensors = || (place.tensor(&image, shape), place.tensor(target, shape));
                let (a, b) = tensors();
                close(scalar(&of(ssim(a, b, range))), expected, place.precision);
                let (a, b) = tensors();
                let loss = scalar(&of(dssim(a, b, range)));
                close(loss, 0.5 * (1.0 - expected), place.precision);
            }
        }
        close(ssim_by_loops(&image, &image, shape, range), 1.0, 1e-12);
    }
}

/// Flat images differ in luminance alone: (2·a·b + C₁)/(a² + b² + C₁). Black ones are equal.
#[test]
fn structural_similarity_of_flat_images() {
    for place in Place::all() {
        for (a, b) in [(0.5, 0.5), (0.2, 0.8), (0.0, 1.0), (0.0, 0.0)] {
            let flat = |v: f64| place.tensor(&[v; 12 * 12], [12, 12, 1]);
            let leaf = flat(a).autodiff().require_grad();
            let found = of(ssim(leaf.clone(), flat(b), 1.0));
            let expected = (2.0 * a * b + 1e-4) / (a * a + b * b + 1e-4);
            // In f32 rounding of the variances is up to 1e-7 of C₂ = 9e-4.
            close(scalar(&found), expected, 100.0 * place.precision);
            let gradient = gradient(&leaf, &found.backward());
            assert!(gradient.iter().all(|g| g.is_finite()));
        }
    }
}

#[test]
fn gradients_of_structural_similarity() {
    for shape in [[12, 13, 2], [5, 12, 1], [3, 2, 3], [1, 1, 1]] {
        let count = shape.iter().product();
        let (image, apart) = (noise(10, count), noise(11, count));
        let pairs = image.iter().zip(&apart);
        let target: Vec<f64> = pairs.map(|(i, n)| 0.6 * i + 0.3 * n).collect();
        gradient_agrees(&image, &target, shape, |i, t| dssim(i, t, 1.0));
    }
    let (image, target) = (noise(12, 16 * 14), noise(13, 16 * 14));
    gradient_agrees(&image, &target, [16, 14, 1], |i, t| {
        multi_scale(i, t, 3, |i, t| dssim(i, t, 1.0))
    });
}
