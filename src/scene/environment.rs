//! Light from infinity.

use burn::tensor::Tensor;

use super::texture::Value;
use super::{Parameter, Wrap};
use crate::geometry::any_positive;

/// The radiance that arrives from infinity along rays that miss all surfaces.
///
/// [`EnvironmentParams`](crate::modules::EnvironmentParams) has an example.
#[derive(Clone)]
#[cfg_attr(feature = "remote", derive(serde::Serialize, serde::Deserialize))]
pub enum Environment {
    /// The same radiance from all directions, RGB.
    Constant(Parameter<3>),
    /// An equirectangular map of radiance `[H, W, 3]`, interpolated bilinearly.
    /// Row 0 is about +y, the last row about −y. The middle column is towards −z, columns to its right are towards +x.
    Map(#[cfg_attr(feature = "remote", serde(with = "super::slots::tensor"))] Tensor<3>),
}

impl<P: Into<Parameter<3>>> From<P> for Environment {
    fn from(p: P) -> Self {
        Self::Constant(p.into())
    }
}

impl Environment {
    /// Creates an environment from an equirectangular map of radiance `[H, W, 3]`; see [`Environment::Map`].
    pub fn map(texels: Tensor<3>) -> Self {
        Self::Map(texels)
    }

    /// Whether the radiance may be other than 0. False only for a constant 0.
    pub(crate) fn shines(&self) -> bool {
        !matches!(self, Self::Constant(Parameter::Constant(v)) if *v == [0.0; 3])
    }

    /// Whether any value is above 0 or can't be read.
    pub(super) fn has_light(&self) -> bool {
        match self {
            Self::Constant(p) => p.shines(),
            Self::Map(texels) => any_positive(texels),
        }
    }

    pub(super) fn value(&mut self) -> Value<'_> {
        match self {
            Self::Constant(p) => Value::Color(p),
            Self::Map(texels) => Value::Image(texels, Wrap::Repeat),
        }
    }
}
