//! BSDFs with their parameters, and what constants of these may be.

use super::parameter::{Described, Parameter, Range};
use super::texture::{ColorTexture, ScalarTexture, Value};
use softray_kernels::host::{BsdfKind, Channel, MAX_IOR, MAX_METAL_IOR, MIN_IOR};

/// The largest constant exponent of a Phong lobe, which is then a tenth of a degree wide: f32 resolves little less.
const MAX_SHININESS: f64 = 1e6;

/// How a surface scatters light: a model with its parameters.
///
/// [`ScalarTexture`] has an example.
#[derive(Clone, Debug)]
#[non_exhaustive]
#[cfg_attr(feature = "remote", derive(serde::Serialize, serde::Deserialize))]
pub enum Bsdf {
    /// Lambert plus normalized Phong: f = k_d/π + k_s (n + 2)/(2π) cosⁿα ([`Material::diffuse`](super::Material::diffuse), [`Material::phong`](super::Material::phong)).
    Phong {
        /// k_d.
        diffuse: ColorTexture,
        /// k_s.
        specular: ColorTexture,
        /// The exponent n ≥ 0; a constant is at most 10⁶.
        shininess: Parameter<1>,
    },
    /// The model of glTF 2.0 ([`Material::metallic_roughness`](super::Material::metallic_roughness)).
    MetallicRoughness {
        /// The reflectance of the metal along the normal, and the albedo of the matt base.
        base_color: ColorTexture,
        /// The share of metal in [0, 1].
        metallic: ScalarTexture,
        /// The roughness in [0, 1]: α = roughness², at least 0.001.
        roughness: ScalarTexture,
        /// Whether light that scatters several times between microfacets is added.
        compensated: bool,
    },
    /// A metal ([`Material::conductor`](super::Material::conductor)).
    Conductor {
        /// The real part η of the complex index of refraction, RGB.
        eta: Parameter<3>,
        /// The imaginary part k of the complex index of refraction, RGB.
        extinction: Parameter<3>,
        /// The roughness in [0, 1]: α = roughness², at least 0.001.
        roughness: ScalarTexture,
        /// Whether light that scatters several times between microfacets is added.
        compensated: bool,
    },
    /// Clear matter that reflects and refracts ([`Material::dielectric`](super::Material::dielectric)).
    Dielectric {
        /// A factor of the light that is reflected and refracted.
        tint: ColorTexture,
        /// The index of refraction inside over that outside.
        ior: ScalarTexture,
        /// The roughness in [0, 1]: α = roughness², at least 0.001.
        roughness: ScalarTexture,
        /// Whether light that scatters several times between microfacets is added.
        compensated: bool,
    },
}

impl Bsdf {
    pub(crate) fn kind(&self) -> BsdfKind {
        match self {
            Self::Phong { .. } => BsdfKind::Phong,
            Self::MetallicRoughness { .. } => BsdfKind::MetallicRoughness,
            Self::Conductor { .. } => BsdfKind::Conductor,
            Self::Dielectric { .. } => BsdfKind::Dielectric,
        }
    }

    /// The albedo of Lambert's part, a base color or a tint; `None` for a conductor.
    pub(crate) fn base(&self) -> Option<&ColorTexture> {
        match self {
            Self::Phong { diffuse: base, .. }
            | Self::MetallicRoughness {
                base_color: base, ..
            }
            | Self::Dielectric { tint: base, .. } => Some(base),
            Self::Conductor { .. } => None,
        }
    }

    /// The albedo of Phong's lobe and its exponent, where it may be other than 0.
    pub(crate) fn lobe(&self) -> Option<(&ColorTexture, &Parameter<1>)> {
        match self {
            Self::Phong {
                specular,
                shininess,
                ..
            } if specular.reflects() => Some((specular, shininess)),
            _ => None,
        }
    }

    /// Whether multiple scattering between microfacets is added.
    pub(crate) fn is_compensated(&self) -> bool {
        match self {
            Self::Phong { .. } => false,
            Self::MetallicRoughness { compensated, .. }
            | Self::Conductor { compensated, .. }
            | Self::Dielectric { compensated, .. } => *compensated,
        }
    }

    /// Its parameters that may be textures: colors and numbers.
    pub(super) fn textures(&mut self) -> (Vec<&mut ColorTexture>, Vec<&mut ScalarTexture>) {
        match self {
            Self::Phong {
                diffuse, specular, ..
            } => (vec![diffuse, specular], vec![]),
            Self::MetallicRoughness {
                base_color,
                metallic,
                roughness,
                ..
            } => (vec![base_color], vec![metallic, roughness]),
            Self::Conductor { roughness, .. } => (vec![], vec![roughness]),
            Self::Dielectric {
                tint,
                ior,
                roughness,
                ..
            } => (vec![tint], vec![ior, roughness]),
        }
    }

    /// Its parameters in the order of their places ([`Channel::place`]).
    pub(super) fn channels(&mut self) -> [(Channel, Value<'_>); 3] {
        match self {
            Self::Phong {
                diffuse,
                specular,
                shininess,
            } => [
                (Channel::Diffuse, diffuse.value()),
                (Channel::Specular, specular.value()),
                (Channel::Shininess, Value::Scalar(shininess)),
            ],
            Self::MetallicRoughness {
                base_color,
                metallic,
                roughness,
                ..
            } => [
                (Channel::BaseColor, base_color.value()),
                (Channel::Metallic, metallic.value()),
                (Channel::Roughness, roughness.value()),
            ],
            Self::Conductor {
                eta,
                extinction,
                roughness,
                ..
            } => [
                (Channel::Eta, Value::Color(eta)),
                (Channel::Extinction, Value::Color(extinction)),
                (Channel::Roughness, roughness.value()),
            ],
            Self::Dielectric {
                tint,
                ior,
                roughness,
                ..
            } => [
                (Channel::Tint, tint.value()),
                (Channel::Ior, ior.value()),
                (Channel::Roughness, roughness.value()),
            ],
        }
    }
}

impl Described for Channel {
    /// Tensors of a fit may wander out of a share for a step.
    fn described(self) -> (&'static str, Range) {
        match self {
            Self::Diffuse => ("diffuse", Range::Finite),
            Self::BaseColor => ("base_color", Range::Finite),
            Self::Tint => ("tint", Range::Finite),
            Self::Specular => ("specular", Range::Finite),
            Self::Shininess => ("shininess", Range::NotNegative),
            Self::Metallic => ("metallic", Range::Finite),
            Self::Roughness => ("roughness", Range::Finite),
            Self::Eta => ("eta", Range::Finite),
            Self::Extinction => ("extinction", Range::Finite),
            Self::Ior => ("ior", Range::Positive),
            Self::Emission => ("emission", Range::Light),
        }
    }
}

/// The range of constants of BSDFs other than Phong's, and of an exponent.
pub(super) fn range_of_constants(channel: Channel) -> Range {
    match channel {
        Channel::BaseColor | Channel::Tint | Channel::Metallic | Channel::Roughness => Range::Share,
        Channel::Diffuse | Channel::Specular => Range::NotNegative,
        Channel::Shininess => Range::Within(0.0, MAX_SHININESS),
        Channel::Eta | Channel::Extinction => Range::Within(0.0, MAX_METAL_IOR),
        Channel::Ior => Range::Within(MIN_IOR, MAX_IOR),
        Channel::Emission => Range::Light,
    }
}
