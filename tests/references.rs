//! Renders against the images of an independent renderer, which has no blur.

mod common;

use burn::tensor::Device;
use common::images::{REFERENCES, compare};
use softray::prelude::*;

/// All references within a share of the mean and a clipped RMSE.
fn agree(samples: u32, sigma: f64, visibility: Visibility, mean: f64, rmse: f64) {
    for (name, bounces) in REFERENCES {
        // The noisiest scene is the cheapest.
        let samples = if name == "cornell" {
            2 * samples
        } else {
            samples
        };
        let found = compare(name, bounces, samples, (sigma, visibility), &Device::flex());
        assert!(
            (found.mean_ratio - 1.0).abs() < mean,
            "{name} {bounces}: {found:?}"
        );
        assert!(found.rmse_clipped < rmse, "{name} {bounces}: {found:?}");
    }
}

/// The paper's form has to be next to sharp.
#[test]
fn softmax_in_the_unblurred_limit() {
    let (samples, mean, rmse) = if common::long() {
        (512, 0.015, 0.01)
    } else {
        (64, 0.02, 0.02)
    };
    agree(samples, 1e-7, Visibility::softmax(1e-5), mean, rmse);
}

#[test]
fn layered_at_a_small_blur() {
    let (samples, rmse) = if common::long() {
        (512, 0.012)
    } else {
        (64, 0.015)
    };
    agree(samples, 1e-4, Visibility::Layered, 0.015, rmse);
}

/// No bound on the RMSE but that of what the blur itself changes: highlights and edges.
#[test]
fn layered_at_a_larger_blur() {
    let samples = if common::long() { 512 } else { 32 };
    agree(samples, 1e-3, Visibility::Layered, 0.025, 0.035);
}
