//! Tests of the whole way from silhouettes to sound meshes.

mod hulls;
mod meshes;
