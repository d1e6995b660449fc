//! Differentiable losses between images and between point clouds, and penalties on textures and grids. Losses are scalars
//! `[1]`.
//!
//! Images are `[…, H, W, C]` in linear radiance, with any number of leading axes, such as the views of a batch. Silhouettes
//! are `[…, H, W]` of opacities from 0 to 1. Point clouds are `[N, 3]` in scene units. A target may be on a device without
//! autodiff.
//!
//! All losses return a [`Result`]: tensors whose shapes or float types differ, that are empty, or settings out of
//! their range are errors.

mod grids;
#[cfg(all(feature = "photographs", not(target_family = "wasm")))]
mod photographs;
mod points;
mod pyramid;
mod silhouette;
mod structure;

use burn::tensor::Tensor;

use crate::error::{Error, Result};

pub use grids::{bending, eikonal};
#[cfg(all(feature = "photographs", not(target_family = "wasm")))]
pub use photographs::{PhotographErrors, PhotographLoss};
pub use points::{chamfer, f_score};
pub(crate) use pyramid::check_levels;
#[cfg(feature = "fit")]
pub(crate) use pyramid::halves;
pub use pyramid::{multi_scale, multi_scale_unbiased, pyramid};
pub use silhouette::{iou, silhouette_iou};
pub use structure::{dssim, ssim};

/// Mean squared difference of tensors of any equal shapes, such as `[H, W, C]` or `[B, H, W, C]`.
///
/// For one noisy render its expectation is too large by the variance of the noise, and its gradient is biased
/// by the gradient of that variance. [`mse_unbiased`] has no such bias.
///
/// [`multi_scale`] has an example.
///
/// # Errors
/// If the shapes or the float types differ, or an axis has length 0.
pub fn mse<const D: usize>(image: Tensor<D>, target: Tensor<D>) -> Result<Tensor<1>> {
    check_pair("mse", &image, &target)?;
    let difference = image - target;
    Ok((difference.clone() * difference).mean())
}

/// Mean of (a − target)·(b − target) for two renders with independent seeds: [`mse`] without bias by noise. The shapes
/// are equal, such as `[H, W, C]` or `[B, H, W, C]`.
///
/// Its expectation is [`mse`] of the *converged* image, and its gradient is unbiased too, because the noise of
/// the two renders is independent. The value may be negative.
///
/// ```
/// use softray::loss;
/// use softray::prelude::*;
/// let (room, camera) = cornell_box(&Device::flex());
/// let options = RenderOptions::new(8, 8).with_samples(4);
/// let a = render(&room, &camera, &options.clone().with_seed(1))?.radiance;
/// let b = render(&room, &camera, &options.with_seed(2))?.radiance;
/// let target = a.zeros_like();
/// assert!(loss::mse_unbiased(a, b, target)?.into_scalar::<f32>() > 0.0);
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// Like [`mse`].
pub fn mse_unbiased<const D: usize>(
    a: Tensor<D>,
    b: Tensor<D>,
    target: Tensor<D>,
) -> Result<Tensor<1>> {
    check_pair("mse_unbiased", &a, &target)?;
    check_pair("mse_unbiased", &b, &target)?;
    Ok(((a - target.clone()) * (b - target)).mean())
}

/// Mean absolute difference of tensors of any equal shapes, such as `[H, W, C]` or `[B, H, W, C]`.
///
/// Outliers have less weight than in [`mse`]. The gradient is 0 where values are equal. Where the noise is
/// wider than the difference, the loss is too large; two renders do not correct this bias.
///
/// ```
/// use softray::loss;
/// use softray::prelude::*;
/// let image = Tensor::<3>::ones([4, 4, 3], &Device::flex());
/// assert_eq!(loss::l1(image.clone() * 3.0, image)?.into_scalar::<f32>(), 2.0);
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// Like [`mse`].
pub fn l1<const D: usize>(image: Tensor<D>, target: Tensor<D>) -> Result<Tensor<1>> {
    check_pair("l1", &image, &target)?;
    Ok((image - target).abs().mean())
}

/// Mean squared difference of neighbors along both axes of a map `[H, W, C]`, the sum over both axes: a regularizer of
/// textures, normal maps, or logarithms of environment maps. It is 0 for a map of one texel.
///
/// ```
/// use softray::loss;
/// use softray::prelude::*;
/// let map = Tensor::<3>::from_floats([[[0.0], [2.0]], [[0.0], [2.0]]], &Device::flex());
/// assert_eq!(loss::smoothness(map)?.into_scalar::<f32>(), 4.0);
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// If an axis has length 0.
pub fn smoothness(map: Tensor<3>) -> Result<Tensor<1>> {
    check_size("smoothness", &map)?;
    let along = |axis: usize| {
        let length = map.dims()[axis] - 1;
        if length == 0 {
            return Tensor::zeros([1], (&map.device(), map.dtype()));
        }
        let step = map.clone().narrow(axis, 1, length) - map.clone().narrow(axis, 0, length);
        step.powi_scalar(2).mean()
    };
    Ok(along(0) + along(1))
}

/// Returns images `[…, H, W, C]` as `[B, H, W, C]`. Fewer than three axes do not compile.
fn batch<const D: usize>(images: Tensor<D>) -> Tensor<4> {
    const { assert!(D >= 3, "images have the axes […, H, W, C]") };
    let dims = images.dims();
    let [h, w, c] = [dims[D - 3], dims[D - 2], dims[D - 1]];
    let count = dims[..D - 3].iter().product::<usize>();
    images.reshape([count, h, w, c])
}

/// Checks that two tensors have the same shape and float type, and that no axis has length 0. burn would broadcast
/// an axis of length 1, and return NaN as the mean of nothing.
pub(crate) fn check_pair<const D: usize>(
    loss: &str,
    image: &Tensor<D>,
    target: &Tensor<D>,
) -> Result<()> {
    check_size(loss, image)?;
    let [found, expected] = [image, target].map(|t| format!("{:?}", t.dims()));
    let like = format!("{expected} like the target");
    Error::unless(found == expected, loss, "shape", found, &like)?;
    let [found, expected] = [image, target].map(|t| format!("{:?}", t.dtype()));
    let like = format!("{expected} like the target");
    Error::unless(found == expected, loss, "dtype", found, &like)
}

/// Checks that a tensor is not empty.
fn check_size<const D: usize>(loss: &str, image: &Tensor<D>) -> Result<()> {
    let dims = image.dims();
    let expected = "at least 1 along every axis";
    let found = format!("{dims:?}");
    Error::unless(!dims.contains(&0), loss, "shape", found, expected)
}
