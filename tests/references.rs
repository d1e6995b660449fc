//! The unblurred limit: σ → 0 and γ → 0 give the images of an independent renderer.

mod common;

use burn::tensor::Device;
use common::images::{REFERENCES, compare};

#[test]
fn unblurred_limit() {
    for (name, bounces) in REFERENCES {
        // RMSE is noise at few samples: 0.02 holds for enough of them only.
        let (samples, mean, rmse) = if common::long() {
            (1024, 0.02, 0.02)
        } else {
            (32, 0.02, 0.12)
        };
        let found = compare(name, bounces, samples, (1e-7, 1e-5), &Device::flex());
        assert!(
            (found.mean_ratio - 1.0).abs() < mean,
            "{name} {bounces}: {found:?}"
        );
        assert!(found.rmse_clipped < rmse, "{name} {bounces}: {found:?}");
    }
}
