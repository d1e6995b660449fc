//! Files, read and written, and files that nobody means well with.

#[path = "../common/mod.rs"]
mod common;
mod gltf_maker;
mod written;

mod export;
mod export_binary;
mod fuzz;
mod gltf;
mod gltf_details;
mod gltf_materials;
mod hostile;
mod hostile_binary;
mod memory;
mod mistakes_files;
mod obj;
#[cfg(feature = "photographs")]
mod photographs;
mod pictures;
mod places;
mod ply;
mod sums;
mod warned;
