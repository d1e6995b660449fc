//! Losses at several resolutions. Coarse levels have gradients over larger distances and average the noise.

use burn::tensor::Tensor;

use super::{batch, check_pair, check_size, mse_unbiased};
use crate::error::{Error, Result};

/// Returns the image `[…, H, W, C]` and its successive halves, `[…, ⌈H/2⌉, ⌈W/2⌉, C]` and so on.
///
/// It returns at most `levels` images, and fewer if a level reaches a single pixel. A pixel is the mean of the
/// 2 × 2 pixels of the previous level. If a size is odd, the last row or column counts twice, so its pixels are
/// means of existing pixels.
///
/// [`multi_scale`] has an example.
///
/// # Errors
/// If `levels` is 0, or an axis has length 0.
pub fn pyramid<const D: usize>(image: Tensor<D>, levels: usize) -> Result<Vec<Tensor<D>>> {
    check_size("pyramid", &image)?;
    check_levels("pyramid", levels)?;
    Ok(halves(image, levels))
}

/// Checks the number of levels of a pyramid.
pub(crate) fn check_levels(object: &str, levels: usize) -> Result<()> {
    Error::unless(levels > 0, object, "levels", levels, "at least 1")
}

/// Returns the levels of a [`pyramid`].
pub(crate) fn halves<const D: usize>(image: Tensor<D>, levels: usize) -> Vec<Tensor<D>> {
    const { assert!(D >= 3, "images have the axes […, H, W, C]") };
    let mut images = vec![image];
    while let Some(last) = images.last()
        && images.len() < levels
        && last.dims()[D - 3].max(last.dims()[D - 2]) > 1
    {
        images.push(halved(last.clone()));
    }
    images
}

/// The mean of a loss over the levels of the [`pyramid`]s of image and target `[…, H, W, C]`.
///
/// A shape that does not overlap its target gets a gradient towards the target from the levels at which it does
/// overlap.
///
/// ```
/// use softray::loss;
/// use softray::prelude::*;
/// let device = Device::flex();
/// let spot = |x: usize| {
///     let row: [f32; 16] = std::array::from_fn(|i| f32::from(u8::from(i == x)));
///     Tensor::<1>::from_floats(row, &device).reshape([1, 16, 1])
/// };
/// let mut before = f32::INFINITY;
/// for x in [15, 11, 9, 8] {
///     let loss = loss::multi_scale(spot(x), spot(8), 5, loss::mse)?.into_scalar::<f32>();
///     assert!(loss < before);
///     before = loss;
/// }
/// assert_eq!(loss::pyramid(spot(8), 5)?[1].dims(), [1, 8, 1]);
/// let unbiased = loss::multi_scale_unbiased(spot(9), spot(9), spot(8), 5)?;
/// assert!(unbiased.into_scalar::<f32>() > 0.0);
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// If the shapes or the float types differ, an axis has length 0, or `levels` is 0; and those of the loss.
pub fn multi_scale<const D: usize>(
    image: Tensor<D>,
    target: Tensor<D>,
    levels: usize,
    loss: impl Fn(Tensor<D>, Tensor<D>) -> Result<Tensor<1>>,
) -> Result<Tensor<1>> {
    check_pair("multi_scale", &image, &target)?;
    check_levels("multi_scale", levels)?;
    let targets = halves(target, levels);
    let images = halves(image, levels);
    mean(images.into_iter().zip(targets).map(|(i, t)| loss(i, t)))
}

/// The mean of [`mse_unbiased`] over the levels of the [`pyramid`]s of two renders with independent seeds and
/// the target, `[…, H, W, C]` each.
///
/// The halves are linear in the image, so noise biases no level.
///
/// [`multi_scale`] has an example.
///
/// # Errors
/// If the shapes or the float types differ, an axis has length 0, or `levels` is 0.
pub fn multi_scale_unbiased<const D: usize>(
    a: Tensor<D>,
    b: Tensor<D>,
    target: Tensor<D>,
    levels: usize,
) -> Result<Tensor<1>> {
    check_pair("multi_scale_unbiased", &a, &target)?;
    check_pair("multi_scale_unbiased", &b, &target)?;
    check_levels("multi_scale_unbiased", levels)?;
    let pairs = halves(a, levels).into_iter().zip(halves(b, levels));
    let targets = halves(target, levels);
    mean(pairs.zip(targets).map(|((a, b), t)| mse_unbiased(a, b, t)))
}

/// The mean of scalars.
fn mean(losses: impl Iterator<Item = Result<Tensor<1>>>) -> Result<Tensor<1>> {
    Ok(Tensor::cat(losses.collect::<Result<_>>()?, 0).mean())
}

/// `[…, ⌈H/2⌉, ⌈W/2⌉, C]` of `[…, H, W, C]`.
fn halved<const D: usize>(images: Tensor<D>) -> Tensor<D> {
    let mut dims = images.dims();
    let images = even(even(batch(images), 1), 2);
    let [count, height, width, channels] = images.dims();
    let (rows, columns) = (height / 2, width / 2);
    let pairs_of_rows = images
        .reshape([count * rows, 2, width * channels])
        .sum_dim(1);
    let pairs = pairs_of_rows.reshape([count * rows * columns, 2, channels]);
    (dims[D - 3], dims[D - 2]) = (rows, columns);
    pairs.sum_dim(1).reshape(dims) * 0.25
}

/// Repeats the last row or column if their number is odd.
fn even(image: Tensor<4>, axis: usize) -> Tensor<4> {
    let length = image.dims()[axis];
    if length.is_multiple_of(2) {
        return image;
    }
    let last = image.clone().narrow(axis, length - 1, 1);
    Tensor::cat(vec![image, last], axis)
}
