//! The sections ("parts") of the list of derivative sums.

use crate::model::delta_light;

/// Parts for a scene and its camera.
pub(crate) const VERTICES: u32 = 0;
/// With respect to triangle normals and areas; they are passed on to the vertices at the end.
pub(crate) const TRIANGLES: u32 = 1;
pub(crate) const AREAS: u32 = 2;
/// One vector per object.
pub(crate) const VELOCITIES: u32 = 3;
pub(crate) const UVS: u32 = 4;
pub(crate) const NORMALS: u32 = 5;
/// One vector per channel of each material.
pub(crate) const MATERIALS: u32 = 6;
pub(crate) const TEXELS: u32 = 7;
pub(crate) const SKY: u32 = 8;
pub(crate) const COLORS: u32 = 9;
pub(crate) const TANGENTS: u32 = 10;
/// [`OF_LIGHT`] numbers per delta light, and [`OF_CAMERA`] for the camera.
pub(crate) const LIGHTS: u32 = 11;
pub(crate) const CAMERAS: u32 = 12;
pub(crate) const PARTS: usize = 13;

/// Position, axis, strength and both cosines of a delta light.
pub(crate) const OF_LIGHT: u32 = delta_light::OF_LIGHT as u32;
/// Number of derivatives of a camera, in the order of the fields of its gradient.
pub(crate) const OF_CAMERA: u32 = 20;
