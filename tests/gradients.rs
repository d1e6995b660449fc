//! Gradients of every class of parameter against central differences.

mod common;

use burn::tensor::{DType, Device};
use common::gradients::{Demand, Effort, cases, compare};

/// The short tier asks for agreement within 3.5 standard errors, and for errors small enough that
/// a wrong factor of two shows in every class. The long tier asks for standard errors of 1 % of
/// the reference and agreement within 3 of them and 3 %.
#[test]
fn agree_with_central_differences() {
    let device = Device::flex();
    let effort = Effort {
        sigma: 1e-2,
        gamma: 0.05,
        samples: 16,
    };
    let long = common::long();
    let demand = if long {
        Demand {
            seeds: 40,
            error: 0.009,
            most_seeds: 4000,
        }
    } else {
        Demand {
            seeds: 12,
            error: 0.08,
            most_seeds: 60,
        }
    };
    let only = std::env::var("SOFTRAY_ONLY").ok();
    let mut failures = Vec::new();
    for case in cases() {
        if only.as_deref().is_some_and(|o| o != case.name) {
            continue;
        }
        let (g, d) = compare(&case, &device, DType::F64, effort, demand);
        let apart = (g.mean - d.mean).abs();
        let error = g.error.hypot(d.error);
        let close = if long {
            let precise = g.error.max(d.error) <= 0.01 * d.mean.abs();
            precise && apart <= (3.0 * error).min(0.03 * d.mean.abs())
        } else {
            error <= 0.15 * d.mean.abs() && apart <= 3.5 * error
        };
        if !close {
            failures.push(case.name);
        }
    }
    assert!(failures.is_empty(), "{failures:?}");
}
