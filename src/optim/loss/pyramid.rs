//! Losses at several resolutions. Coarse levels have gradients over larger distances and average the noise.

use burn::tensor::Tensor;

use super::{batch, mse_unbiased, same_shape};

/// Returns the image `[…, H, W, C]` and its successive halves, `[…, ⌈H/2⌉, ⌈W/2⌉, C]` and so on.
///
/// It returns at most `levels` images (0 counts as 1), and fewer if a level reaches a single pixel. A pixel is
/// the mean of the 2 × 2 pixels of the previous level. If a size is odd, the last row or column counts twice, so
/// its pixels are means of existing pixels.
pub fn pyramid<const D: usize>(image: Tensor<D>, levels: usize) -> Vec<Tensor<D>> {
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
/// let at = |x: usize| loss::multi_scale(spot(x), spot(8), 5, loss::mse).into_scalar::<f32>();
/// assert!(at(15) > at(11) && at(11) > at(9) && at(9) > at(8));
/// ```
///
/// # Panics
/// If the shapes differ.
pub fn multi_scale<const D: usize>(
    image: Tensor<D>,
    target: Tensor<D>,
    levels: usize,
    loss: impl Fn(Tensor<D>, Tensor<D>) -> Tensor<1>,
) -> Tensor<1> {
    same_shape(&image, &target);
    let targets = pyramid(target, levels);
    let images = pyramid(image, levels);
    mean(images.into_iter().zip(targets).map(|(i, t)| loss(i, t)))
}

/// The mean of [`mse_unbiased`] over the levels of the [`pyramid`]s of two renders with independent seeds and
/// the target, `[…, H, W, C]` each.
///
/// The halves are linear in the image, so noise biases no level.
///
/// # Panics
/// If the shapes differ.
pub fn multi_scale_unbiased<const D: usize>(
    a: Tensor<D>,
    b: Tensor<D>,
    target: Tensor<D>,
    levels: usize,
) -> Tensor<1> {
    same_shape(&a, &target);
    same_shape(&b, &target);
    let pairs = pyramid(a, levels).into_iter().zip(pyramid(b, levels));
    let targets = pyramid(target, levels);
    mean(pairs.zip(targets).map(|((a, b), t)| mse_unbiased(a, b, t)))
}

/// The mean of scalars.
fn mean(losses: impl Iterator<Item = Tensor<1>>) -> Tensor<1> {
    Tensor::cat(losses.collect(), 0).mean()
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
