//! Gradients of every class of parameter against central differences.

mod common;

use burn::tensor::{DType, Device};
use common::gradients::{Effort, cases, compare};

/// The short tier asks for agreement within 3.5 standard errors of a few samples. That sees a wrong
/// factor in materials, lights, environment, vertices, camera position and field of view; for
/// translation, velocity, aperture and focus the errors are as large as the gradients, so only
/// `SOFTRAY_LONG=1`, with more samples, 3 standard errors and 3 %, can tell there.
#[test]
fn agree_with_central_differences() {
    let device = Device::flex();
    let effort = |samples, seeds| Effort {
        sigma: 2e-2,
        gamma: 0.3,
        samples,
        seeds,
    };
    let (gradient, difference) = if common::long() {
        (effort(64, 200), effort(128, 200))
    } else {
        (effort(16, 12), effort(32, 12))
    };
    let mut failures = Vec::new();
    for case in cases() {
        let (g, d) = compare(&case, &device, DType::F64, gradient, difference);
        let apart = (g.mean - d.mean).abs();
        let error = g.error.hypot(d.error);
        let close = if common::long() {
            apart <= (3.0 * error).min(0.03 * d.mean.abs()) && error <= 0.01 * d.mean.abs()
        } else {
            apart <= 3.5 * error
        };
        if !close {
            failures.push(case.name);
        }
    }
    assert!(failures.is_empty(), "{failures:?}");
}
