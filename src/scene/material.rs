use burn::tensor::Tensor;

use super::parameter::Range;
use super::wrap::Wrap;
use super::{AlphaMask, NormalMap, Parameter};

/// The value of what may have several forms: a parameter of a material, or an environment.
pub(crate) enum Value<'a> {
    Colour(&'a mut Parameter<3>),
    Image(&'a mut Tensor<3>, Wrap),
    Scalar(&'a mut Parameter<1>),
    /// `[H, W]`, numbers that are the first of three.
    ScalarImage(&'a mut Tensor<2>, Wrap),
}

/// An albedo, or the radiance of an emitter: a constant RGB, or a texture.
#[derive(Clone)]
pub enum Albedo {
    /// RGB.
    Constant(Parameter<3>),
    /// `[H, W, 3]`, row 0 at the top (v = 1), looked up bilinearly; texel centres at half-integers.
    Texture {
        /// The texels.
        texels: Tensor<3>,
        /// Outside of the unit square.
        wrap: Wrap,
    },
}

impl<P: Into<Parameter<3>>> From<P> for Albedo {
    fn from(p: P) -> Self {
        Self::Constant(p.into())
    }
}

impl Albedo {
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

    fn value(&mut self) -> Value<'_> {
        match self {
            Self::Constant(p) => Value::Colour(p),
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
#[derive(Clone)]
pub enum ScalarTexture {
    /// One number.
    Constant(Parameter<1>),
    /// `[H, W]`, row 0 at the top (v = 1), looked up bilinearly; texel centres at half-integers.
    Texture {
        /// The texels.
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

    fn value(&mut self) -> Value<'_> {
        match self {
            Self::Constant(p) => Value::Scalar(p),
            Self::Texture { texels, wrap } => Value::ScalarImage(texels, *wrap),
        }
    }
}

/// The way in which a surface scatters light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Bsdf {
    /// Lambert plus normalised Phong ([`Material::diffuse`], [`Material::specular`]).
    #[default]
    Phong,
    /// That of glTF 2.0 ([`Material::metallic_roughness`]).
    MetallicRoughness,
    /// A metal by its complex index of refraction ([`Material::conductor`]).
    Conductor,
    /// Clear matter, which reflects and refracts ([`Material::dielectric`]).
    Dielectric,
}

impl Bsdf {
    /// Whether colours of a mesh multiply its base colour.
    pub(crate) fn is_tinted(self) -> bool {
        matches!(self, Self::Phong | Self::MetallicRoughness)
    }
}

/// A parameter of a material.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Channel {
    Diffuse,
    Specular,
    Shininess,
    Metallic,
    Roughness,
    Eta,
    Extinction,
    Ior,
    Emission,
}

/// The number of places for parameters of a material: two colours and a number of its BSDF, and its emission.
pub(crate) const CHANNELS: usize = Channel::Emission.place() + 1;

impl Channel {
    /// The place of its numbers among those of a material: parameters of different BSDFs share one.
    pub const fn place(self) -> usize {
        match self {
            Self::Diffuse | Self::Eta => 0,
            Self::Specular | Self::Metallic | Self::Extinction | Self::Ior => 1,
            Self::Shininess | Self::Roughness => 2,
            Self::Emission => 3,
        }
    }

    /// The name in messages and the range of its values. Tensors of a fit may wander out of a share for a step.
    pub fn row(self) -> (&'static str, Range) {
        match self {
            Self::Diffuse => ("diffuse", Range::Finite),
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

    /// Whether the directions drawn from the BSDF of a glossy surface depend on it.
    pub fn turns(self) -> bool {
        matches!(self, Self::Shininess | Self::Roughness | Self::Ior)
    }
}

/// The parts that a material has: reflection, a specular lobe, emission.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct MaterialKind {
    /// Whether it scatters any light.
    pub reflects: bool,
    /// Whether it has a specular part.
    pub glossy: bool,
    pub emits: bool,
    pub bsdf: Bsdf,
    /// Whether light lost between facets is given back.
    pub compensated: bool,
}

impl MaterialKind {
    /// The parts that either has.
    pub fn or(self, o: Self) -> Self {
        Self {
            reflects: self.reflects || o.reflects,
            glossy: self.glossy || o.glossy,
            emits: self.emits || o.emits,
            ..self
        }
    }

    /// The number of parameters of its BSDF, which have the first places ([`Channel::place`]).
    #[inline(always)]
    pub fn shading(self) -> usize {
        if self.glossy { 3 } else { 1 }
    }
}

/// A BSDF and emission. Without more it is Lambert plus normalised Phong:
/// f = k_d/π + k_s (n + 2)/(2π) cosⁿα.
#[derive(Clone)]
pub struct Material {
    /// The name in messages.
    pub name: String,
    /// The way in which it scatters light, which says what of the parameters counts.
    pub bsdf: Bsdf,
    /// k_d; the base colour of metal and roughness.
    pub diffuse: Albedo,
    /// k_s.
    pub specular: Albedo,
    /// The exponent n ≥ 0; a constant is at most 10⁶.
    pub shininess: Parameter<1>,
    /// The share of metal in [0, 1].
    pub metallic: ScalarTexture,
    /// The roughness in [0, 1] of facets: α = roughness², at least 0.001.
    pub roughness: ScalarTexture,
    /// The real part η of a conductor's index of refraction, RGB.
    pub eta: Parameter<3>,
    /// The imaginary part k of a conductor's index of refraction, RGB.
    pub extinction: Parameter<3>,
    /// The index of refraction of a dielectric's inside over that of its outside.
    pub ior: ScalarTexture,
    /// Whether light that is lost between the facets of metal or glass is given back.
    pub compensated: bool,
    /// Radiance of the front side, RGB; a texture is for cones.
    pub emission: Albedo,
    /// Tilts of the shading normal.
    pub normal_map: Option<NormalMap>,
    /// Holes.
    pub alpha_mask: Option<AlphaMask>,
}

impl Default for Material {
    fn default() -> Self {
        Self::diffuse([0.5; 3])
    }
}

impl Material {
    /// A Lambertian surface.
    pub fn diffuse(albedo: impl Into<Albedo>) -> Self {
        Self {
            name: "material".into(),
            bsdf: Bsdf::Phong,
            diffuse: albedo.into(),
            specular: Albedo::Constant(Parameter::Constant([0.0; 3])),
            shininess: Parameter::Constant([1.0]),
            metallic: 0.0.into(),
            roughness: 1.0.into(),
            eta: Parameter::Constant([0.0; 3]),
            extinction: Parameter::Constant([1.0; 3]),
            ior: 1.5.into(),
            compensated: true,
            emission: [0.0; 3].into(),
            normal_map: None,
            alpha_mask: None,
        }
    }

    /// A black surface that emits radiance from its front side.
    pub fn emitter(radiance: impl Into<Albedo>) -> Self {
        Self::diffuse([0.0; 3]).emission(radiance)
    }

    /// Sets the name, which messages show.
    pub fn named(mut self, name: impl Into<String>) -> Self {
        self.name = name.into();
        self
    }

    /// Sets a Phong lobe with an albedo k_s in [0, 1], such that diffuse + specular ≤ 1, and an exponent in [0, 10⁶].
    pub fn specular(
        mut self,
        albedo: impl Into<Albedo>,
        shininess: impl Into<Parameter<1>>,
    ) -> Self {
        self.specular = albedo.into();
        self.shininess = shininess.into();
        self
    }

    /// Sets the radiance that the front side emits, RGB.
    pub fn emission(mut self, radiance: impl Into<Albedo>) -> Self {
        self.emission = radiance.into();
        self
    }

    /// Its parameters, each at its place ([`Channel::place`]): the one list that tensors, checks, the packed
    /// scene and gradients are made from.
    pub(crate) fn channels(&mut self) -> [(Channel, Value<'_>); CHANNELS] {
        use Channel::{Diffuse, Emission, Eta, Extinction, Ior, Metallic};
        let number = match self.bsdf {
            Bsdf::Phong => (Channel::Shininess, Value::Scalar(&mut self.shininess)),
            _ => (Channel::Roughness, self.roughness.value()),
        };
        let [first, second] = match self.bsdf {
            Bsdf::Phong => [
                (Diffuse, self.diffuse.value()),
                (Channel::Specular, self.specular.value()),
            ],
            Bsdf::MetallicRoughness => [
                (Diffuse, self.diffuse.value()),
                (Metallic, self.metallic.value()),
            ],
            Bsdf::Conductor => [
                (Eta, Value::Colour(&mut self.eta)),
                (Extinction, Value::Colour(&mut self.extinction)),
            ],
            Bsdf::Dielectric => [(Diffuse, self.diffuse.value()), (Ior, self.ior.value())],
        };
        let emission = (Emission, self.emission.value());
        [first, second, number, emission]
    }

    /// The parts that it has. A parameter in a graph counts as present, since a fit may change it.
    pub(crate) fn kind(&self) -> MaterialKind {
        let facets = self.bsdf != Bsdf::Phong;
        let glossy = facets || self.specular.reflects();
        MaterialKind {
            glossy,
            reflects: glossy || self.diffuse.reflects(),
            emits: self.emits(),
            bsdf: self.bsdf,
            compensated: facets && self.compensated,
        }
    }

    /// Whether its emission may be other than 0: false only for a constant 0.
    pub(crate) fn emits(&self) -> bool {
        self.emission.reflects()
    }

    /// Whether its emission is a texture.
    pub(crate) fn glows(&self) -> bool {
        matches!(self.emission, Albedo::Texture { .. })
    }
}
