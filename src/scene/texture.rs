//! Values over surfaces: constants or textures.

use burn::tensor::Tensor;

use super::Parameter;
use crate::geometry::any_positive;
use softray_kernels::host::Wrap;

/// The value of what may have several forms: a parameter of a material, or an environment.
pub(crate) enum Value<'a> {
    Color(&'a mut Parameter<3>),
    Image(&'a mut Tensor<3>, Wrap),
    Scalar(&'a mut Parameter<1>),
    /// `[H, W]`, numbers that are the first of three.
    ScalarImage(&'a mut Tensor<2>, Wrap),
}

impl Value<'_> {
    /// Its numbers, where it is neither a texture nor a tensor.
    pub(super) fn constants(&self) -> &[f64] {
        match self {
            Self::Color(Parameter::Constant(v)) => v.as_slice(),
            Self::Scalar(Parameter::Constant(v)) => v.as_slice(),
            _ => &[],
        }
    }
}

/// A color over a surface, such as an albedo or the radiance of an emitter: a constant RGB, or a texture.
///
/// [`ScalarTexture`] has an example.
#[derive(Clone)]
#[cfg_attr(feature = "remote", derive(serde::Serialize, serde::Deserialize))]
pub enum ColorTexture {
    /// RGB.
    Constant(Parameter<3>),
    /// `[H, W, 3]`, row 0 at the top (v = 1), looked up bilinearly; texel centers at half-integers.
    Texture {
        /// The texels.
        #[cfg_attr(feature = "remote", serde(with = "super::slots::tensor"))]
        texels: Tensor<3>,
        /// Outside of the unit square.
        wrap: Wrap,
    },
}

impl<P: Into<Parameter<3>>> From<P> for ColorTexture {
    fn from(p: P) -> Self {
        Self::Constant(p.into())
    }
}

impl ColorTexture {
    /// A texture `[H, W, 3]` that repeats.
    pub fn texture(texels: Tensor<3>) -> Self {
        Self::Texture {
            texels,
            wrap: Wrap::Repeat,
        }
    }

    /// Whether it may be other than 0: false only for a constant 0.
    pub(crate) fn reflects(&self) -> bool {
        self.constant() != Some([0.0; 3])
    }

    /// Whether any of its values is above 0.
    pub(crate) fn shines(&self) -> bool {
        match self {
            Self::Constant(p) => p.shines(),
            Self::Texture { texels, .. } => any_positive(texels),
        }
    }

    /// Replaces a texture by its mean. Returns whether it was one.
    pub(super) fn take_mean(&mut self) -> bool {
        let Self::Texture { texels, .. } = self else {
            return false;
        };
        let mean: Tensor<1> = texels.clone().mean_dim(0).mean_dim(1).reshape([3]);
        *self = mean.into();
        true
    }

    pub(super) fn value(&mut self) -> Value<'_> {
        match self {
            Self::Constant(p) => Value::Color(p),
            Self::Texture { texels, wrap } => Value::Image(texels, *wrap),
        }
    }

    /// Its numbers, where it is neither a texture nor a tensor.
    pub(super) fn constant(&self) -> Option<[f64; 3]> {
        match self {
            Self::Constant(Parameter::Constant(v)) => Some(*v),
            _ => None,
        }
    }
}

/// A number of a material: a constant, or a texture of one channel.
///
/// ```
/// use softray::prelude::*;
/// let device = Device::flex();
/// let colors = ColorTexture::texture(Tensor::ones([1, 2, 3], &device));
/// let roughness = ScalarTexture::texture(Tensor::from_floats([[0.1, 0.9]], &device));
/// let material = Material::metallic_roughness(colors, 0.0, roughness);
/// assert!(matches!(material.bsdf, Bsdf::MetallicRoughness { .. }));
/// ```
#[derive(Clone)]
#[cfg_attr(feature = "remote", derive(serde::Serialize, serde::Deserialize))]
pub enum ScalarTexture {
    /// One number.
    Constant(Parameter<1>),
    /// `[H, W]`, row 0 at the top (v = 1), looked up bilinearly; texel centers at half-integers.
    Texture {
        /// The texels.
        #[cfg_attr(feature = "remote", serde(with = "super::slots::tensor"))]
        texels: Tensor<2>,
        /// Outside of the unit square.
        wrap: Wrap,
    },
}

impl<P: Into<Parameter<1>>> From<P> for ScalarTexture {
    fn from(p: P) -> Self {
        Self::Constant(p.into())
    }
}

impl ScalarTexture {
    /// A texture `[H, W]` that repeats.
    pub fn texture(texels: Tensor<2>) -> Self {
        Self::Texture {
            texels,
            wrap: Wrap::Repeat,
        }
    }

    /// Replaces a texture by its mean. Returns whether it was one.
    pub(super) fn take_mean(&mut self) -> bool {
        let Self::Texture { texels, .. } = self else {
            return false;
        };
        *self = texels.clone().mean().into();
        true
    }

    pub(super) fn value(&mut self) -> Value<'_> {
        match self {
            Self::Constant(p) => Value::Scalar(p),
            Self::Texture { texels, wrap } => Value::ScalarImage(texels, *wrap),
        }
    }
}
