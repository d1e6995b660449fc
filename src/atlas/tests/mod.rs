//! Tests of atlases.

mod meshes;
