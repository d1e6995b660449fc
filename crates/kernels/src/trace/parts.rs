//! The sections ("parts") of the list of derivative sums.

use crate::model::delta_light;

/// Parts for a scene and its camera.
pub const VERTICES: u32 = 0;
/// With respect to triangle normals and areas; they are passed on to the vertices at the end.
pub const TRIANGLES: u32 = 1;
pub const AREAS: u32 = 2;
/// One vector per object.
pub const VELOCITIES: u32 = 3;
pub const UVS: u32 = 4;
pub const NORMALS: u32 = 5;
/// One vector per channel of each material.
pub const MATERIALS: u32 = 6;
pub const TEXELS: u32 = 7;
pub const SKY: u32 = 8;
pub const COLORS: u32 = 9;
pub const TANGENTS: u32 = 10;
/// [`OF_LIGHT`] numbers per delta light, and [`OF_CAMERA`] for the camera.
pub const LIGHTS: u32 = 11;
pub const CAMERAS: u32 = 12;
pub const PARTS: usize = 13;

/// Position, axis, strength and both cosines of a delta light.
pub const OF_LIGHT: u32 = delta_light::OF_LIGHT as u32;
/// Number of derivatives of a camera, in the order of the fields of its gradient.
pub const OF_CAMERA: u32 = 20;
