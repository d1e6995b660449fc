//! Formulas against independent float64 values and gradients.

mod common;

use burn::tensor::{DType, Device};
use common::visibility::{check, check_ratio};

#[test]
fn f64_on_flex_to_1e_9() {
    check(&Device::flex(), DType::F64, 1e-9, 1e-9);
}

#[test]
fn f32_on_the_cpu_backends() {
    for device in common::cpu_devices() {
        check(&device, DType::F32, 2e-4, 2e-3);
    }
}

#[test]
fn a_drawn_weight_carries_its_gradient() {
    check_ratio(&Device::flex(), DType::F64, 1e-12);
}
