use burn::tensor::Tensor;

use super::Parameter;
use crate::error::{Error, Result};
use crate::geometry::first_not_finite;

/// The radiance that arrives from infinity where rays miss all surfaces.
#[derive(Clone)]
// A tensor is a handle of some words; boxing it would cost more than it saves.
#[allow(clippy::large_enum_variant)]
pub enum Environment {
    /// The same radiance from all directions, RGB.
    Constant(Parameter<3>),
    /// An equirectangular map of radiance `[H, W, 3]`, looked up bilinearly: row 0 about +y, the last
    /// about −y; the middle column towards −z, columns to its right towards +x.
    Map(Tensor<3>),
}

impl<P: Into<Parameter<3>>> From<P> for Environment {
    fn from(p: P) -> Self {
        Self::Constant(p.into())
    }
}

impl Environment {
    /// An equirectangular map of radiance `[H, W, 3]`; see [`Environment::Map`].
    pub fn map(texels: Tensor<3>) -> Self {
        Self::Map(texels)
    }

    /// Whether its radiance may be other than 0: false only for a constant 0.
    pub(crate) fn shines(&self) -> bool {
        !matches!(self, Self::Constant(Parameter::Constant(v)) if *v == [0.0; 3])
    }

    pub(crate) fn check(&self) -> Result<()> {
        let texels = match self {
            Self::Constant(p) => {
                p.check("scene", "environment", "finite numbers", |_| true)?;
                return Ok(());
            }
            Self::Map(texels) => texels,
        };
        let [h, w, c] = texels.dims();
        if h == 0 || w == 0 || c != 3 {
            let found = format!("of shape [{h}, {w}, {c}]");
            return Err(Error::invalid(
                "scene",
                "environment",
                found,
                "shape [H, W, 3]",
            ));
        }
        match first_not_finite(texels)? {
            Some((i, value)) => Err(Error::invalid(
                "scene",
                format!("environment texel ({}, {})", i / 3 / w, i / 3 % w),
                value,
                "finite numbers",
            )),
            None => Ok(()),
        }
    }
}
