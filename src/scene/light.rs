//! Delta lights: point, spot and directional lights.

use std::fmt;

use burn::tensor::Tensor;

use super::Parameter;
use super::angles::warn_of_radians;
use super::parameter::{Described, Range};
use super::texture::Value;
use crate::error::{Error, Result};
use crate::geometry::{Context, Vec3, sin_cos};
use softray_kernels::host::{HostLight, LightKind, LightPart};

/// A delta light (point, spot or directional), added by [`Scene::with_light`](super::Scene::with_light).
///
/// Its light arrives at a point from a single direction, so that cameras and mirrors don't show it. All parameters may
/// be tracked tensors.
///
/// With cones of an angle above 0 ([`Visibility::cone`](crate::render::Visibility::cone)) its shadows are soft. They
/// have derivatives with respect to the occluders, the surfaces in shadow and the light. At an angle of 0 shadow edges
/// are discontinuities on the surface itself, and gradients leave out their boundary term. Lit surfaces keep their
/// other derivatives.
///
/// ```
/// use softray::prelude::*;
/// let device = Device::flex();
/// let scene = Scene::new()
///     .with_object(Object::new(shapes::cube(&device)))
///     .with_light(Light::point([2.0, 3.0, 2.0], [20.0, 18.0, 15.0]))
///     .with_light(Light::directional([0.0, -1.0, 0.3], [0.5, 0.5, 0.6]));
/// assert!(scene.has_light());
/// ```
#[derive(Clone)]
#[cfg_attr(feature = "remote", derive(serde::Serialize, serde::Deserialize))]
pub enum Light {
    /// Shines the same in all directions, from a point.
    Point {
        /// Position, in scene units.
        position: Parameter<3>,
        /// Radiant intensity, RGB. A surface that faces the light at a distance r has the irradiance intensity/r².
        intensity: Parameter<3>,
    },
    /// Shines in a cone, from a point.
    /// Between two angles to its direction the intensity falls off as in `KHR_lights_punctual` of glTF, by the factor
    /// clamp((cos θ − cos outer)/(cos inner − cos outer), 0, 1)². The divisor is at least 0.001.
    Spot {
        /// Position, in scene units.
        position: Parameter<3>,
        /// The axis of the cone, of any length but 0.
        direction: Parameter<3>,
        /// Radiant intensity within the inner angle, RGB.
        intensity: Parameter<3>,
        /// The angle to the direction, in degrees, up to which the light has its full intensity.
        inner: Parameter<1>,
        /// The angle to the direction, in degrees, from which on the intensity is 0. At least the inner angle, at most
        /// 90.
        outer: Parameter<1>,
    },
    /// Shines from far away in one direction, with the same irradiance everywhere.
    Directional {
        /// The direction in which the light travels, of any length but 0.
        direction: Parameter<3>,
        /// Irradiance of a surface that faces the light, RGB.
        irradiance: Parameter<3>,
    },
}

impl fmt::Debug for Light {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?} light", self.kind())?;
        for (part, value) in self.clone().parts() {
            write!(f, ", {} {value:?}", part.name())?;
        }
        Ok(())
    }
}

impl Described for LightPart {
    fn described(self) -> (&'static str, Range) {
        match self {
            Self::Position => ("position", Range::Finite),
            Self::Direction => ("direction", Range::Finite),
            Self::Intensity => ("intensity", Range::Light),
            Self::Irradiance => ("irradiance", Range::Light),
            Self::Inner => ("inner angle", Range::NotNegative),
            Self::Outer => ("outer angle", Range::NotNegative),
        }
    }
}

impl Light {
    /// Creates a light that shines the same in all directions.
    /// `position` is in scene units, `intensity` is the radiant intensity, RGB.
    pub fn point(position: impl Into<Parameter<3>>, intensity: impl Into<Parameter<3>>) -> Self {
        Self::Point {
            position: position.into(),
            intensity: intensity.into(),
        }
    }

    /// Creates a light that shines in a cone ([`Light::Spot`]).
    /// `position` is in scene units. `intensity` is the radiant intensity within the inner angle, RGB. It falls off to
    /// 0 between the angles `inner` and `outer` to the direction, in degrees.
    pub fn spot(
        position: impl Into<Parameter<3>>,
        direction: impl Into<Parameter<3>>,
        intensity: impl Into<Parameter<3>>,
        inner: impl Into<Parameter<1>>,
        outer: impl Into<Parameter<1>>,
    ) -> Self {
        let (inner, outer) = (inner.into(), outer.into());
        warn_of_radians("the inner angle of a spot light", &inner);
        warn_of_radians("the outer angle of a spot light", &outer);
        Self::Spot {
            position: position.into(),
            direction: direction.into(),
            intensity: intensity.into(),
            inner,
            outer,
        }
    }

    /// Creates a light from far away.
    /// `direction` is the direction in which it shines, `irradiance` the irradiance of a surface that faces it, RGB.
    pub fn directional(
        direction: impl Into<Parameter<3>>,
        irradiance: impl Into<Parameter<3>>,
    ) -> Self {
        Self::Directional {
            direction: direction.into(),
            irradiance: irradiance.into(),
        }
    }

    fn kind(&self) -> LightKind {
        match self {
            Self::Point { .. } => LightKind::Point,
            Self::Spot { .. } => LightKind::Spot,
            Self::Directional { .. } => LightKind::Directional,
        }
    }

    /// The intensity or irradiance.
    fn strength(&self) -> &Parameter<3> {
        match self {
            Self::Point { intensity, .. } | Self::Spot { intensity, .. } => intensity,
            Self::Directional { irradiance, .. } => irradiance,
        }
    }

    /// The position and the direction. A light has at least one of them.
    fn placement(&self) -> [Option<&Parameter<3>>; 2] {
        match self {
            Self::Point { position, .. } => [Some(position), None],
            Self::Spot {
                position,
                direction,
                ..
            } => [Some(position), Some(direction)],
            Self::Directional { direction, .. } => [None, Some(direction)],
        }
    }

    /// Whether the intensity or irradiance is above 0 in any color channel.
    pub(super) fn shines(&self) -> bool {
        self.strength().shines()
    }

    /// The parameters.
    pub(super) fn parts(&mut self) -> Vec<(LightPart, Value<'_>)> {
        use LightPart::{Direction, Inner, Intensity, Irradiance, Outer, Position};
        match self {
            Self::Point {
                position,
                intensity,
            } => vec![
                (Position, Value::Color(position)),
                (Intensity, Value::Color(intensity)),
            ],
            Self::Spot {
                position,
                direction,
                intensity,
                inner,
                outer,
            } => vec![
                (Position, Value::Color(position)),
                (Direction, Value::Color(direction)),
                (Intensity, Value::Color(intensity)),
                (Inner, Value::Scalar(inner)),
                (Outer, Value::Scalar(outer)),
            ],
            Self::Directional {
                direction,
                irradiance,
            } => vec![
                (Direction, Value::Color(direction)),
                (Irradiance, Value::Color(irradiance)),
            ],
        }
    }

    /// Reads the light back to the host. Checks the order of the angles and the length of the direction.
    pub(crate) fn host(&self, name: &str) -> Result<HostLight> {
        let mut host = HostLight {
            kind: self.kind(),
            position: [0.0; 3],
            direction: [0.0, 0.0, -1.0],
            strength: self.strength().values()?,
            angles: [0.0, std::f64::consts::PI],
        };
        let [position, direction] = self.placement();
        if let Some(position) = position {
            host.position = position.values()?;
        }
        if let Some(direction) = direction {
            host.direction = direction.values()?;
        }
        if let Self::Spot { inner, outer, .. } = self {
            let [inner, outer] = [inner.values()?[0], outer.values()?[0]];
            host.angles = [inner, outer].map(f64::to_radians);
            // The limit is above 90, since f32 may have rounded the angle.
            let valid = inner <= outer && outer <= 90.0001;
            let (field, found) = ("inner and outer angle", format!("[{inner}, {outer}]"));
            Error::unless(valid, name, field, found, "inner ≤ outer ≤ 90, in degrees")?;
        }
        let length = glam::DVec3::from(host.direction).length();
        if !(1e-18..=1e18).contains(&length) {
            let found = format!("{:?}", host.direction);
            return Err(Error::invalid(name, "direction", found, "a direction"));
        }
        Ok(host)
    }
}

/// The lights of a scene as planes `[1, L]`, in the coordinates of the triangles.
#[derive(Clone, Debug)]
pub(crate) struct LightPlanes {
    /// 0 for directional lights.
    pub position: Vec3,
    /// The unit vectors along which the lights shine.
    pub axis: Vec3,
    /// Intensity or irradiance.
    pub strength: Vec3,
    pub cos_inner: Tensor<2>,
    pub cos_outer: Tensor<2>,
    pub kinds: Vec<LightKind>,
    /// The typical size of the scene, in units of the positions.
    pub size: f64,
}

impl LightPlanes {
    /// Returns None if a scene has no lights.
    pub fn new(
        lights: &[Light],
        context: &Context,
        (center, unit): (Vec3, f64),
        size: f64,
    ) -> Option<Self> {
        if lights.is_empty() {
            return None;
        }
        let plane = |p: &Parameter<3>| p.vector(context);
        let away = || Vec3::constant(context, [0.0, 0.0, -1.0]);
        let number = |x: f64| context.row(&[x]);
        let mut parts: [Vec<Vec3>; 3] = Default::default();
        let mut cosines: [Vec<Tensor<2>>; 2] = Default::default();
        for light in lights {
            let [position, direction] = light.placement();
            let [inner, outer] = match light {
                Light::Spot { inner, outer, .. } => [inner, outer].map(|angle| {
                    let [angle] = angle.planes(context);
                    sin_cos(angle * 1f64.to_radians()).1
                }),
                _ => [number(1.0), number(-1.0)],
            };
            let axis = direction.map_or_else(away, plane);
            let (place, per_unit) = match position {
                Some(p) => (plane(p).sub(&center).scale_by(unit.recip()), unit),
                None => (Vec3::constant(context, [0.0; 3]), 1.0),
            };
            let strength = plane(light.strength()).scale_by((per_unit * per_unit).recip());
            let all = [place, axis.normalized(), strength];
            parts.iter_mut().zip(all).for_each(|(p, v)| p.push(v));
            let both = [inner, outer];
            cosines.iter_mut().zip(both).for_each(|(p, c)| p.push(c));
        }
        let [position, axis, strength] = parts.map(|p| Vec3::cat(&p, 1));
        let [cos_inner, cos_outer] = cosines.map(|c| Tensor::cat(c, 1));
        Some(Self {
            position,
            axis,
            strength,
            cos_inner,
            cos_outer,
            kinds: lights.iter().map(Light::kind).collect(),
            size,
        })
    }
}
