//! Materials of facets, and what constants of a BSDF may be.

use super::Scene;
use super::material::{Albedo, Bsdf, Material, ScalarTexture};
use super::parameter::{Parameter, Range};
use crate::error::{Error, Result};

/// The largest constant exponent of a Phong lobe, which is then a tenth of a degree wide: f32 resolves little less.
const MOST_SHININESS: f64 = 1e6;
/// The largest η and k of a conductor: the fourth powers of larger ones come near what f32 holds.
pub(crate) const MOST_OF_METAL: f64 = 1e4;
/// The least and the largest index of refraction of a dielectric.
pub(crate) const LEAST_IOR: f64 = 0.1;
pub(crate) const MOST_IOR: f64 = 10.0;
/// Indices of refraction that are nearer to 1 count as this far from it: without a difference nothing is refracted.
pub(crate) const LEAST_CONTRAST: f64 = 1e-3;

impl Scene {
    /// Whether any material refracts.
    pub(crate) fn refracts(&self) -> bool {
        let mut all = self.objects.iter().flat_map(|o| &o.materials);
        all.any(|m| m.bsdf == Bsdf::Dielectric)
    }
}

impl Material {
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

    /// That constants make no energy and are in their ranges. Tensors may wander outside for a step of a fit.
    pub(crate) fn check_energy(&self, name: &str) -> Result<()> {
        let (kd, ks) = (self.diffuse.constant(), self.specular.constant());
        for (field, albedo) in [("diffuse", kd), ("specular", ks)] {
            Range::NotNegative.check(name, field, albedo.as_ref().map_or(&[], |v| v))?;
        }
        if self.bsdf != Bsdf::Phong {
            return self.check_facets(name);
        }
        if let Parameter::Constant(n) = &self.shininess {
            Range::Within(0.0, MOST_SHININESS).check(name, "shininess", n)?;
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

    fn check_facets(&self, name: &str) -> Result<()> {
        let number = |p: &ScalarTexture| match p {
            ScalarTexture::Constant(Parameter::Constant(v)) => v.to_vec(),
            _ => Vec::new(),
        };
        let colour = |p: &Parameter<3>| match p {
            Parameter::Constant(v) => v.to_vec(),
            Parameter::Tensor(_) => Vec::new(),
        };
        let base = self.diffuse.constant().map_or(Vec::new(), Vec::from);
        let of_metal = Range::Within(0.0, MOST_OF_METAL);
        let of_glass = Range::Within(LEAST_IOR, MOST_IOR);
        for (field, values, range) in [
            ("diffuse", base, Range::Share),
            ("metallic", number(&self.metallic), Range::Share),
            ("roughness", number(&self.roughness), Range::Share),
            ("eta", colour(&self.eta), of_metal),
            ("extinction", colour(&self.extinction), of_metal),
            ("ior", number(&self.ior), of_glass),
        ] {
            range.check(name, field, &values)?;
        }
        let ior = number(&self.ior);
        if ior.iter().any(|n| (n - 1.0).abs() < LEAST_CONTRAST) {
            let expected = "a number that is at least 0.001 away from 1, or nothing is refracted";
            return Err(Error::invalid(name, "ior", ior[0], expected));
        }
        Ok(())
    }
}
