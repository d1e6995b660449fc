//! Losses against closed forms and plain loops, and their gradients against central differences.

use crate::common;
use crate::common::errors::{message, says};
use crate::common::numbers::largest;
use crate::common::tensors::{gradient, scalar, tensor, values};
use burn::tensor::DType;
use softray::loss::{
    iou, l1, mse, mse_unbiased, multi_scale, multi_scale_unbiased, pyramid, silhouette_iou, ssim,
};
use softray::prelude::*;

/// Where a test runs.
pub struct Place {
    pub device: Device,
    pub dtype: DType,
    /// What sums of some hundred numbers about 1 are off by.
    pub precision: f64,
}

impl Place {
    fn new(device: Device, dtype: DType) -> Self {
        let precision = if dtype == DType::F64 { 1e-12 } else { 2e-5 };
        Self {
            device,
            dtype,
            precision,
        }
    }

    /// Both CPU backends in both float types, f64 on Flex first.
    pub fn all() -> Vec<Self> {
        let types = [DType::F64, DType::F32].into_iter();
        types
            .flat_map(|t| common::cpu_devices().into_iter().map(move |d| (d, t)))
            .map(|(device, dtype)| Self::new(device, dtype))
            .collect()
    }

    pub fn f64() -> Self {
        Self::new(Device::flex(), DType::F64)
    }

    pub fn tensor<const D: usize>(&self, values: &[f64], shape: [usize; D]) -> Tensor<D> {
        tensor(values, shape, &self.device, self.dtype)
    }
}

/// Numbers in [0, 1): the upper bits of a linear congruential generator.
pub fn noise(seed: u64, count: usize) -> Vec<f64> {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005);
        state = state.wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / (1_u64 << 24) as f64
    };
    let numbers: Vec<f64> = (0..8 + count).map(|_| next()).collect();
    numbers[8..].to_vec()
}

#[track_caller]
pub fn close(found: f64, expected: f64, tolerance: f64) {
    let apart = (found - expected).abs();
    assert!(apart <= tolerance, "{found} {expected}: {apart:e}");
}

/// The value of a loss.
#[track_caller]
pub fn of(loss: softray::Result<Tensor<1>>) -> Tensor<1> {
    loss.expect("a loss")
}

/// The gradient by the image, with the target off autodiff: in f64 on Flex against central
/// differences of fourth order, which rounding puts off by 1e-12 and the fifth derivative of
/// structural similarity (values of 0.03 count there) by 1e-10; elsewhere against that.
#[track_caller]
pub fn gradient_agrees<const D: usize>(
    image: &[f64],
    target: &[f64],
    shape: [usize; D],
    loss: impl Fn(Tensor<D>, Tensor<D>) -> softray::Result<Tensor<1>>,
) {
    let value = |place: &Place, image: Tensor<D>| of(loss(image, place.tensor(target, shape)));
    let place = Place::f64();
    let at = |i: usize, by: f64| {
        let mut moved = image.to_vec();
        moved[i] += by;
        scalar(&value(&place, place.tensor(&moved, shape)))
    };
    let step = 1e-4;
    let slope = |i| {
        let [near, far] = [step, 2.0 * step].map(|h| (at(i, h) - at(i, -h)) / (2.0 * h));
        (4.0 * near - far) / 3.0
    };
    let differences: Vec<f64> = (0..image.len()).map(slope).collect();
    let mut first: Option<Vec<f64>> = None;
    for place in Place::all() {
        let leaf = place.tensor(image, shape).autodiff().require_grad();
        let found = gradient(&leaf, &value(&place, leaf.clone()).backward());
        // In f32 the C₂ of structural similarity costs a digit where variances are as small.
        let largest = largest(differences.iter().copied());
        let (expected, tolerance) = match &first {
            None => (&differences, 5e-10),
            Some(first) => (first, 20.0 * place.precision * largest),
        };
        for (&found, &expected) in found.iter().zip(expected) {
            close(found, expected, tolerance);
        }
        first.get_or_insert(found);
    }
}

#[test]
fn absolute_difference() {
    for place in Place::all() {
        let image = place.tensor(&[0.0, 1.0, 2.0, 3.5], [2, 2, 1]);
        let target = place.tensor(&[0.5, 1.0, 1.0, 5.0], [2, 2, 1]);
        let found = scalar(&of(l1(image.clone(), target.clone())));
        close(found, 0.75, place.precision);
        let leaf = image.autodiff().require_grad();
        let found = gradient(&leaf, &of(l1(leaf.clone(), target)).backward());
        assert_eq!(found, [-0.25, 0.0, 0.25, -0.25]);
    }
}

#[test]
fn shapes_are_not_broadcast() {
    let place = Place::f64();
    let image = || place.tensor(&[0.0; 4], [2, 2, 1]);
    let one = || place.tensor(&[0.0], [1, 1, 1]);
    let parts = ["shape is [2, 2, 1]", "expected [1, 1, 1] like the target"];
    for loss in [
        mse(image(), one()),
        mse_unbiased(one(), image(), one()),
        l1(image(), one()),
        ssim(image(), one(), 1.0),
        multi_scale(image(), one(), 2, mse),
        multi_scale_unbiased(one(), image(), one(), 2),
        silhouette_iou(image(), one()),
    ] {
        says(message(loss), parts);
    }
}

/// Means of 2 × 2, of what there is where the size is odd; down to one pixel.
#[test]
fn pyramid_of_means() {
    for place in Place::all() {
        let rising: Vec<f64> = (0..15).map(f64::from).collect();
        let levels = pyramid(place.tensor(&rising, [3, 5, 1]), 10).expect("levels");
        let expected: [([usize; 3], &[f64]); 4] = [
            ([3, 5, 1], &rising),
            ([2, 3, 1], &[3.0, 5.0, 6.5, 10.5, 12.5, 14.0]),
            ([1, 2, 1], &[7.75, 10.25]),
            ([1, 1, 1], &[9.0]),
        ];
        assert_eq!(levels.len(), expected.len());
        for (level, (shape, expected)) in levels.iter().zip(expected) {
            assert_eq!(level.dims(), shape);
            assert_eq!(values(level), expected);
        }
        // Channels stay apart, and the mean of even sizes stays.
        let colors = noise(1, 8 * 4 * 3);
        let levels = pyramid(place.tensor(&colors, [8, 4, 3]), 3).expect("levels");
        let shapes: Vec<_> = levels.iter().map(Tensor::dims).collect();
        assert_eq!(shapes, [[8, 4, 3], [4, 2, 3], [2, 1, 3]]);
        for channel in 0..3 {
            let mean = |level: &Tensor<3>| {
                let pixels = values(level);
                let of_channel = pixels.iter().skip(channel).step_by(3);
                of_channel.sum::<f64>() / (pixels.len() / 3) as f64
            };
            close(mean(&levels[2]), mean(&levels[0]), place.precision);
        }
        for (levels, shape) in [(1, [2, 2, 1]), (5, [1, 1, 4])] {
            let levels = pyramid(place.tensor(&[1.0; 4], shape), levels);
            assert_eq!(levels.expect("levels").len(), 1);
        }
    }
}

/// Differences of 1, −1, 0, 2 in a square have a mean of 0.5.
#[test]
fn several_scales() {
    for place in Place::all() {
        let image = || place.tensor(&[1.0, 0.0, 3.0, 4.0], [2, 2, 1]);
        let target = || place.tensor(&[0.0, 1.0, 3.0, 2.0], [2, 2, 1]);
        let squares = |levels| scalar(&of(multi_scale(image(), target(), levels, mse)));
        close(squares(1), 1.5, place.precision);
        close(squares(2), (1.5 + 0.25) / 2.0, place.precision);
        close(squares(7), (1.5 + 0.25) / 2.0, place.precision);
        let sizes = scalar(&of(multi_scale(image(), target(), 2, l1)));
        close(sizes, (1.0 + 0.5) / 2.0, place.precision);
        let twice = multi_scale_unbiased(image(), image(), target(), 2);
        close(scalar(&of(twice)), squares(2), place.precision);
        let one = || place.tensor(&[3.0], [1, 1, 1]);
        let other = place.tensor(&[1.0], [1, 1, 1]);
        let found = scalar(&of(multi_scale(one(), other, 3, mse)));
        close(found, 4.0, place.precision);
    }
    let (image, target) = (noise(2, 5 * 7 * 2), noise(3, 5 * 7 * 2));
    gradient_agrees(&image, &target, [5, 7, 2], |i, t| multi_scale(i, t, 4, mse));
    gradient_agrees(&image, &target, [5, 7, 2], l1);
    gradient_agrees(&image, &target, [5, 7, 2], |i, t| {
        multi_scale_unbiased(i.clone(), i * 0.5, t, 4)
    });
}

/// Noise of variance v adds v to the mean squared difference, v/4 a level up, v/16 two up; the
/// product of two renders is free of it.
#[test]
fn two_renders_are_free_of_noise() {
    let place = Place::f64();
    let (side, repeats) = (16, 200);
    let count = side * side;
    let (image, target) = (noise(4, count), noise(5, count));
    let variance = 1.0 / 12.0; // of noise even over a length of 1
    let shape = [side, side, 1];
    let target = place.tensor(&target, shape);
    let noisy = |seed: u64| {
        let pairs = image.iter().zip(noise(seed, count));
        let values: Vec<f64> = pairs.map(|(i, n)| i + n - 0.5).collect();
        place.tensor(&values, shape)
    };
    let clean = place.tensor(&image, shape);
    let (mut once, mut twice) = ([0.0; 2], [0.0; 2]);
    for i in 0..repeats {
        let (a, b) = (noisy(100 + 2 * i), noisy(101 + 2 * i));
        let found = [
            mse(a.clone(), target.clone()),
            multi_scale(a.clone(), target.clone(), 3, mse),
            mse_unbiased(a.clone(), b.clone(), target.clone()),
            multi_scale_unbiased(a, b, target.clone(), 3),
        ];
        let [x, y, z, w] = found.map(|loss| scalar(&of(loss)) / repeats as f64);
        once = [once[0] + x, once[1] + y];
        twice = [twice[0] + z, twice[1] + w];
    }
    let expected = [
        scalar(&of(mse(clean.clone(), target.clone()))),
        scalar(&of(multi_scale(clean, target, 3, mse))),
    ];
    let biases = [variance, variance * (1.0 + 0.25 + 0.0625) / 3.0];
    // The standard error of these means over 200 · 256 pixels is about 0.001 or less: √(4·d²·v/n),
    // d² = 1/6.
    for i in 0..2 {
        close(once[i] - expected[i], biases[i], 4e-3);
        close(twice[i], expected[i], 4e-3);
    }
}

/// Σab = 0.5 + 0.25 and Σ(a + b − ab) = 1 + 1 + 0.75 + 0.
#[test]
fn overlap_of_silhouettes() {
    for place in Place::all() {
        let opacity = || place.tensor(&[0.5, 1.0, 0.5, 0.0], [2, 2]);
        let target = || place.tensor(&[1.0, 0.0, 0.5, 0.0], [2, 2]);
        let found = scalar(&of(silhouette_iou(opacity(), target())));
        close(found, 1.0 - 0.75 / 2.75, place.precision);
        let disc = || place.tensor(&[0.0, 1.0, 1.0, 0.0, 1.0, 0.0], [2, 3]);
        let rest = || place.tensor(&[1.0, 0.0, 0.0, 1.0, 0.0, 1.0], [2, 3]);
        assert_eq!(scalar(&of(silhouette_iou(disc(), disc()))), 0.0);
        assert_eq!(scalar(&of(silhouette_iou(disc(), rest()))), 1.0);

        let found = iou(&opacity(), &target(), 0.4).expect("a number");
        close(found, 2.0 / 3.0, 1e-15);
        close(iou(&opacity(), &target(), 0.5).expect("a number"), 0.0, 0.0);
        close(iou(&disc(), &disc(), 0.5).expect("a number"), 1.0, 0.0);
        close(iou(&disc(), &rest(), 2.0).expect("a number"), 1.0, 0.0);
        says(message(iou(&disc(), &target(), 0.5)), ["[2, 3]"]);
        says(
            message(iou(&disc(), &rest(), f64::NAN)),
            ["threshold is NaN"],
        );
    }
    let (a, b) = (noise(6, 24), noise(7, 24));
    gradient_agrees(&a, &b, [4, 6], silhouette_iou);
    gradient_agrees(&[0.3], &[0.6], [1, 1], silhouette_iou);
}

/// Nothing on either side is no loss, with a gradient that one can step along; so is next to
/// nothing, in f32 as well.
#[test]
fn empty_silhouettes() {
    for place in Place::all() {
        for opacity in [0.0, 1e-30, 1e-6] {
            let empty = place.tensor(&[0.0; 12], [3, 4]);
            let leaf = place.tensor(&[opacity; 12], [3, 4]);
            let leaf = leaf.autodiff().require_grad();
            let loss = of(silhouette_iou(leaf.clone(), empty));
            close(scalar(&loss), 12.0 * opacity / 1e-3, place.precision);
            for slope in gradient(&leaf, &loss.backward()) {
                close(slope * 1e-3, 1.0, place.precision);
            }
        }
        let full = place.tensor(&[1.0; 12], [3, 4]);
        let empty = place.tensor(&[0.0; 12], [3, 4]);
        assert_eq!(
            scalar(&of(silhouette_iou(full.clone(), empty.clone()))),
            1.0
        );
        assert_eq!(scalar(&of(silhouette_iou(empty, full))), 1.0);
    }
}

#[test]
fn settings_have_ranges() {
    let image = || Place::f64().tensor(&[0.5], [1, 1, 1]);
    says(message(ssim(image(), image(), 0.0)), ["range is 0"]);
    says(message(pyramid(image(), 0)), ["levels is 0"]);
    says(
        message(multi_scale(image(), image(), 0, mse)),
        ["levels is 0"],
    );
}
