//! Names of the differentiable values.

use super::{Channel, LightPart};

/// Identifies a tensor of a scene or camera. Objects and materials are numbered over the whole scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ParameterId {
    /// `[V, 3]`, scene units.
    Vertices(usize),
    /// `[_, 2]`.
    Uvs(usize),
    /// `[_, 3]`, of any length.
    Normals(usize),
    /// `[_, 3]`, linear RGB.
    Colors(usize),
    /// `[_, 4]`.
    Tangents(usize),
    /// `[3]`, scene units over the shutter.
    Velocity(usize),
    /// `[H, W, 3]`.
    NormalMap(usize),
    /// `[3]` or `[H, W, 3]`, or `[1]` or `[H, W]`.
    Material(usize, Channel),
    /// `[3]` or `[1]`, of a light by its index in the scene.
    Light(usize, LightPart),
    /// `[3]` or `[H, W, 3]`.
    Environment,
    /// `[3]`, scene units.
    Eye,
    /// `[3]`, scene units.
    Target,
    /// `[3]`.
    Up,
    /// `[1]`, degrees.
    FieldOfView,
    /// `[2]`, pixels.
    FocalLength,
    /// `[2]`, pixels.
    PrincipalPoint,
    /// `[1]`, scene units.
    ViewHeight,
    /// `[1]`, scene units.
    Aperture,
    /// `[1]`, scene units.
    Focus,
}
