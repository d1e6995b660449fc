//! Measures of how well images agree, for reports: they are numbers, and have no gradients. For losses see
//! [`loss`].
//!
//! ```
//! use softray::optim::metrics::{self, View};
//! use softray::prelude::*;
//! let target = HostImage::new(2, 1, vec![0.5; 6])?;
//! let image = HostImage::new(2, 1, vec![0.4; 6])?;
//! let views = [View::new(&image, &target, &[true, false])?];
//! assert!((metrics::psnr_linear(&views)? - 20.0).abs() < 1e-3);
//! assert!((metrics::channel_scales(&views)?[0] - 1.25).abs() < 1e-6);
//! # Ok::<(), softray::Error>(())
//! ```

use burn::tensor::{Device, Tensor, TensorData};

use super::loss;
use crate::error::{Error, Result};
use crate::io::{HostImage, linear_to_srgb};

/// An image of a held-out view, its target, and the pixels that count.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    image: &'a HostImage,
    target: &'a HostImage,
    mask: &'a [bool],
    /// The bounding box of the mask: rows from and to, columns from and to.
    bounds: [usize; 4],
}

impl<'a> View<'a> {
    /// Compares two linear images of the same size. `mask` has a value for each pixel, row by row, true for the object.
    ///
    /// # Errors
    /// If the sizes differ, or the mask has no pixel that is true.
    pub fn new(image: &'a HostImage, target: &'a HostImage, mask: &'a [bool]) -> Result<Self> {
        let [width, height] = [image.width, image.height];
        let expected = format!("{} × {} like the target", target.width, target.height);
        let same = [width, height] == [target.width, target.height];
        let size = format!("{width} × {height}");
        Error::unless(same, "image", "size", size, &expected)?;
        let count = width.saturating_mul(height);
        for (name, pixels) in [("image", &image.pixels), ("target", &target.pixels)] {
            let valid = Some(pixels.len()) == count.checked_mul(3);
            let expected = format!("{width} · {height} · 3");
            Error::unless(valid, name, "number of values", pixels.len(), &expected)?;
        }
        let expected = format!("{width} · {height}");
        let valid = mask.len() == count;
        Error::unless(valid, "mask", "number of pixels", mask.len(), &expected)?;
        let mut bounds = [usize::MAX, 0, usize::MAX, 0];
        for (i, _) in mask.iter().enumerate().filter(|(_, inside)| **inside) {
            let (row, column) = (i / width, i % width);
            bounds[0] = bounds[0].min(row);
            bounds[1] = row + 1;
            bounds[2] = bounds[2].min(column);
            bounds[3] = bounds[3].max(column + 1);
        }
        let expected = "at least one that is true";
        Error::unless(bounds[1] > 0, "mask", "pixels", "all false", expected)?;
        Ok(Self {
            image,
            target,
            mask,
            bounds,
        })
    }

    /// The values of both images inside of the mask, with their channels.
    fn inside(&self) -> impl Iterator<Item = (usize, f64, f64)> {
        let pixels = self.mask.iter().enumerate().filter(|(_, inside)| **inside);
        pixels.flat_map(move |(i, _)| (0..3).map(move |c| self.values(3 * i + c, c)))
    }

    /// The values of both images in the bounding box of the mask, as sRGB from 0 to 1.
    fn encoded(&self) -> impl Iterator<Item = (f64, f64)> {
        let [top, bottom, left, right] = self.bounds;
        let pixels = (top..bottom).flat_map(move |row| (left..right).map(move |x| (row, x)));
        let values = pixels.flat_map(move |(row, x)| {
            let at = 3 * (row * self.image.width + x);
            at..at + 3
        });
        let encoded = |v: f32| f64::from(linear_to_srgb(v));
        values.map(move |i| {
            (
                encoded(self.image.pixels[i]),
                encoded(self.target.pixels[i]),
            )
        })
    }

    fn values(&self, i: usize, channel: usize) -> (usize, f64, f64) {
        let of = |image: &HostImage| f64::from(image.pixels[i]);
        (channel, of(self.image), of(self.target))
    }
}

/// The peak signal-to-noise ratio of sRGB values in dB, for a peak of 1: −10 log₁₀ of the mean squared difference over all
/// pixels of the masks' bounding boxes in all views together. Values are clipped to [0, 1] and not rounded. It is infinite
/// for equal images, and NaN if a value is.
///
/// # Errors
/// If there is no view.
pub fn psnr_srgb(views: &[View]) -> Result<f64> {
    psnr(views, views.iter().flat_map(View::encoded))
}

/// The peak signal-to-noise ratio of linear values in dB, for a peak of 1, over all pixels inside of the masks in all views
/// together. Values are not clipped. It is infinite for equal images, and NaN if a value is.
///
/// # Errors
/// If there is no view.
pub fn psnr_linear(views: &[View]) -> Result<f64> {
    let inside = views.iter().flat_map(View::inside);
    psnr(views, inside.map(|(_, value, target)| (value, target)))
}

/// The mean over views of the structural similarity ([`loss::ssim`], a Gaussian window of 11 × 11 pixels with σ = 1.5, K₁ =
/// 0.01, K₂ = 0.03) of sRGB values in the masks' bounding boxes. It is computed on `device`.
///
/// # Errors
/// If there is no view, or the device fails.
pub fn ssim_srgb(views: &[View], device: &Device) -> Result<f64> {
    check_any(views)?;
    let mut sum = 0.0;
    for view in views {
        let [top, bottom, left, right] = view.bounds;
        let (image, target): (Vec<f64>, Vec<f64>) = view.encoded().unzip();
        let [image, target] = [image, target].map(|values| {
            let data = TensorData::new(values, [bottom - top, right - left, 3]);
            Tensor::<3>::from_data(data, device)
        });
        let similarity = loss::ssim(image, target, 1.0)?;
        let data = similarity
            .inner()
            .try_into_data_as::<f32>()
            .map_err(Error::read)?;
        let values = data.try_into_vec::<f32>().map_err(Error::read)?;
        sum += values.first().copied().map_or(f64::NAN, f64::from);
    }
    Ok(sum / views.len() as f64)
}

/// The factors for the channels of the images with which they are nearest to their targets, by least squares over all
/// pixels inside of the masks in all views together. Albedos are known up to such a factor if the light is not known:
/// compare images scaled by it ([`scaled`]). A channel of an image that is 0 everywhere has a factor of 1.
///
/// # Errors
/// If there is no view.
pub fn channel_scales(views: &[View]) -> Result<[f64; 3]> {
    check_any(views)?;
    let mut sums = [[0.0; 2]; 3];
    for (c, value, target) in views.iter().flat_map(View::inside) {
        sums[c][0] += value * target;
        sums[c][1] += value * value;
    }
    Ok(sums.map(|[product, square]| if square == 0.0 { 1.0 } else { product / square }))
}

/// An image with its channels multiplied by factors.
pub fn scaled(image: &HostImage, scales: [f64; 3]) -> HostImage {
    let mut image = image.clone();
    for pixel in image.pixels.chunks_exact_mut(3) {
        for (value, scale) in pixel.iter_mut().zip(scales) {
            *value = (f64::from(*value) * scale) as f32;
        }
    }
    image
}

fn check_any(views: &[View]) -> Result<()> {
    Error::unless(!views.is_empty(), "metric", "views", 0, "at least one")
}

fn psnr(views: &[View], values: impl Iterator<Item = (f64, f64)>) -> Result<f64> {
    check_any(views)?;
    let (mut sum, mut count) = (0.0, 0u64);
    for (value, target) in values {
        sum += (value - target).powi(2);
        count += 1;
    }
    Ok(-10.0 * (sum / count as f64).log10())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An image of 16 × 14 pixels from a function of channel, column and row.
    fn image(value: impl Fn(usize, usize, usize) -> f32) -> HostImage {
        let values = (0..14 * 16 * 3).map(|i| value(i % 3, i / 3 % 16, i / 48));
        HostImage::new(16, 14, values.collect()).expect("an image")
    }

    fn mask(inside: impl Fn(usize, usize) -> bool) -> Vec<bool> {
        (0..14 * 16).map(|i| inside(i % 16, i / 16)).collect()
    }

    #[test]
    fn pixels_are_those_of_masks_and_boxes() {
        let target = image(|_, _, _| 0.5);
        // Two corners of a box of 3 × 2 pixels.
        let corners = mask(|x, y| (x, y) == (2, 5) || (x, y) == (4, 6));
        let wrong = image(|_, x, y| match (x, y) {
            (2, 5) => 0.6,
            (3, 5) => 1.0,
            _ if (2..5).contains(&x) && (5..7).contains(&y) => 0.5,
            _ => 9.0,
        });
        let view = View::new(&wrong, &target, &corners).expect("a view");
        let linear = psnr_linear(&[view]).expect("a number");
        assert!((linear + 10.0 * (0.01f64 / 2.0).log10()).abs() < 1e-4);
        let encoded = |v: f64| 1.055 * v.powf(1.0 / 2.4) - 0.055;
        let square = |v: f64| (encoded(v) - encoded(0.5)).powi(2);
        let expected = -10.0 * ((square(0.6) + square(1.0)) / 6.0).log10();
        let srgb = psnr_srgb(&[view]).expect("a number");
        assert!((srgb - expected).abs() < 1e-4, "{srgb} {expected}");
        // All pixels of all views count the same.
        let same = View::new(&target, &target, &corners).expect("a view");
        let both = psnr_linear(&[view, same]).expect("a number");
        assert!((both - linear - 10.0 * 2f64.log10()).abs() < 1e-4);
        assert_eq!(psnr_linear(&[same]).expect("a number"), f64::INFINITY);
    }

    #[test]
    fn scales_are_those_of_least_squares() {
        let target = image(|c, x, y| (1 + x + y) as f32 * [0.01, 0.02, 0.0][c]);
        let wrong = scaled(&target, [0.5, 4.0, 1.0]);
        let all = mask(|_, _| true);
        let views = [View::new(&wrong, &target, &all).expect("a view")];
        let scales = channel_scales(&views).expect("scales");
        let expected = [2.0, 0.25, 1.0];
        assert!(
            (0..3).all(|c| (scales[c] - expected[c]).abs() < 1e-6),
            "{scales:?}"
        );
        let right = scaled(&wrong, scales);
        let views = [View::new(&right, &target, &all).expect("a view")];
        assert!(psnr_linear(&views).expect("a number") > 120.0);
    }

    #[test]
    #[cfg(feature = "flex")]
    fn similarity_is_that_of_boxes() {
        let target = image(|c, x, y| 0.1 + 0.05 * ((x * 7 + y * 3 + c) % 11) as f32);
        let inside = |x: usize, y: usize| x >= 6 && y >= 1;
        let other = image(|c, x, y| {
            if inside(x, y) {
                target.pixels[3 * (y * 16 + x) + c]
            } else {
                5.0
            }
        });
        let inside = mask(inside);
        let device = Device::flex();
        let views = [View::new(&other, &target, &inside).expect("a view")];
        let same = ssim_srgb(&views, &device).expect("a number");
        assert!((same - 1.0).abs() < 1e-4, "{same}");
        let all = mask(|_, _| true);
        let views = [View::new(&other, &target, &all).expect("a view")];
        assert!(ssim_srgb(&views, &device).expect("a number") < 0.9);
        assert!(ssim_srgb(&[], &device).is_err());
    }

    #[test]
    fn wrong_input_is_an_error() {
        let (a, all) = (image(|_, _, _| 0.0), mask(|_, _| true));
        let small = HostImage::new(1, 1, vec![0.0; 3]).expect("an image");
        assert!(View::new(&a, &small, &all).is_err());
        assert!(View::new(&a, &a, &all[1..]).is_err());
        assert!(View::new(&a, &a, &mask(|_, _| false)).is_err());
        assert!(psnr_srgb(&[]).is_err() && psnr_linear(&[]).is_err());
        assert!(channel_scales(&[]).is_err());
    }
}
