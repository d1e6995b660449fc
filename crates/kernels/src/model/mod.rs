//! Formulas of light transport as small pure functions. Each has its derivative beside it, and a test of that
//! derivative.

#![allow(
    clippy::assign_op_pattern,
    clippy::collapsible_if,
    clippy::manual_clamp,
    reason = "the language of kernels has no other form"
)]

pub mod bsdf;
pub mod camera;
pub mod choice;
pub mod cone;
pub mod connection;
pub mod crossing;
pub mod delta_light;
pub mod edge;
pub mod edge_weight;
pub mod emitter;
pub mod film;
pub mod filter;
pub mod frame;
pub mod integers;
pub mod jumps;
pub mod light_bounds;
pub mod lists;
pub mod normal_map;
pub mod numbers;
pub mod segment;
pub mod sky;
pub mod texture;
pub mod triangle;

mod vector;

pub use vector::{Four, Pair, V2, V3, component, select_vector, splat, v2, v3};
