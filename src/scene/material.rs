//! Materials: a BSDF, emission, a normal map and an alpha mask.

use super::bsdf::Bsdf;
use super::parameter::Parameter;
use super::texture::{ColorTexture, ScalarTexture, Value};
use super::{AlphaMask, NormalMap};
use softray_kernels::host::{BsdfKind, Channel, MaterialKind};

/// A BSDF, emission, a normal map and an alpha mask.
///
/// [`ScalarTexture`] has an example.
#[derive(Clone)]
#[cfg_attr(feature = "remote", derive(serde::Serialize, serde::Deserialize))]
pub struct Material {
    /// The name in messages.
    pub name: String,
    /// How it scatters light.
    pub bsdf: Bsdf,
    /// Radiance that the front side emits, RGB. Textures require [`Visibility::Cone`](crate::render::Visibility::Cone).
    pub emission: ColorTexture,
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
    /// A material of a BSDF, which emits nothing.
    pub fn new(bsdf: Bsdf) -> Self {
        Self {
            name: "material".into(),
            bsdf,
            emission: [0.0; 3].into(),
            normal_map: None,
            alpha_mask: None,
        }
    }

    /// A Lambertian surface with an albedo k_d in [0, 1].
    pub fn diffuse(albedo: impl Into<ColorTexture>) -> Self {
        Self::phong(albedo, [0.0; 3], 1.0)
    }

    /// Lambert plus normalized Phong: albedos k_d and k_s in [0, 1], such that k_d + k_s ≤ 1, and an exponent in
    /// [0, 10⁶].
    pub fn phong(
        diffuse: impl Into<ColorTexture>,
        specular: impl Into<ColorTexture>,
        shininess: impl Into<Parameter<1>>,
    ) -> Self {
        Self::new(Bsdf::Phong {
            diffuse: diffuse.into(),
            specular: specular.into(),
            shininess: shininess.into(),
        })
    }

    /// A black surface that emits radiance from its front side.
    pub fn emitter(radiance: impl Into<ColorTexture>) -> Self {
        Self::diffuse([0.0; 3]).with_emission(radiance)
    }

    /// Sets the name, which messages show.
    pub fn with_name(mut self, name: impl Into<String>) -> Self {
        self.name = name.into();
        self
    }

    /// The model of glTF 2.0: facets of the distribution GGX with α = roughness², Smith's masking, and a share of
    /// metal. Metal reflects its base color; the rest reflects 4 % at its facets, and the base color below them.
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
        base_color: impl Into<ColorTexture>,
        metallic: impl Into<ScalarTexture>,
        roughness: impl Into<ScalarTexture>,
    ) -> Self {
        Self::new(Bsdf::MetallicRoughness {
            base_color: base_color.into(),
            metallic: metallic.into(),
            roughness: roughness.into(),
            compensated: true,
        })
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
        Self::new(Bsdf::Conductor {
            eta: eta.into(),
            extinction: extinction.into(),
            roughness: roughness.into(),
            compensated: true,
        })
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
        Self::new(Bsdf::Dielectric {
            tint: [1.0; 3].into(),
            ior: ior.into(),
            roughness: roughness.into(),
            compensated: true,
        })
    }

    /// Enables or disables multiple-scattering compensation, which adds the light that scatters several times between
    /// microfacets. It is enabled by default; Phong has none.
    pub fn with_compensated(mut self, on: bool) -> Self {
        match &mut self.bsdf {
            Bsdf::Phong { .. } => {}
            Bsdf::MetallicRoughness { compensated, .. }
            | Bsdf::Conductor { compensated, .. }
            | Bsdf::Dielectric { compensated, .. } => *compensated = on,
        }
        self
    }

    /// Sets the tint of a dielectric, RGB in [0, 1]: a factor of the light that it reflects and refracts; 1 by default.
    /// Other BSDFs have none.
    pub fn with_tint(mut self, color: impl Into<ColorTexture>) -> Self {
        if let Bsdf::Dielectric { tint, .. } = &mut self.bsdf {
            *tint = color.into();
        }
        self
    }

    /// Sets the radiance that the front side emits, RGB.
    pub fn with_emission(mut self, radiance: impl Into<ColorTexture>) -> Self {
        self.emission = radiance.into();
        self
    }

    /// The parameters of its BSDF and its emission, each at its place ([`Channel::place`]): the one list that tensors,
    /// checks, the packed scene and gradients are made from.
    pub(crate) fn channels(&mut self) -> impl Iterator<Item = (Channel, Value<'_>)> {
        let emission = (Channel::Emission, self.emission.value());
        self.bsdf.channels().into_iter().chain([emission])
    }

    /// The parts that it has. A parameter in a graph counts as present, since a fit may change it.
    pub(crate) fn kind(&self) -> MaterialKind {
        let glossy = self.bsdf.kind() != BsdfKind::Phong || self.bsdf.lobe().is_some();
        let base = self.bsdf.base();
        MaterialKind {
            glossy,
            reflects: glossy || base.is_some_and(ColorTexture::reflects),
            emits: self.emits(),
            glows: self.glows(),
            bsdf: self.bsdf.kind(),
            compensated: self.bsdf.is_compensated(),
        }
    }

    /// Whether its emission may be other than 0: false only for a constant 0.
    pub(crate) fn emits(&self) -> bool {
        self.emission.reflects()
    }

    /// Whether its emission is a texture.
    pub(crate) fn glows(&self) -> bool {
        matches!(self.emission, ColorTexture::Texture { .. })
    }

    /// Replaces textures by their means. Returns whether there were any.
    pub(crate) fn take_means(&mut self) -> bool {
        let (colors, numbers) = self.bsdf.textures();
        let mut any = false;
        for texture in colors.into_iter().chain([&mut self.emission]) {
            any |= texture.take_mean();
        }
        for texture in numbers {
            any |= texture.take_mean();
        }
        any
    }
}
