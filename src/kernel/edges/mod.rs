//! The edges at which visibility or colours jump, and the choice of one that is seen from a point.
//!
//! `meshes` finds those of meshes, `crossings` the lines in which triangles pass through each other; `sets`
//! holds all of a scene, and a `tree` draws one.

mod crossings;
mod edge;
mod meshes;
mod sets;
mod tree;

pub(super) use edge::{Edge, FACES, Kind, TOUCHING};
pub(crate) use sets::EdgeSets;
pub(super) use tree::{EdgeTree, Query};
