//! Files: OBJ with MTL, images, and scenes with a camera as JSON.

mod images;
mod limits;
mod obj;
mod obj_text;
mod polygon;
mod scene_file;

pub use images::HostImage;
#[cfg(feature = "fit")]
pub(crate) use images::{srgb_byte, srgb_to_linear, write_whole};
pub use limits::LoadLimits;
pub use scene_file::SceneFile;
