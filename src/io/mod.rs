//! File formats: OBJ with MTL, glTF, PLY, images, animations, and JSON scenes with a camera.

mod animation;
mod build;
mod build_materials;
mod decode;
mod description;
mod exposure;
mod exr_write;
mod files;
mod gltf;
mod gltf_images;
mod gltf_lights;
mod gltf_materials;
mod gltf_write;
mod images;
mod limits;
mod load;
mod mtl_write;
mod notes;
mod numbers;
mod obj;
mod obj_write;
mod ply;
mod ply_write;
mod polygon;
#[cfg(all(feature = "photographs", not(target_family = "wasm")))]
mod raster;
mod renders;
mod scene_file;
mod scene_load;
mod scene_materials;
mod split;
mod srgb;
mod textures;
mod whole;
mod write;

pub use animation::Animation;
#[cfg(all(feature = "photographs", not(target_family = "wasm")))]
pub(crate) use files::Files;
pub use images::HostImage;
pub use limits::LoadLimits;
#[cfg(all(feature = "photographs", not(target_family = "wasm")))]
pub(crate) use limits::parse_json;
#[cfg(all(feature = "photographs", not(target_family = "wasm")))]
pub(crate) use raster::Raster;
pub use scene_file::SceneFile;
pub(crate) use srgb::linear_to_srgb;
#[cfg(feature = "fit")]
pub(crate) use srgb::{srgb_byte, srgb_to_linear};
#[cfg(feature = "fit")]
pub(crate) use whole::write_whole;
