//! Files: OBJ with MTL, images, and scenes with a camera as JSON.

mod images;
mod limits;
mod obj;
mod obj_names;
mod obj_text;
mod polygon;
mod scene_file;

pub use images::HostImage;
pub use limits::LoadLimits;
pub use scene_file::SceneFile;
#[cfg(feature = "fit")]
pub(crate) use images::write_whole;
