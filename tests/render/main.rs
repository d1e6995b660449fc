//! Images: of what scenes hold, from all cameras, at any sampling, and the mistakes that somebody makes with them.

#[path = "../common/mod.rs"]
mod common;
mod detail;
mod images;

mod adaptive;
mod alpha_masks;
mod batch;
mod camera;
mod debug;
mod environment;
mod lights;
mod meshes;
mod mistakes;
mod occlusion;
mod pictures;
mod references;
mod renders;
mod sampling;
mod stability;
mod surface_detail;
