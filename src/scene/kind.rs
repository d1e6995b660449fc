//! What parts materials have.

use super::albedo::Albedo;
use super::material::{Bsdf, Material};

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

impl Material {
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
