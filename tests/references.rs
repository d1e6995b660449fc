//! The unblurred limit: σ → 0 and γ → 0 give the images of an independent renderer.

mod common;

use burn::tensor::Device;
use common::images::{REFERENCES, compare};

#[test]
fn unblurred_limit() {
    for (name, bounces) in REFERENCES {
        let (samples, mean, rmse) = if common::long() {
            (512, 0.015, 0.01)
        } else {
            (64, 0.02, 0.02)
        };
        let found = compare(name, bounces, samples, (1e-7, 1e-5), &Device::flex());
        assert!(
            (found.mean_ratio - 1.0).abs() < mean,
            "{name} {bounces}: {found:?}"
        );
        assert!(found.rmse_clipped < rmse, "{name} {bounces}: {found:?}");
    }
}
