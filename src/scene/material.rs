use burn::tensor::Tensor;

use super::parameter::Range;
use super::{AlphaMask, NormalMap, Parameter};
use crate::error::{Error, Result};

/// How texture coordinates outside of [0, 1] are mapped into the image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wrap {
    /// Tiles.
    #[default]
    Repeat,
    /// The border's texel goes on.
    Clamp,
    /// Tiles, every other one mirrored.
    Mirror,
}

impl Wrap {
    /// The texel for any integer coordinate.
    pub(crate) fn texel(self, i: i64, size: usize) -> usize {
        let n = size as i64;
        match self {
            Self::Repeat => i.rem_euclid(n) as usize,
            Self::Clamp => i.clamp(0, n - 1) as usize,
            Self::Mirror => {
                let j = i.rem_euclid(2 * n);
                (if j < n { j } else { 2 * n - 1 - j }) as usize
            }
        }
    }
}

/// The value of what may have several forms: a parameter of a material, or an environment.
pub(crate) enum Value<'a> {
    Colour(&'a mut Parameter<3>),
    Image(&'a mut Tensor<3>, Wrap),
    Scalar(&'a mut Parameter<1>),
}

/// An albedo: a constant RGB, or a texture.
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
    fn constant(&self) -> Option<[f64; 3]> {
        match self {
            Self::Constant(Parameter::Constant(v)) => Some(*v),
            _ => None,
        }
    }
}

/// A parameter of a material.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Channel {
    Diffuse,
    Specular,
    Shininess,
    Emission,
}

/// The number of parameters of a material.
pub(crate) const CHANNELS: usize = Channel::ALL.len();

impl Channel {
    pub const ALL: [Self; 4] = [
        Self::Diffuse,
        Self::Specular,
        Self::Shininess,
        Self::Emission,
    ];

    /// The name in messages and the range of its values.
    pub fn row(self) -> (&'static str, Range) {
        match self {
            Self::Diffuse => ("diffuse", Range::Finite),
            Self::Specular => ("specular", Range::Finite),
            Self::Shininess => ("shininess", Range::NotNegative),
            Self::Emission => ("emission", Range::Finite),
        }
    }

    /// Whether the directions drawn from the BSDF of a glossy surface depend on it.
    pub fn turns(self) -> bool {
        self == Self::Shininess
    }
}

/// The parts that a material has: reflection, a specular lobe, emission.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct MaterialKind {
    /// Whether it reflects any light.
    pub reflects: bool,
    /// Whether it has a specular part.
    pub glossy: bool,
    pub emits: bool,
}

impl MaterialKind {
    /// The parts that either has.
    pub fn or(self, o: Self) -> Self {
        Self {
            reflects: self.reflects || o.reflects,
            glossy: self.glossy || o.glossy,
            emits: self.emits || o.emits,
        }
    }

    /// The number of parameters of its BSDF, which are the first ones of [`Channel::ALL`].
    #[inline(always)]
    pub fn shading(self) -> usize {
        if self.glossy { 3 } else { 1 }
    }
}

/// Lambert plus normalised Phong, and emission:
/// f = k_d/π + k_s (n + 2)/(2π) cosⁿα.
#[derive(Clone)]
pub struct Material {
    /// The name in messages.
    pub name: String,
    /// k_d.
    pub diffuse: Albedo,
    /// k_s.
    pub specular: Albedo,
    /// The exponent n ≥ 0.
    pub shininess: Parameter<1>,
    /// Radiance of the front side, RGB.
    pub emission: Parameter<3>,
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
            diffuse: albedo.into(),
            specular: Albedo::Constant(Parameter::Constant([0.0; 3])),
            shininess: Parameter::Constant([1.0]),
            emission: Parameter::Constant([0.0; 3]),
            normal_map: None,
            alpha_mask: None,
        }
    }

    /// A black surface that emits radiance from its front side.
    pub fn emitter(radiance: impl Into<Parameter<3>>) -> Self {
        Self::diffuse([0.0; 3]).emission(radiance)
    }

    /// Sets the name, which messages show.
    pub fn named(mut self, name: impl Into<String>) -> Self {
        self.name = name.into();
        self
    }

    /// Sets a Phong lobe with an albedo k_s in [0, 1], such that diffuse + specular ≤ 1, and an exponent ≥ 0.
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
    pub fn emission(mut self, radiance: impl Into<Parameter<3>>) -> Self {
        self.emission = radiance.into();
        self
    }

    /// Its parameters, in the order of [`Channel::ALL`]: the one list that tensors, checks, the packed
    /// scene and gradients are made from.
    pub(crate) fn channels(&mut self) -> [Value<'_>; CHANNELS] {
        [
            self.diffuse.value(),
            self.specular.value(),
            Value::Scalar(&mut self.shininess),
            Value::Colour(&mut self.emission),
        ]
    }

    /// The parts that it has. A parameter in a graph counts as present, since a fit may change it.
    pub(crate) fn kind(&self) -> MaterialKind {
        let glossy = self.specular.reflects();
        MaterialKind {
            glossy,
            reflects: glossy || self.diffuse.reflects(),
            emits: self.emits(),
        }
    }

    /// Whether its emission may be other than 0: false only for a constant 0.
    pub(crate) fn emits(&self) -> bool {
        !matches!(self.emission, Parameter::Constant(v) if v.iter().all(|&x| x == 0.0))
    }

    /// That constants make no energy. Tensors may wander outside for a step of a fit.
    pub(crate) fn check_energy(&self, name: &str) -> Result<()> {
        let (kd, ks) = (self.diffuse.constant(), self.specular.constant());
        for (field, albedo) in [("diffuse", kd), ("specular", ks)] {
            Range::NotNegative.check(name, field, albedo.as_ref().map_or(&[], |v| v))?;
        }
        let (Some(d), Some(s)) = (kd, ks) else {
            return Ok(());
        };
        let sum: [f64; 3] = std::array::from_fn(|i| d[i] + s[i]);
        if sum.iter().all(|&x| x <= 1.0 + 1e-6) {
            return Ok(());
        }
        let field = match (self.diffuse.reflects(), self.specular.reflects()) {
            (_, false) => "diffuse",
            (false, _) => "specular",
            _ => "diffuse + specular",
        };
        let expected = "at most 1, or energy is made";
        Err(Error::invalid(name, field, format!("{sum:?}"), expected))
    }
}

/// The radiance that arrives from infinity where rays miss all surfaces.
#[derive(Clone)]
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

    pub(super) fn value(&mut self) -> Value<'_> {
        match self {
            Self::Constant(p) => Value::Colour(p),
            Self::Map(texels) => Value::Image(texels, Wrap::Repeat),
        }
    }
}
