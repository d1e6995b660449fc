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
pub use images::HostImage;
pub use limits::LoadLimits;
pub use scene_file::SceneFile;
#[cfg(feature = "fit")]
pub(crate) use srgb::{srgb_byte, srgb_to_linear};
#[cfg(feature = "fit")]
pub(crate) use whole::write_whole;
