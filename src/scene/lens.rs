//! The lens of a camera.

use super::Parameter;

/// A thin lens. It requires a perspective projection. [`CameraParams`](crate::modules::CameraParams) has an example.
#[derive(Clone, Debug)]
#[cfg_attr(feature = "remote", derive(serde::Serialize, serde::Deserialize))]
pub struct ThinLens {
    /// Radius of the aperture, in scene units, ≥ 0.
    pub aperture_radius: Parameter<1>,
    /// Distance of the plane in focus along the view axis, in scene units, > 0.
    pub focus_distance: Parameter<1>,
}
