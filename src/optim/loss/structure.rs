//! Structural similarity.

use burn::tensor::Tensor;

use super::same_shape;

/// Pixels along a window.
const WINDOW: usize = 11;
/// Standard deviation of a window's Gaussian, pixels.
const DEVIATION: f64 = 1.5;
/// C₁ = (K₁·range)² keeps dark windows from dividing by 0, C₂ = (K₂·range)² flat ones.
const K1: f64 = 0.01;
const K2: f64 = 0.03;

/// Mean structural similarity of `[H, W, C]`, at most 1, and 1 for equal images (Wang et al. 2004,
/// *Image Quality Assessment: From Error Visibility to Structural Similarity*, Eq. 13):
///
/// (2·μₓ·μᵧ + C₁)·(2·σₓᵧ + C₂) / ((μₓ² + μᵧ² + C₁)·(σₓ² + σᵧ² + C₂))
///
/// over all channels and all windows of 11 × 11 pixels that lie inside of the image, weighted by a
/// Gaussian of 1.5 pixels. Along an axis of fewer than 11 pixels the window is as long as the axis.
///
/// `range` is the difference between the least and the largest value that is told apart, 1 for
/// images in [0, 1]. Bring radiance that goes far above it down first: variances are differences of
/// means of squares, and f32 has no digits left for them. Noise lowers the similarity, and two
/// renders don't mend that.
///
/// # Panics
/// If the shapes differ, or `range` is not a finite number > 0.
pub fn ssim(image: Tensor<3>, target: Tensor<3>, range: f64) -> Tensor<1> {
    same_shape(&image, &target);
    assert!(
        range.is_finite() && range > 0.0,
        "ssim: range is {range}, expected a finite number > 0"
    );
    let [c1, c2] = [K1, K2].map(|k| (k * range).powi(2));
    let square = |t: &Tensor<3>| t.clone() * t.clone();
    let (mean_x, mean_y) = (blurred(image.clone()), blurred(target.clone()));
    let product = mean_x.clone() * mean_y.clone();
    let squares = square(&mean_x) + square(&mean_y);
    // Rounding must not let the denominator through 0.
    let variances = blurred(square(&image) + square(&target)) - squares.clone();
    let variances = variances.clamp_min(0.0);
    let covariance = blurred(image * target) - product.clone();
    let above = (product * 2.0 + c1) * (covariance * 2.0 + c2);
    let below = (squares + c1) * (variances + c2);
    (above / below).mean()
}

/// (1 − [`ssim`])/2: a loss from 0, for equal images, to 1.
///
/// # Panics
/// Like [`ssim`].
pub fn dssim(image: Tensor<3>, target: Tensor<3>, range: f64) -> Tensor<1> {
    (ssim(image, target, range) - 1.0) * -0.5
}

/// Weighted means over the windows of `[H, W, C]`: `[H − h + 1, W − w + 1, C]` of windows of h × w.
/// The Gaussian is the product of one along each axis.
fn blurred(image: Tensor<3>) -> Tensor<3> {
    along(along(image, 0), 1)
}

/// Weighted means along an axis.
fn along(image: Tensor<3>, axis: usize) -> Tensor<3> {
    let length = image.dims()[axis];
    let weights = gaussian(length.min(WINDOW));
    let windows = length + 1 - weights.len();
    let part = |i: usize| image.clone().narrow(axis, i, windows) * weights[i];
    (1..weights.len()).fold(part(0), |sum, i| sum + part(i))
}

/// The weights of a window of `length` pixels, which sum up to 1.
fn gaussian(length: usize) -> Vec<f64> {
    let middle = 0.5 * (length as f64 - 1.0);
    let weight = |i: usize| (-0.5 * ((i as f64 - middle) / DEVIATION).powi(2)).exp();
    let sum: f64 = (0..length).map(weight).sum();
    (0..length).map(|i| weight(i) / sum).collect()
}
