//! Sets of photographs with cameras, as reconstructions take them.
//!
//! [`Photographs::open`] reads the cameras of a folder in the forms of NeRF, instant-ngp, nerfstudio, COLMAP, LLFF and
//! NeuS. [`Photographs::load`] reads the photographs: it undoes the distortion of lenses, shrinks in linear light, and
//! finds masks. [`ViewCamera::to_camera`] gives the camera with which a scene is rendered to compare it with a photograph.
//! [`ObjectPhotographs`] does both for the photographs of one object. [`Batches`] chooses mini-batches of views and tiles,
//! [`Photograph::levels`] makes coarse levels, and [`Region`] is where the object is.
//!
//! All cameras have the same axes and pixels, whatever the file's are: camera-to-world in the axes of OpenGL (x right,
//! y up, the camera looks along −z), and pixels whose centers are at (0.5, 0.5), (1.5, 0.5), and so on.

mod area;
mod background;
mod batches;
mod camera;
mod colmap;
mod crop;
mod distortion;
mod draft;
mod fields;
mod folder;
mod llff;
mod load;
mod neus;
mod numpy;
mod object;
mod photograph;
mod pose;
mod region;
mod set;
mod settle;
#[cfg(test)]
mod tests;
mod transforms;
mod view;

pub use batches::Batches;
pub use camera::{ViewCamera, Window};
pub use crop::crop_to_masks;
pub use distortion::Distortion;
pub use load::PhotographOptions;
pub use object::ObjectPhotographs;
pub use photograph::Photograph;
pub use region::Region;
pub use set::{Loaded, Photographs};
pub use view::{Dialect, Split, View};
