//! A photograph of a set, before it is loaded.

use std::path::PathBuf;

use super::ViewCamera;

/// The forms in which sets of photographs with cameras are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dialect {
    /// `transforms.json`: instant-ngp and nerfstudio.
    Transforms,
    /// `transforms_train.json`, with `transforms_val.json` and `transforms_test.json`: NeRF's synthetic scenes.
    NerfSynthetic,
    /// `cameras`, `images` and `points3D` as `.bin` or `.txt`: COLMAP.
    Colmap,
    /// `cameras_sphere.npz` or `cameras.npz`: NeuS and IDR.
    Neus,
    /// `poses_bounds.npy`: LLFF.
    Llff,
}

/// What a view is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Split {
    /// The view is fitted.
    Train,
    /// The view is looked at during a fit.
    Validation,
    /// The view is measured with after a fit.
    Test,
}

/// A photograph of a set: its files and its camera.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// The name that the file of cameras gives the image.
    pub name: String,
    /// The image.
    pub path: PathBuf,
    /// The mask, if it is a file of its own.
    pub mask_path: Option<PathBuf>,
    /// The camera of the image at its full size, with the distortion of its lens.
    pub camera: ViewCamera,
    /// What the view is for, if the set says it.
    pub split: Option<Split>,
    /// The nearest and farthest depth along the view axis, in scene units, if the set has them (LLFF).
    pub depths: Option<[f64; 2]>,
    /// The EXIF orientation (1–8) by which the stored image is turned: 1 if the camera is that of the stored image.
    pub orientation: u8,
}
