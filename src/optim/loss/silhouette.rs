//! Losses of the overlap of silhouettes.

use burn::tensor::Tensor;

use super::same_shape;
use crate::error::{Error, Result};
use crate::geometry::host_values;

/// Unions of less than this, in pixels, count as this: the loss goes to 0 as both become empty.
const LEAST_UNION: f64 = 1e-3;

/// 1 − Σab / Σ(a + b − ab) of opacities `[H, W]` from 0 to 1: 0 where they are alike and 0 or 1
/// everywhere, 1 where they have nothing in common (Liu et al. 2019, *Soft Rasterizer*).
///
/// Both sums are linear in the opacity, so noise hardly biases their ratio. If both are empty the
/// loss is 0 and its gradient finite. While nothing overlaps, the gradient is 0 outside of the target:
/// take it with wide blur, or with another loss beside it.
///
/// # Panics
/// If the shapes differ.
pub fn silhouette_iou(opacity: Tensor<2>, target: Tensor<2>) -> Tensor<1> {
    silhouette_iou_batch(opacity.unsqueeze(), target.unsqueeze())
}

/// The mean of [`silhouette_iou`] over a batch of opacities `[B, H, W]`.
///
/// # Panics
/// If the shapes differ.
pub fn silhouette_iou_batch(opacity: Tensor<3>, target: Tensor<3>) -> Tensor<1> {
    same_shape(&opacity, &target);
    let sums = |t: Tensor<3>| t.flatten::<2>(1, 2).sum_dim(1);
    let both = sums(opacity.clone() * target.clone());
    let union = sums(opacity + target) - both.clone();
    ((union.clone() - both) / union.clamp_min(LEAST_UNION)).mean()
}

/// Intersection over union of the pixels whose opacity is above a threshold, on the host: 1 where
/// they are the same, or none on either side.
///
/// # Errors
/// If the shapes differ, the threshold is NaN, or a tensor can't be read.
pub fn iou(opacity: &Tensor<2>, target: &Tensor<2>, threshold: f64) -> Result<f64> {
    let (found, expected) = (opacity.dims(), target.dims());
    let (shape, like) = (
        format!("{found:?}"),
        format!("{expected:?} like the target"),
    );
    Error::unless(found == expected, "opacity", "shape", shape, &like)?;
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
