//! Vectors as planes, frames, and the flattened triangles of a scene.
//!
//! A quantity of a triangle is a column `[T, 1]`, one of a ray a row `[1, N]`, one of a
//! ray–triangle pair `[T, N]`: they broadcast against each other, and the long axis of rays is
//! contiguous.

mod context;
mod planes;
mod topology;
mod triangles;
mod trigonometry;
mod vec3;

pub use context::Context;
pub(crate) use context::{by_rows, first_not_finite, host_values, plain};
pub(crate) use planes::{columns, gather_columns, length, split, unit_size};
pub use topology::{Neighbours, Topology, Weld};
pub(crate) use triangles::nearest_on_triangle;
pub use triangles::{Nearest, Triangles, VertexData};
pub(crate) use trigonometry::sin_cos;
pub use vec3::Vec3;
pub(crate) use vec3::{gather_row, host_vectors};
