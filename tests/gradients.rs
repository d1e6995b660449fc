//! Gradients of every class of parameter against central differences, in both forms of visibility.

mod common;

use burn::tensor::{DType, Device};
use common::gradients::{Demand, Effort, LAYERED, SOFTMAX, agreement, cases, compare};

/// The short tier asks for agreement within 3.5 standard errors, and for errors small enough that
/// a wrong factor of two shows in every class. The long tier asks for standard errors of 1 % of
/// the reference and agreement within 3 of them and 3 %.
fn agree_with_central_differences(effort: Effort) {
    let device = Device::flex();
    let long = common::long();
    let demand = if long {
        Demand {
            seeds: 100,
            error: 0.01,
            most_seeds: 12_000,
        }
    } else {
        Demand {
            seeds: 32,
            error: 0.08,
            most_seeds: 240,
        }
    };
    let mut failures = Vec::new();
    for case in cases() {
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

#[test]
fn softmax_agrees_with_central_differences() {
    agree_with_central_differences(SOFTMAX);
}

#[test]
fn layered_agrees_with_central_differences() {
    agree_with_central_differences(LAYERED);
}

/// The same seed gives the same gradient on the other CPU backend.
#[test]
fn the_same_on_ndarray() {
    for effort in [SOFTMAX, LAYERED] {
        let devices = (&common::cpu_devices()[1], &Device::flex());
        for (case, apart) in agreement(devices, DType::F64, effort) {
            assert!(apart < 1e-6, "{case}: {apart:e}");
        }
    }
}
