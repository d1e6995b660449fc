//! What parts materials have.

use super::Bsdf;

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
