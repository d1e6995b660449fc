//! One program on several backends: a training step of a network through the renderer, and surfaces of grids. The tests on
//! wgpu are in `tests/gpu`.

#![cfg(feature = "ndarray")]

use crate::common::grids;
use crate::common::training::{assert_close, assert_taught, step};
use softray::prelude::*;

/// Relative, of the loss and of each parameter's gradient; f32.
const BOUND: f64 = 1e-5;

#[test]
#[allow(deprecated)]
fn a_training_step_is_the_same_on_flex_and_ndarray() {
    let flex = step(&Device::flex());
    assert_taught(&flex);
    let ndarray = step(&Device::ndarray());
    assert_taught(&ndarray);
    assert_close(&ndarray, &flex, BOUND);
}

#[test]
#[allow(deprecated)]
fn surfaces_of_grids_are_the_same_on_flex_and_ndarray() {
    let [flex, ndarray] = [Device::flex(), Device::ndarray()].map(|d| grids::of_grids(&d));
    grids::assert_close(&ndarray, &flex, BOUND);
}
