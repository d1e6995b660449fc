//! Losses between images and between point clouds, in the graph; all return a scalar `[1]`.
//!
//! Images are `[H, W, C]` in linear radiance, silhouettes `[H, W]` of opacities from 0 to 1, point clouds
//! `[N, 3]` in scene units. A target may be off autodiff.

mod points;
mod pyramid;
mod silhouette;
mod structure;

use burn::tensor::Tensor;

pub use points::{chamfer, f_score};
pub(crate) use pyramid::mean;
pub use pyramid::{multi_scale, multi_scale_unbiased, pyramid};
pub use silhouette::{iou, silhouette_iou, silhouette_iou_batch};
pub use structure::{dssim, ssim};

/// Mean squared difference. Of one noisy render its expectation is too large by the variance of
/// the noise, and its gradient is off by the gradient of that variance: see [`mse_unbiased`].
///
/// # Panics
/// If the shapes differ.
pub fn mse(image: Tensor<3>, target: Tensor<3>) -> Tensor<1> {
    same_shape(&image, &target);
    let difference = image - target;
    (difference.clone() * difference).mean()
}

/// Mean of (a − target)·(b − target) of two renders with independent seeds. Its expectation is the
/// squared difference of the *converged* image, and its gradient that of it: the noise of one
/// does not meet itself. It may be negative.
///
/// # Panics
/// If the shapes differ.
pub fn mse_unbiased(a: Tensor<3>, b: Tensor<3>, target: Tensor<3>) -> Tensor<1> {
    same_shape(&a, &target);
    same_shape(&b, &target);
    ((a - target.clone()) * (b - target)).mean()
}

/// Mean absolute difference. Outliers pull less than in [`mse`]; where values are equal the
/// gradient is 0. Noise makes it too large where it is wider than the difference, and two renders
/// don't mend that.
///
/// # Panics
/// If the shapes differ.
pub fn l1(image: Tensor<3>, target: Tensor<3>) -> Tensor<1> {
    same_shape(&image, &target);
    (image - target).abs().mean()
}

/// Burn would broadcast an axis of length 1.
fn same_shape<const D: usize>(image: &Tensor<D>, target: &Tensor<D>) {
    let (found, expected) = (image.dims(), target.dims());
    assert!(
        found == expected,
        "loss: image and target differ in shape: {found:?}, expected {expected:?}"
    );
}
