//! Structural similarity.

use burn::tensor::Tensor;

use super::{batch, check_pair};
use crate::error::{Error, Result};

/// The side of a window, pixels.
const WINDOW: usize = 11;
/// The standard deviation of a window's Gaussian, pixels.
const DEVIATION: f64 = 1.5;
/// C₁ = (K₁·range)² avoids a division by 0 in dark windows, C₂ = (K₂·range)² in flat windows.
const K1: f64 = 0.01;
const K2: f64 = 0.03;

/// Mean structural similarity of images `[…, H, W, C]`: at most 1, and 1 for equal images (Wang et al. 2004,
/// *Image Quality Assessment: From Error Visibility to Structural Similarity*, Eq. 13).
///
/// It is the mean of
///
/// (2·μₓ·μᵧ + C₁)·(2·σₓᵧ + C₂) / ((μₓ² + μᵧ² + C₁)·(σₓ² + σᵧ² + C₂))
///
/// over all channels and all windows of 11 × 11 pixels that lie inside of the image. Pixels are weighted by a
/// Gaussian with a standard deviation of 1.5 pixels. Along an axis of fewer than 11 pixels the window is as
/// long as the axis.
///
/// `range` is the difference between the smallest and the largest distinguished value, 1 for images in [0, 1].
/// Reduce radiance far above `range` first: variances are differences of means of squares, and f32 has no
/// digits left for them. Noise lowers the similarity; two renders do not correct this bias.
///
/// ```
/// use softray::loss;
/// use softray::prelude::*;
/// let image = Tensor::<3>::ones([16, 16, 3], &Device::flex());
/// let similarity = loss::ssim(image.clone(), image.clone() * 0.5, 1.0)?;
/// assert!((similarity.into_scalar::<f32>() - 0.8).abs() < 1e-2);
/// assert!(loss::dssim(image.clone(), image, 1.0)?.into_scalar::<f32>() < 1e-2);
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// If the shapes or the float types differ, an axis has length 0, or `range` is not a finite number > 0.
pub fn ssim<const D: usize>(image: Tensor<D>, target: Tensor<D>, range: f64) -> Result<Tensor<1>> {
    check_pair("ssim", &image, &target)?;
    Error::unless_positive("ssim", "range", range)?;
    let (image, target) = (batch(image), batch(target));
    let [c1, c2] = [K1, K2].map(|k| (k * range).powi(2));
    let square = |t: &Tensor<4>| t.clone() * t.clone();
    let (mean_x, mean_y) = (blurred(image.clone()), blurred(target.clone()));
    let product = mean_x.clone() * mean_y.clone();
    let squares = square(&mean_x) + square(&mean_y);
    // Rounding must not let the denominator cross 0.
    let variances = blurred(square(&image) + square(&target)) - squares.clone();
    let variances = variances.clamp_min(0.0);
    let covariance = blurred(image * target) - product.clone();
    let above = (product * 2.0 + c1) * (covariance * 2.0 + c2);
    let below = (squares + c1) * (variances + c2);
    Ok((above / below).mean())
}

/// Structural dissimilarity (1 − [`ssim`])/2: a loss from 0, for equal images, to 1.
///
/// [`ssim`] has an example.
///
/// # Errors
/// Like [`ssim`].
pub fn dssim<const D: usize>(image: Tensor<D>, target: Tensor<D>, range: f64) -> Result<Tensor<1>> {
    Ok((ssim(image, target, range)? - 1.0) * -0.5)
}

/// Returns weighted means over the windows of `[B, H, W, C]`: `[B, H − h + 1, W − w + 1, C]` for windows of h × w.
/// The Gaussian is the product of a Gaussian along each axis.
fn blurred(image: Tensor<4>) -> Tensor<4> {
    along(along(image, 1), 2)
}

/// Returns weighted means along an axis.
fn along(image: Tensor<4>, axis: usize) -> Tensor<4> {
    let length = image.dims()[axis];
    let weights = gaussian(length.min(WINDOW));
    let windows = length + 1 - weights.len();
    let part = |i: usize| image.clone().narrow(axis, i, windows) * weights[i];
    (1..weights.len()).fold(part(0), |sum, i| sum + part(i))
}

/// Returns the weights of a window of `length` pixels; their sum is 1.
fn gaussian(length: usize) -> Vec<f64> {
    let middle = 0.5 * (length as f64 - 1.0);
    let weight = |i: usize| (-0.5 * ((i as f64 - middle) / DEVIATION).powi(2)).exp();
    let sum: f64 = (0..length).map(weight).sum();
    (0..length).map(|i| weight(i) / sum).collect()
}
