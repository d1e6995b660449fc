//! Kinds of BSDFs and materials, and their parameters.

/// The largest η and k of a conductor: the fourth powers of larger ones come near what f32 holds.
pub const MAX_METAL_IOR: f64 = 1e4;
/// The least index of refraction of a dielectric.
pub const MIN_IOR: f64 = 0.1;
/// The largest index of refraction of a dielectric.
pub const MAX_IOR: f64 = 10.0;
/// Indices of refraction that are nearer to 1 count as this far from it: without a difference nothing is refracted.
pub const MIN_CONTRAST: f64 = 1e-3;

/// The model of a BSDF.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum BsdfKind {
    /// Lambert plus normalized Phong.
    #[default]
    Phong,
    /// The model of glTF 2.0.
    MetallicRoughness,
    /// A metal with a complex index of refraction.
    Conductor,
    /// Clear matter that reflects and refracts.
    Dielectric,
}

impl BsdfKind {
    /// Whether colors of a mesh multiply its base color.
    pub fn is_tinted(self) -> bool {
        matches!(self, Self::Phong | Self::MetallicRoughness)
    }

    /// Whether light passes the surface.
    pub const fn refracts(self) -> bool {
        matches!(self, Self::Dielectric)
    }
}

/// A parameter of a material.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Channel {
    /// Lambert's albedo k_d, RGB.
    Diffuse,
    /// The base color of glTF's model, RGB.
    BaseColor,
    /// The tint of a dielectric, RGB.
    Tint,
    /// Phong's albedo k_s, RGB.
    Specular,
    /// Phong's exponent.
    Shininess,
    /// The share of metal, in [0, 1].
    Metallic,
    /// The roughness of microfacets, in [0, 1].
    Roughness,
    /// The real part of a conductor's index of refraction, RGB.
    Eta,
    /// Its imaginary part, RGB.
    Extinction,
    /// The index of refraction of a dielectric.
    Ior,
    /// The radiance that the front side emits, RGB.
    Emission,
}

/// The number of places for parameters of a material: two colors and a number of its BSDF, and its emission.
pub const CHANNELS: usize = Channel::Emission.place() + 1;

impl Channel {
    /// The place of its numbers among those of a material: parameters of different BSDFs share one.
    pub const fn place(self) -> usize {
        match self {
            Self::Diffuse | Self::BaseColor | Self::Tint | Self::Eta => 0,
            Self::Specular | Self::Metallic | Self::Extinction | Self::Ior => 1,
            Self::Shininess | Self::Roughness => 2,
            Self::Emission => 3,
        }
    }
}

/// The parts that a material has: reflection, a specular lobe, emission.
#[derive(Clone, Copy, Debug, Default)]
pub struct MaterialKind {
    /// Whether it scatters any light.
    pub reflects: bool,
    /// Whether it has a specular part.
    pub glossy: bool,
    /// Whether its front emits.
    pub emits: bool,
    /// Whether what its front emits is not the same everywhere and in all directions.
    pub glows: bool,
    /// The model of its BSDF.
    pub bsdf: BsdfKind,
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
