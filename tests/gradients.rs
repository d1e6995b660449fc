//! Gradients of every class of parameter against central differences.

mod common;

use burn::tensor::{DType, Device};
use common::gradients::{Effort, cases, compare};

/// The short tier sees a wrong sign or factor; the long one is held to 1 % of standard error.
#[test]
fn agree_with_central_differences() {
    let device = Device::flex();
    let (sigma, gamma) = (2e-2, 0.3);
    let (gradient, difference, share, bound) = if common::long() {
        let effort = |samples, seeds| Effort {
            sigma,
            gamma,
            samples,
            seeds,
        };
        (effort(64, 64), effort(256, 96), 0.01, 0.03)
    } else {
        let effort = |samples, seeds| Effort {
            sigma,
            gamma,
            samples,
            seeds,
        };
        (effort(16, 20), effort(32, 20), 0.15, 0.3)
    };
    let mut failures = Vec::new();
    for case in cases() {
        let (g, d) = compare(&case, &device, DType::F64, gradient, difference);
        let error = g.error.hypot(d.error);
        let close = (g.mean - d.mean).abs() <= (3.0 * error).min(bound * d.mean.abs());
        if !close || d.error > share * d.mean.abs() || g.error > share * d.mean.abs() {
            failures.push(case.name);
        }
    }
    assert!(failures.is_empty(), "{failures:?}");
}
