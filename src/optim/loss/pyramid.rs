//! Losses at several resolutions: coarse ones see from further away and average the noise.

use burn::tensor::Tensor;

use super::{mse_unbiased, same_shape};

/// The image `[H, W, C]` and its halves, `[⌈H/2⌉, ⌈W/2⌉, C]` and so on: at most `levels` images
/// (0 counts as 1), fewer where one of a single pixel comes first.
///
/// A pixel is the mean of the 2 × 2 below it. Of odd sizes the last row or column is halved alone:
/// its pixels are means of those that there are, as if it were repeated.
pub fn pyramid(image: Tensor<3>, levels: usize) -> Vec<Tensor<3>> {
    let mut images = vec![image];
    while let Some(last) = images.last()
        && images.len() < levels
        && let [height, width, _] = last.dims()
        && height.max(width) > 1
    {
        images.push(halved(last.clone()));
    }
    images
}

/// The mean of a loss over the levels of the [`pyramid`]s of image and target `[H, W, C]`.
///
/// A shape that does not overlap its target gets a gradient towards it from the levels where it
/// does.
///
/// ```
/// use softray::loss;
/// use softray::prelude::*;
/// let device = Device::flex();
/// let spot = |x: usize| {
///     let row: [f32; 16] = std::array::from_fn(|i| f32::from(u8::from(i == x)));
///     Tensor::<1>::from_floats(row, &device).reshape([1, 16, 1])
/// };
/// let at = |x: usize| loss::multi_scale(spot(x), spot(8), 5, loss::mse).into_scalar::<f32>();
/// assert!(at(15) > at(11) && at(11) > at(9) && at(9) > at(8));
/// ```
///
/// # Panics
/// If the shapes differ.
pub fn multi_scale(
    image: Tensor<3>,
    target: Tensor<3>,
    levels: usize,
    loss: impl Fn(Tensor<3>, Tensor<3>) -> Tensor<1>,
) -> Tensor<1> {
    same_shape(&image, &target);
    let targets = pyramid(target, levels);
    let images = pyramid(image, levels);
    mean(images.into_iter().zip(targets).map(|(i, t)| loss(i, t)))
}

/// The mean of [`mse_unbiased`] over the levels of the [`pyramid`]s of two renders with independent
/// seeds and the target, `[H, W, C]` each. The halves are linear in the image, so no level is
/// biased by noise.
///
/// # Panics
/// If the shapes differ.
pub fn multi_scale_unbiased(
    a: Tensor<3>,
    b: Tensor<3>,
    target: Tensor<3>,
    levels: usize,
) -> Tensor<1> {
    same_shape(&a, &target);
    same_shape(&b, &target);
    let pairs = pyramid(a, levels).into_iter().zip(pyramid(b, levels));
    let targets = pyramid(target, levels);
    mean(pairs.zip(targets).map(|((a, b), t)| mse_unbiased(a, b, t)))
}

/// The mean of scalars.
pub(crate) fn mean(losses: impl Iterator<Item = Tensor<1>>) -> Tensor<1> {
    Tensor::cat(losses.collect(), 0).mean()
}

/// `[⌈H/2⌉, ⌈W/2⌉, C]` of `[H, W, C]`.
fn halved(image: Tensor<3>) -> Tensor<3> {
    let image = even(even(image, 0), 1);
    let [height, width, channels] = image.dims();
    let (rows, columns) = (height / 2, width / 2);
    let pairs_of_rows = image.reshape([rows, 2, width * channels]).sum_dim(1);
    let pairs = pairs_of_rows.reshape([rows * columns, 2, channels]);
    pairs.sum_dim(1).reshape([rows, columns, channels]) * 0.25
}

/// The last row or column twice where their number is odd.
fn even(image: Tensor<3>, axis: usize) -> Tensor<3> {
    let length = image.dims()[axis];
    if length.is_multiple_of(2) {
        return image;
    }
    let last = image.clone().narrow(axis, length - 1, 1);
    Tensor::cat(vec![image, last], axis)
}
