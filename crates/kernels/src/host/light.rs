//! Delta lights.

/// A delta light.
pub struct HostLight {
    /// Its kind.
    pub kind: LightKind,
    /// Scene units.
    pub position: [f64; 3],
    /// Of any length but 0.
    pub direction: [f64; 3],
    /// Intensity or irradiance.
    pub strength: [f64; 3],
    /// The inner and outer angle of a spot light, in radians.
    pub angles: [f64; 2],
}

/// The kind of a light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightKind {
    /// Shines the same in all directions, from a point.
    Point,
    /// Shines in a cone, from a point.
    Spot,
    /// Shines from far away in one direction.
    Directional,
}

/// A parameter of a light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LightPart {
    /// `[3]`, scene units.
    Position,
    /// `[3]`, of any length but 0.
    Direction,
    /// `[3]`, radiant intensity, RGB.
    Intensity,
    /// `[3]`, irradiance of a surface that faces the light, RGB.
    Irradiance,
    /// `[1]`, the angle up to which a spot light has its full intensity, in degrees.
    Inner,
    /// `[1]`, the angle from which on its intensity is 0, in degrees.
    Outer,
}
