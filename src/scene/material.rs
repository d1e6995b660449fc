//! Materials: BSDFs with their parameters, what constants of these may be, and emission.

use super::albedo::{Albedo, ScalarTexture, Value};
use super::parameter::{Parameter, Range};
use super::{AlphaMask, NormalMap};

/// The largest constant exponent of a Phong lobe, which is then a tenth of a degree wide: f32 resolves little less.
const MOST_SHININESS: f64 = 1e6;
/// The largest η and k of a conductor: the fourth powers of larger ones come near what f32 holds.
pub(crate) const MOST_OF_METAL: f64 = 1e4;
/// The least and the largest index of refraction of a dielectric.
pub(crate) const LEAST_IOR: f64 = 0.1;
pub(crate) const MOST_IOR: f64 = 10.0;
/// Indices of refraction that are nearer to 1 count as this far from it: without a difference nothing is refracted.
pub(crate) const LEAST_CONTRAST: f64 = 1e-3;

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

    /// Whether light passes the surface.
    pub(crate) const fn refracts(self) -> bool {
        matches!(self, Self::Dielectric)
    }

    /// Its parameters, each at its place ([`Channel::place`]).
    const fn channels(self) -> [Channel; 3] {
        use Channel::{Diffuse, Eta, Extinction, Ior, Metallic, Roughness, Shininess, Specular};
        match self {
            Self::Phong => [Diffuse, Specular, Shininess],
            Self::MetallicRoughness => [Diffuse, Metallic, Roughness],
            Self::Conductor => [Eta, Extinction, Roughness],
            Self::Dielectric => [Diffuse, Ior, Roughness],
        }
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

    /// The range of constants of BSDFs other than Phong's, and of an exponent.
    pub(super) fn constants(self) -> Range {
        match self {
            Self::Diffuse | Self::Metallic | Self::Roughness => Range::Share,
            Self::Specular => Range::NotNegative,
            Self::Shininess => Range::Within(0.0, MOST_SHININESS),
            Self::Eta | Self::Extinction => Range::Within(0.0, MOST_OF_METAL),
            Self::Ior => Range::Within(LEAST_IOR, MOST_IOR),
            Self::Emission => Range::Light,
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
    /// Whether what its front emits is not the same everywhere and in all directions.
    pub glows: bool,
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
            glows: self.glows || o.glows,
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

    /// The model of glTF 2.0: facets of the distribution GGX with α = roughness², Smith's masking, and a share of
    /// metal. Metal reflects its base colour; the rest reflects 4 % at its facets, and the base colour below them.
    /// Numbers are constants, tensors `[1]`, or textures `[H, W]`; glTF's image has the roughness in its green
    /// channel and the metal in its blue one.
    ///
    /// It is metallic times a metal of F₀ = base plus 1 − metallic times a coat of F₀ = 0.04 over a matt base, each
    /// without loss on its own, as glTF mixes them. Reflected is F·D·V (1 + F₀ (1 − E)/E) with F by Schlick from F₀, and
    /// the last factor gives back what light loses between facets (Turquin 2019; E is the albedo of white facets).
    /// Below the coat it is base/π · (1 − E_s(v)) (1 − E_s(l))/(1 − Ē_s), where E_s is what the coat reflects (Kelemen
    /// and Szirmay-Kalos 2001). E and E_s are fits: of white matter 97 % to 100.1 % of light come back up to 85° from
    /// the normal, whatever the metal and the roughness, and at most 103 % beyond.
    ///
    /// Constants are errors where they are outside of [0, 1]; a tensor or texel outside counts as the nearest number
    /// inside, so its derivative is 0 there. `MaterialParams` keeps fits inside.
    pub fn metallic_roughness(
        base_colour: impl Into<Albedo>,
        metallic: impl Into<ScalarTexture>,
        roughness: impl Into<ScalarTexture>,
    ) -> Self {
        Self {
            bsdf: Bsdf::MetallicRoughness,
            metallic: metallic.into(),
            roughness: roughness.into(),
            ..Self::diffuse(base_colour)
        }
    }

    /// A metal with the index of refraction η − i k, RGB, relative to what surrounds it: facets of the distribution
    /// GGX with α = roughness² reflect by Fresnel's equations. What light loses between facets is given back as by
    /// [`Material::metallic_roughness`], with F₀ the reflectance along the normal. η and k are in [0, 10⁴], the
    /// roughness in [0, 1]: what tensors have outside counts as the nearest number inside, with a derivative of 0.
    pub fn conductor(
        eta: impl Into<Parameter<3>>,
        extinction: impl Into<Parameter<3>>,
        roughness: impl Into<ScalarTexture>,
    ) -> Self {
        Self {
            bsdf: Bsdf::Conductor,
            eta: eta.into(),
            extinction: extinction.into(),
            roughness: roughness.into(),
            ..Self::diffuse([0.0; 3])
        }
    }

    /// Clear matter with an index of refraction inside (behind front faces) over that outside: facets of the
    /// distribution GGX with α = roughness² reflect and refract by Fresnel's equations (Walter et al. 2007). With a
    /// roughness of 0 it is as good as smooth: α is 0.001. Shadow rays do not pass: light behind it is found by
    /// refracted rays, so it takes bounces, two for a solid body.
    ///
    /// All is divided by the albedo E of both parts, a fit by the view's cosine, α and the index, which gives back what
    /// is lost between facets (Turquin 2019); so roles of light and eye can't be exchanged where it is rough. Of clear
    /// glass 97 % to 100.1 % of light are kept up to 85° from the normal, for indices up to 2.6; where light leaves an index
    /// between 1 and 1.4, at least 94 %. A larger index than 2.6 has the fit of 2.6, so that rough glass is darker there.
    ///
    /// The index is in [0.1, 10] and at least 0.001 away from 1, the roughness in [0, 1]: what tensors have outside
    /// counts as the nearest number inside, with a derivative of 0.
    pub fn dielectric(ior: impl Into<ScalarTexture>, roughness: impl Into<ScalarTexture>) -> Self {
        Self {
            bsdf: Bsdf::Dielectric,
            ior: ior.into(),
            roughness: roughness.into(),
            ..Self::diffuse([1.0; 3])
        }
    }

    /// Sets whether light that is lost between the facets of metal or glass is given back, as it is without this.
    pub fn compensated(mut self, compensated: bool) -> Self {
        self.compensated = compensated;
        self
    }

    /// Sets the radiance that the front side emits, RGB.
    pub fn emission(mut self, radiance: impl Into<Albedo>) -> Self {
        self.emission = radiance.into();
        self
    }

    /// All of its parameters, in the order of their places ([`Channel::place`]).
    pub(super) fn all_channels(&mut self) -> [(Channel, Value<'_>); 9] {
        [
            (Channel::Diffuse, self.diffuse.value()),
            (Channel::Eta, Value::Colour(&mut self.eta)),
            (Channel::Specular, self.specular.value()),
            (Channel::Metallic, self.metallic.value()),
            (Channel::Extinction, Value::Colour(&mut self.extinction)),
            (Channel::Ior, self.ior.value()),
            (Channel::Shininess, Value::Scalar(&mut self.shininess)),
            (Channel::Roughness, self.roughness.value()),
            (Channel::Emission, self.emission.value()),
        ]
    }

    /// The parameters of its BSDF and its emission, each at its place ([`Channel::place`]): the one list that tensors,
    /// checks, the packed scene and gradients are made from.
    pub(crate) fn channels(&mut self) -> impl Iterator<Item = (Channel, Value<'_>)> {
        let used = self.bsdf.channels();
        let is_used = move |c: Channel| c == Channel::Emission || used.contains(&c);
        let all = self.all_channels().into_iter();
        all.filter(move |(channel, _)| is_used(*channel))
    }

    /// The parts that it has. A parameter in a graph counts as present, since a fit may change it.
    pub(crate) fn kind(&self) -> MaterialKind {
        let facets = self.bsdf != Bsdf::Phong;
        let glossy = facets || self.specular.reflects();
        MaterialKind {
            glossy,
            reflects: glossy || self.diffuse.reflects(),
            emits: self.emits(),
            glows: self.glows(),
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
