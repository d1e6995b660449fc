//! Delta lights.

/// A light on the host.
pub struct HostLight {
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
    Point,
    Spot,
    Directional,
}

/// A parameter of a light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LightPart {
    Position,
    Direction,
    Intensity,
    Irradiance,
    Inner,
    Outer,
}
