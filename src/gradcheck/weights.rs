//! Weights of pixels under which derivatives do not cancel over an image.

use std::sync::Arc;

use burn::tensor::Tensor;

use super::parameter::Point;
use super::run::{Direction, Run};
use super::settings::Objective;
use crate::error::Result;
use crate::geometry::host_values;
use crate::scene::{Camera, Scene};

/// The number of pairs of renders that measure the change of an image along a direction.
const PILOTS: u64 = 4;

/// Weights belong to squares of this many pixels a side: their changes have less noise than those of pixels.
const SIDE: usize = 2;

impl<F: Fn(&Point) -> Result<(Scene, Camera)> + Sync> Run<'_, F> {
    /// Returns the mean radiance under weights: the sum of the image's changes along all directions, each of unit length,
    /// with signs that keep the smallest derivative large.
    pub fn weighted_mean(&self, directions: &[Direction]) -> Result<Objective> {
        let [width, height] = [self.options.width, self.options.height];
        let columns = width.div_ceil(SIDE);
        let square = |pixel: usize| (pixel / width / SIDE) * columns + pixel % width / SIDE;
        let change = |along: usize| -> Result<Vec<f64>> {
            let mut sums = vec![0.0; columns * height.div_ceil(SIDE)];
            for pilot in 0..PILOTS {
                for side in [1.0, -1.0] {
                    let mut coordinates = vec![0.0; directions.len()];
                    coordinates[along] = side;
                    let values = self.at(directions, &coordinates);
                    // Seeds count from 0, so these are others.
                    let image = self.radiance(&self.point(&values, false), u64::MAX - pilot)?;
                    for (i, v) in host_values(&image)?.iter().enumerate() {
                        sums[square(i / 3)] += side * v;
                    }
                }
            }
            let length = dot(&sums, &sums).sqrt().max(f64::MIN_POSITIVE);
            Ok(sums.iter().map(|v| v / length).collect())
        };
        let mut changes: Vec<Vec<f64>> = Vec::new();
        let mut sum = Vec::new();
        for along in 0..directions.len() {
            changes.push(change(along)?);
            sum = best_sum(&sum, &changes);
        }
        if dot(&sum, &sum) == 0.0 {
            sum.fill(1.0);
        }
        let weights: Vec<f64> = (0..width * height)
            .map(|pixel| sum[square(pixel)])
            .collect();
        Ok(Arc::new(move |radiance: Tensor<3>| {
            let like = (&radiance.device().inner(), radiance.dtype());
            let weights = Tensor::<1>::from_data(weights.as_slice(), like);
            (radiance * weights.reshape([height, width, 1])).mean()
        }))
    }
}

/// Returns the sum of the first changes plus or minus the last one: that of which the smallest projection on any of the
/// changes is larger.
fn best_sum(sum: &[f64], changes: &[Vec<f64>]) -> Vec<f64> {
    let Some((last, first)) = changes.split_last() else {
        return Vec::new();
    };
    if first.is_empty() {
        return last.clone();
    }
    let [plus, minus] = [1.0, -1.0].map(|sign| -> Vec<f64> {
        let pairs = sum.iter().zip(last);
        pairs.map(|(a, b)| a + sign * b).collect()
    });
    let least = |sum: &[f64]| {
        let all = changes.iter().map(|change| dot(change, sum).abs());
        all.fold(f64::INFINITY, f64::min)
    };
    if least(&plus) >= least(&minus) {
        plus
    } else {
        minus
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
