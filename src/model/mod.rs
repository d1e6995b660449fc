//! Formulas of light transport as small pure functions. Each has its derivative beside it, and a test of that
//! derivative.

#![allow(
    clippy::assign_op_pattern,
    clippy::collapsible_if,
    clippy::manual_clamp,
    reason = "the language of kernels has no other form"
)]

pub(crate) mod bsdf;
pub(crate) mod camera;
pub(crate) mod choice;
pub(crate) mod cone;
pub(crate) mod connection;
pub(crate) mod crossing;
pub(crate) mod delta_light;
pub(crate) mod edge;
pub(crate) mod edge_weight;
pub(crate) mod emitter;
pub(crate) mod film;
pub(crate) mod filter;
pub(crate) mod frame;
pub(crate) mod integers;
pub(crate) mod jumps;
pub(crate) mod light_bounds;
pub(crate) mod lists;
pub(crate) mod normal_map;
pub(crate) mod numbers;
pub(crate) mod segment;
pub(crate) mod sky;
pub(crate) mod texture;
pub(crate) mod triangle;

mod vector;

pub(crate) use vector::{Four, Pair, V2, V3, component, select_vector, splat, v2, v3};
