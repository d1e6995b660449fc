//! Differentiable losses between images and between point clouds. Losses are scalars `[1]`.
//!
//! Images are `[…, H, W, C]` in linear radiance, with any number of leading axes, such as the views of a batch. Silhouettes
//! are `[…, H, W]` of opacities from 0 to 1. Point clouds are `[N, 3]` in scene units. A target may be on a device without
//! autodiff.

mod points;
mod pyramid;
mod silhouette;
mod structure;

use burn::tensor::Tensor;

pub use points::{chamfer, f_score};
pub use pyramid::{multi_scale, multi_scale_unbiased, pyramid};
pub use silhouette::{iou, silhouette_iou};
pub use structure::{dssim, ssim};

/// Mean squared difference of tensors of any equal shapes, such as `[H, W, C]` or `[B, H, W, C]`.
///
/// For one noisy render its expectation is too large by the variance of the noise, and its gradient is biased
/// by the gradient of that variance. [`mse_unbiased`] has no such bias.
///
/// # Panics
/// If the shapes differ.
pub fn mse<const D: usize>(image: Tensor<D>, target: Tensor<D>) -> Tensor<1> {
    same_shape(&image, &target);
    let difference = image - target;
    (difference.clone() * difference).mean()
}

/// Mean of (a − target)·(b − target) for two renders with independent seeds: [`mse`] without bias by noise. The shapes
/// are equal, such as `[H, W, C]` or `[B, H, W, C]`.
///
/// Its expectation is [`mse`] of the *converged* image, and its gradient is unbiased too, because the noise of
/// the two renders is independent. The value may be negative.
///
/// # Panics
/// If the shapes differ.
pub fn mse_unbiased<const D: usize>(a: Tensor<D>, b: Tensor<D>, target: Tensor<D>) -> Tensor<1> {
    same_shape(&a, &target);
    same_shape(&b, &target);
    ((a - target.clone()) * (b - target)).mean()
}

/// Mean absolute difference of tensors of any equal shapes, such as `[H, W, C]` or `[B, H, W, C]`.
///
/// Outliers have less weight than in [`mse`]. The gradient is 0 where values are equal. Where the noise is
/// wider than the difference, the loss is too large; two renders do not correct this bias.
///
/// # Panics
/// If the shapes differ.
pub fn l1<const D: usize>(image: Tensor<D>, target: Tensor<D>) -> Tensor<1> {
    same_shape(&image, &target);
    (image - target).abs().mean()
}

/// Returns images `[…, H, W, C]` as `[B, H, W, C]`.
///
/// # Panics
/// If there are fewer than three axes.
fn batch<const D: usize>(images: Tensor<D>) -> Tensor<4> {
    const { assert!(D >= 3, "images have the axes […, H, W, C]") };
    let dims = images.dims();
    let [h, w, c] = [dims[D - 3], dims[D - 2], dims[D - 1]];
    let count = dims[..D - 3].iter().product::<usize>();
    images.reshape([count, h, w, c])
}

/// Checked here because burn would broadcast an axis of length 1.
fn same_shape<const D: usize>(image: &Tensor<D>, target: &Tensor<D>) {
    let (found, expected) = (image.dims(), target.dims());
    assert!(
        found == expected,
        "loss: image and target differ in shape: {found:?}, expected {expected:?}"
    );
}
