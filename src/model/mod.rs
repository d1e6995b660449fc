//! Physics as small pure functions of numbers, each with its derivative beside it and a test of it.

pub(crate) mod bsdf;
pub(crate) mod camera;
pub(crate) mod cone;
pub(crate) mod edge;
pub(crate) mod emitter;
pub(crate) mod filter;
pub(crate) mod frame;
pub(crate) mod normal_map;
pub(crate) mod segment;
pub(crate) mod sky;
pub(crate) mod texture;
pub(crate) mod triangle;

mod vector;

pub(crate) use vector::{Pair, V2, V3, splat, v2, v3};
