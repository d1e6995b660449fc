//! Losses for the overlap of silhouettes.

use burn::tensor::Tensor;

use super::check_pair;
use crate::error::{Error, Result};
use crate::geometry::host_values;

/// The least union in the denominator, in pixels, so that the loss goes to 0 as both silhouettes become empty.
const MIN_UNION: f64 = 1e-3;

/// Soft intersection-over-union loss: 1 − Σab / Σ(a + b − ab) of opacities `[H, W]` from 0 to 1 (Liu et al.
/// 2019, *Soft Rasterizer*). Of `[…, H, W]` it is the mean over all images.
///
/// The loss is 0 where the silhouettes are equal and every opacity is 0 or 1. It is 1 where they do not
/// overlap. Both sums are linear in the opacity, so noise hardly biases their ratio. If both silhouettes are
/// empty, the loss is 0 and its gradient is finite. While the silhouettes do not overlap, the gradient is 0
/// outside of the target; combine the loss with a wide blur or with another loss.
///
/// ```
/// use softray::loss;
/// use softray::prelude::*;
/// let row = |opacity: [f32; 4]| Tensor::<2>::from_floats([opacity], &Device::flex());
/// let (a, b) = (row([1.0, 1.0, 0.0, 0.0]), row([0.0, 1.0, 1.0, 0.0]));
/// assert_eq!(loss::iou(&a, &b, 0.5)?, 1.0 / 3.0);
/// assert!((loss::silhouette_iou(a, b)?.into_scalar::<f32>() - 2.0 / 3.0).abs() < 1e-5);
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// If the shapes or the float types differ, or an axis has length 0.
pub fn silhouette_iou<const D: usize>(opacity: Tensor<D>, target: Tensor<D>) -> Result<Tensor<1>> {
    const { assert!(D >= 2, "opacities have the axes […, H, W]") };
    check_pair("silhouette_iou", &opacity, &target)?;
    let dims = opacity.dims();
    let pixels = dims[D - 2] * dims[D - 1];
    let count = dims[..D - 2].iter().product::<usize>();
    let sums = |t: Tensor<D>| t.reshape([count, pixels]).sum_dim(1);
    let both = sums(opacity.clone() * target.clone());
    let union = sums(opacity + target) - both.clone();
    Ok(((union.clone() - both) / union.clamp_min(MIN_UNION)).mean())
}

/// Returns the intersection over union of the pixels whose opacity is above a threshold, computed on the host.
/// It is 1 if both sets of pixels are equal, including both empty.
///
/// [`silhouette_iou`] has an example.
///
/// # Errors
/// Like [`silhouette_iou`], or if the threshold is NaN, or a tensor cannot be read.
pub fn iou(opacity: &Tensor<2>, target: &Tensor<2>, threshold: f64) -> Result<f64> {
    check_pair("iou", opacity, target)?;
    Error::unless(
        !threshold.is_nan(),
        "iou",
        "threshold",
        threshold,
        "a number",
    )?;
    let (a, b) = (host_values(opacity)?, host_values(target)?);
    let covered = a.iter().zip(&b);
    let covered = covered.map(|(&a, &b)| (a > threshold, b > threshold));
    let (mut both, mut either) = (0_usize, 0_usize);
    for (a, b) in covered {
        both += usize::from(a && b);
        either += usize::from(a || b);
    }
    Ok(match either {
        0 => 1.0,
        _ => both as f64 / either as f64,
    })
}
