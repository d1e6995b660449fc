//! Files: OBJ with MTL, images, and scenes with a camera as JSON.

mod images;
mod limits;
mod obj;
mod obj_names;
mod obj_text;
mod polygon;
mod renders;
mod scene_file;
mod srgb;
mod viridis;
mod whole;

pub use images::HostImage;
pub use limits::LoadLimits;
pub use scene_file::SceneFile;
#[cfg(feature = "fit")]
pub(crate) use whole::write_whole;
