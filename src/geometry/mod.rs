//! Vectors as planes, frames, and the flattened triangles of a scene.
//!
//! A quantity per triangle is a column `[T, 1]`, a quantity per ray a row `[1, N]`, a quantity per ray–triangle pair a
//! matrix `[T, N]`. They broadcast against each other, and the long axis of rays is contiguous.

mod context;
mod topology;
mod triangles;
mod vec3;

pub(crate) use context::{
    Context, any_positive, by_rows, detached, first_outside, host_values, host_values_async, now,
    place_of, sin_cos,
};
pub(crate) use topology::{Neighbors, Topology};
pub(crate) use triangles::{Nearest, Triangles, VertexData, nearest_on_triangle};
pub(crate) use vec3::{
    Vec3, columns, gather_columns, gather_row, host_vectors, length, split, unit_size,
};
