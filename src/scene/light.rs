//! Lights without a surface: points, spots and distant ones.

use std::fmt;

use burn::tensor::Tensor;

use super::Parameter;
use super::albedo::Value;
use super::parameter::Range;
use crate::error::{Error, Result};
use crate::geometry::{Context, Vec3, sin_cos};

/// A light without a surface, added by [`Scene::light`](super::Scene::light). Its light comes to a point from one
/// direction, so that cameras and mirrors don't see it.
///
/// All parameters may be tensors in the graph. With cones ([`Visibility::cone`](crate::render::Visibility::cone)) its
/// shadows are soft, and have derivatives by what casts them, by what they fall on and by the light. Without (the angle
/// is 0) their edges are jumps of the surface's own light, which gradients leave out; what is lit then has its other
/// derivatives.
///
/// ```
/// use softray::prelude::*;
/// let device = Device::flex();
/// let scene = Scene::new()
///     .with(Object::new(shapes::cube(&device)))
///     .light(Light::point([2.0, 3.0, 2.0], [20.0, 18.0, 15.0]))
///     .light(Light::directional([0.0, -1.0, 0.3], [0.5, 0.5, 0.6]));
/// assert!(scene.has_light());
/// ```
#[derive(Clone)]
pub enum Light {
    /// Shines the same in all directions, from a point.
    Point {
        /// Scene units.
        position: Parameter<3>,
        /// Radiant intensity, RGB: at a distance r the irradiance across the light is intensity/r².
        intensity: Parameter<3>,
    },
    /// Shines in a cone, from a point. Between two angles to its direction the intensity falls off as in
    /// `KHR_lights_punctual` of glTF: by clamp((cos θ − cos outer)/(cos inner − cos outer), 0, 1)², the divisor being
    /// 0.001 at least.
    Spot {
        /// Scene units.
        position: Parameter<3>,
        /// The middle of the cone, of any length but 0.
        direction: Parameter<3>,
        /// Radiant intensity within the inner angle, RGB.
        intensity: Parameter<3>,
        /// The angle to the direction up to which all of the intensity is there, radians.
        inner: Parameter<1>,
        /// The angle to the direction from which on there is none: at least the inner one, at most π/2.
        outer: Parameter<1>,
    },
    /// Shines from far away, in one direction, with the same irradiance everywhere.
    Directional {
        /// The direction in which the light goes, of any length but 0.
        direction: Parameter<3>,
        /// Irradiance of a surface that faces the light, RGB.
        irradiance: Parameter<3>,
    },
}

impl fmt::Debug for Light {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?} light", self.kind())?;
        for (part, value) in self.clone().parts() {
            write!(f, ", {} {value:?}", part.row().0)?;
        }
        Ok(())
    }
}

/// What a light is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LightKind {
    Point,
    Spot,
    Directional,
}

/// A parameter of a light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum LightPart {
    Position,
    Direction,
    Intensity,
    Irradiance,
    Inner,
    Outer,
}

impl LightPart {
    /// Its name in messages and the range of its values.
    pub fn row(self) -> (&'static str, Range) {
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
    /// A light that shines the same in all directions: its place in scene units, and its radiant intensity, RGB.
    pub fn point(position: impl Into<Parameter<3>>, intensity: impl Into<Parameter<3>>) -> Self {
        Self::Point {
            position: position.into(),
            intensity: intensity.into(),
        }
    }

    /// A light that shines in a cone: its place in scene units, its direction, its radiant intensity in the middle, RGB,
    /// and the angles to the direction between which that falls off to 0, in radians ([`Light::Spot`]).
    pub fn spot(
        position: impl Into<Parameter<3>>,
        direction: impl Into<Parameter<3>>,
        intensity: impl Into<Parameter<3>>,
        inner: impl Into<Parameter<1>>,
        outer: impl Into<Parameter<1>>,
    ) -> Self {
        Self::Spot {
            position: position.into(),
            direction: direction.into(),
            intensity: intensity.into(),
            inner: inner.into(),
            outer: outer.into(),
        }
    }

    /// A light from far away: the direction in which it shines, and the irradiance of a surface that faces it, RGB.
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

    /// Its intensity or irradiance.
    fn strength(&self) -> &Parameter<3> {
        match self {
            Self::Point { intensity, .. } | Self::Spot { intensity, .. } => intensity,
            Self::Directional { irradiance, .. } => irradiance,
        }
    }

    /// Its position and its direction, of which there is one at least.
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

    /// Whether its intensity is above 0 in any colour.
    pub(super) fn shines(&self) -> bool {
        self.strength().shines()
    }

    /// Its parameters.
    pub(super) fn parts(&mut self) -> Vec<(LightPart, Value<'_>)> {
        use LightPart::{Direction, Inner, Intensity, Irradiance, Outer, Position};
        match self {
            Self::Point {
                position,
                intensity,
            } => vec![
                (Position, Value::Colour(position)),
                (Intensity, Value::Colour(intensity)),
            ],
            Self::Spot {
                position,
                direction,
                intensity,
                inner,
                outer,
            } => vec![
                (Position, Value::Colour(position)),
                (Direction, Value::Colour(direction)),
                (Intensity, Value::Colour(intensity)),
                (Inner, Value::Scalar(inner)),
                (Outer, Value::Scalar(outer)),
            ],
            Self::Directional {
                direction,
                irradiance,
            } => vec![
                (Direction, Value::Colour(direction)),
                (Irradiance, Value::Colour(irradiance)),
            ],
        }
    }

    /// Reads it back, and checks what no parameter says for itself.
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
            host.angles = [inner.values()?[0], outer.values()?[0]];
            let [inner, outer] = host.angles;
            let valid = inner <= outer && outer <= std::f64::consts::FRAC_PI_2 + 1e-6;
            let (field, found) = ("inner and outer angle", format!("[{inner}, {outer}]"));
            Error::unless(valid, name, field, found, "inner ≤ outer ≤ π/2, in radians")?;
        }
        let length = glam::DVec3::from(host.direction).length();
        if !(1e-18..=1e18).contains(&length) {
            let found = format!("{:?}", host.direction);
            return Err(Error::invalid(name, "direction", found, "a direction"));
        }
        Ok(host)
    }
}

/// A light on the host.
pub(crate) struct HostLight {
    pub kind: LightKind,
    /// Scene units.
    pub position: [f64; 3],
    /// Of any length but 0.
    pub direction: [f64; 3],
    /// Intensity, or irradiance.
    pub strength: [f64; 3],
    /// The inner and outer angle of a spot.
    pub angles: [f64; 2],
}

/// The lights of a scene as planes `[1, L]`, in the coordinates of its triangles.
#[derive(Clone, Debug)]
pub(crate) struct LightPlanes {
    /// 0 of directional ones.
    pub position: Vec3,
    /// The unit vectors in which they shine.
    pub axis: Vec3,
    /// Intensity, or irradiance.
    pub strength: Vec3,
    pub cos_inner: Tensor<2>,
    pub cos_outer: Tensor<2>,
    pub kinds: Vec<LightKind>,
    /// The typical size of the scene, in their unit.
    pub size: f64,
}

impl LightPlanes {
    /// None where a scene has no lights.
    pub fn new(
        lights: &[Light],
        context: &Context,
        (centre, unit): (Vec3, f64),
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
                    sin_cos(angle).1
                }),
                _ => [number(1.0), number(-1.0)],
            };
            let axis = direction.map_or_else(away, plane);
            let (place, per_unit) = match position {
                Some(p) => (plane(p).sub(&centre).scale_by(unit.recip()), unit),
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
