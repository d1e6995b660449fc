//! Weights of pixels under which derivatives neither cancel over an image nor consist of noise.

use std::sync::Arc;

use burn::tensor::Tensor;

use super::parameter::Point;
use super::run::{Direction, Run};
use super::settings::Objective;
use crate::error::Result;
use crate::geometry::host_values;
use crate::render::{Engine, Tangent, render_derivative};
use crate::scene::{Camera, Scene};

/// The number of images of derivatives that measure a direction and its noise.
const PILOTS: u64 = 8;

/// Weights belong to squares of this many pixels a side, which have less noise than pixels.
const SIDE: usize = 2;

/// The smallest variance of a square, relative to the mean one: few pilots show some squares with too little.
const LEAST_VARIANCE: f64 = 0.05;

/// The derivative of an image along a direction, by squares: its mean over the pilots and the variance of one.
struct Change {
    mean: Vec<f64>,
    variance: Vec<f64>,
}

impl<F: Fn(&Point) -> Result<(Scene, Camera)> + Sync> Run<'_, F> {
    /// Returns the mean radiance under weights: the sum of the derivatives along all directions in the middle of the box,
    /// over their variance, with signs that keep the smallest derivative large beside its noise. Forward mode renders
    /// them. Where it is not available, weights rise across the image, so that symmetric contributions don't cancel.
    pub fn weighted_mean(&self, directions: &[Direction]) -> Result<Objective> {
        let options = &self.options;
        let [width, height] = [options.width, options.height];
        let columns = width.div_ceil(SIDE);
        let square = |pixel: usize| (pixel / width / SIDE) * columns + pixel % width / SIDE;
        let weights: Vec<f64> = if options.visibility.is_softmax()
            || options.engine == Engine::Tensors
        {
            let weight = |i: usize| {
                0.5 + (i % width) as f64 / width as f64 + 0.5 * (i / width) as f64 / height as f64
            };
            (0..width * height).map(weight).collect()
        } else {
            let changes = self.changes(directions, columns * height.div_ceil(SIDE), square)?;
            let sum = weights(&changes);
            (0..width * height)
                .map(|pixel| sum[square(pixel)])
                .collect()
        };
        Ok(Arc::new(move |radiance: Tensor<3>| {
            let like = (&radiance.device().inner(), radiance.dtype());
            let weights = Tensor::<1>::from_data(weights.as_slice(), like);
            (radiance * weights.reshape([height, width, 1])).mean()
        }))
    }

    fn changes(
        &self,
        directions: &[Direction],
        squares: usize,
        square: impl Fn(usize) -> usize,
    ) -> Result<Vec<Change>> {
        let middle = vec![0.0; directions.len()];
        let build =
            |numbers: &[f64]| (self.build)(&self.point(&self.at(directions, numbers), false));
        let (scene, camera, tangents) = Tangent::of_numbers(&middle, build)?;
        let mut all: Vec<[Vec<f64>; 2]> =
            vec![[vec![0.0; squares], vec![0.0; squares]]; directions.len()];
        for pilot in 0..PILOTS {
            // Seeds of the comparison count from 0, so these are others.
            let options = self.options.clone().with_seed(u64::MAX - pilot);
            let images = render_derivative(&scene, &camera, &options, &tangents)?.tangents;
            let values = host_values(&images.radiance)?;
            let of_image = values.len() / directions.len();
            for ([sums, of_squares], image) in all.iter_mut().zip(values.chunks_exact(of_image)) {
                let mut own = vec![0.0; squares];
                for (pixel, color) in image.chunks_exact(3).enumerate() {
                    own[square(pixel)] += color.iter().sum::<f64>();
                }
                for (i, v) in own.iter().enumerate() {
                    sums[i] += v;
                    of_squares[i] += v * v;
                }
            }
        }
        let n = PILOTS as f64;
        let change = |[sums, of_squares]: [Vec<f64>; 2]| {
            let mean: Vec<f64> = sums.iter().map(|s| s / n).collect();
            let pairs = mean.iter().zip(&of_squares);
            let variance = pairs.map(|(m, s)| ((s - n * m * m) / (n - 1.0)).max(0.0));
            Change {
                variance: variance.collect(),
                mean,
            }
        };
        Ok(all.into_iter().map(change).collect())
    }
}

/// Returns the weights of the squares.
fn weights(changes: &[Change]) -> Vec<f64> {
    let squares = changes.first().map_or(0, |change| change.mean.len());
    let mut variance = vec![0.0; squares];
    let lengths: Vec<f64> = changes
        .iter()
        .map(|change| dot(&change.mean, &change.mean))
        .collect();
    for (change, length) in changes.iter().zip(&lengths) {
        for (sum, v) in variance.iter_mut().zip(&change.variance) {
            *sum += v / length.max(f64::MIN_POSITIVE);
        }
    }
    let least = LEAST_VARIANCE * variance.iter().sum::<f64>() / squares as f64;
    let mut sum = vec![0.0; squares];
    for (k, (change, length)) in changes.iter().zip(&lengths).enumerate() {
        if *length == 0.0 {
            continue;
        }
        let [plus, minus] = [1.0, -1.0].map(|sign| -> Vec<f64> {
            let of_square = |i: usize| {
                let variance = (variance[i] + least).max(f64::MIN_POSITIVE);
                sum[i] + sign * change.mean[i] / length.sqrt() / variance
            };
            (0..squares).map(of_square).collect()
        });
        // The smallest of the derivatives so far, beside its noise.
        let least = |weights: &[f64]| {
            let of = |change: &Change| {
                let noise = weights
                    .iter()
                    .zip(&change.variance)
                    .map(|(w, v)| w * w * v)
                    .sum::<f64>();
                dot(weights, &change.mean).abs() / noise.sqrt().max(f64::MIN_POSITIVE)
            };
            let all = changes[..=k].iter().filter(|c| dot(&c.mean, &c.mean) > 0.0);
            all.map(of).fold(f64::INFINITY, f64::min)
        };
        sum = if least(&plus) >= least(&minus) {
            plus
        } else {
            minus
        };
    }
    let length = dot(&sum, &sum).sqrt();
    match length > 0.0 {
        true => sum.iter().map(|w| w / length).collect(),
        false => vec![1.0; squares],
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
