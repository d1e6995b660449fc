use burn::config::Config;
use burn::module::{Module, Param};
use burn::tensor::activation::{sigmoid, softmax};
use burn::tensor::{Device, Tensor};

use super::values::{leaf, logit, positive};
use crate::error::{Error, Result};
use crate::scene::{Bsdf, ColorTexture, Material, Parameter, Range, ScalarTexture};

const OBJECT: &str = "material";
/// The least share of a channel's light that a part begins with, and the least emission: 0 has no
/// logarithm.
const LEAST: f64 = 1e-3;

/// Makes a [`MaterialParams`].
#[derive(Config, Debug)]
pub struct MaterialParamsConfig {
    /// k_d, or the base color of facets, RGB in [0, 1].
    #[config(default = "[0.5, 0.5, 0.5]")]
    pub diffuse: [f64; 3],
    /// k_s, RGB in [0, 1]; without it there is no Phong lobe.
    pub specular: Option<[f64; 3]>,
    /// The exponent of the Phong lobe, > 0; it counts where there is one.
    #[config(default = 10.0)]
    pub shininess: f64,
    /// Radiance of the front side, RGB ≥ 0; without it nothing is emitted.
    pub emission: Option<[f64; 3]>,
    /// The roughness of facets in [0, 1]; with it the material is one of facets, without a Phong lobe: by
    /// `conductor` a metal, by `ior` clear matter, else [`Material::metallic_roughness`].
    pub roughness: Option<f64>,
    /// The share of metal in [0, 1].
    #[config(default = 0.0)]
    pub metallic: f64,
    /// η and k of a conductor, RGB > 0.
    pub conductor: Option<[[f64; 3]; 2]>,
    /// The index of refraction of a dielectric, > 1.
    pub ior: Option<f64>,
}

impl MaterialParamsConfig {
    /// The material, in the device's default float type. Of what is diffuse, specular and absorbed each
    /// begins with a share of about 1e-3 at least, and an emission with 1e-3.
    ///
    /// # Errors
    /// If a value is out of its range, or k_d + k_s is more than 1.
    pub fn init(&self, device: &Device) -> Result<MaterialParams> {
        let specular = self.specular.unwrap_or([0.0; 3]);
        Range::Share.check(OBJECT, "diffuse", &self.diffuse)?;
        Range::Share.check(OBJECT, "specular", &specular)?;
        Range::Positive.check(OBJECT, "shininess", &[self.shininess])?;
        if let Some(emission) = self.emission {
            Range::NotNegative.check(OBJECT, "emission", &emission)?;
        }
        let constant = Material::phong(self.diffuse, specular, self.shininess);
        constant.check_energy(OBJECT)?;
        let [roughness, metallic, index] = self.facets()?;
        let sum: [f64; 3] = std::array::from_fn(|i| self.diffuse[i] + specular[i]);
        let log = |x: f64| x.max(LEAST).ln();
        let shares = |c: usize| {
            let absorbed = 1.0 - sum[c];
            match self.specular {
                Some(_) => vec![log(self.diffuse[c]), log(specular[c]), log(absorbed)],
                None => vec![log(self.diffuse[c]), log(absorbed)],
            }
        };
        let parts = shares(0).len();
        let shininess = vec![self.shininess.ln()];
        Ok(MaterialParams {
            shares: leaf((0..3).flat_map(shares).collect(), [3, parts], device),
            log_shininess: self.specular.map(|_| leaf(shininess, [1], device)),
            log_emission: self
                .emission
                .map(|e| leaf(e.map(log).to_vec(), [3], device)),
            roughness: roughness.map(|v| leaf(v, [1], device)),
            metallic: metallic.map(|v| leaf(v, [1], device)),
            log_index: index.map(|v| leaf(v.clone(), [v.len()], device)),
        })
    }

    /// Where parameters of facets begin, before the functions that keep them in their ranges: of roughness, metal and
    /// index of refraction those that there are.
    fn facets(&self) -> Result<[Option<Vec<f64>>; 3]> {
        let Some(roughness) = self.roughness else {
            let given = self.conductor.is_some() || self.ior.is_some();
            let expected = "a number in [0, 1], since there is a conductor or an ior";
            Error::unless(!given, OBJECT, "roughness", "none", expected)?;
            return Ok([None, None, None]);
        };
        let one = self.conductor.is_none() || self.ior.is_none();
        let expected = "none, since there is a conductor";
        Error::unless(one, OBJECT, "ior", "given", expected)?;
        let matt = self.specular.is_none();
        let expected = "none, since facets have no Phong lobe";
        Error::unless(matt, OBJECT, "specular", "given", expected)?;
        Range::Share.check(OBJECT, "roughness", &[roughness])?;
        Range::Share.check(OBJECT, "metallic", &[self.metallic])?;
        let index = match (self.conductor, self.ior) {
            (Some(pair), _) => {
                Range::Positive.check(OBJECT, "conductor", &pair.concat())?;
                Some(pair.concat().iter().map(|x| x.ln()).collect())
            }
            (None, Some(ior)) => {
                let expected = "an index of refraction of more than 1";
                Error::unless(ior > 1.0 && ior.is_finite(), OBJECT, "ior", ior, expected)?;
                Some(vec![(ior - 1.0).ln()])
            }
            (None, None) => None,
        };
        let share = |p: f64| Some(vec![logit(p.clamp(LEAST, 1.0 - LEAST))]);
        let metallic = index.is_none().then(|| share(self.metallic)).flatten();
        Ok([share(roughness), metallic, index])
    }
}

/// A material that can't make energy: of each channel's light a share is reflected diffusely, a share
/// specularly, and a share absorbed, by a softmax. Shininess and emission stay more than 0: they are
/// kept as logarithms. Of facets the diffuse share is the base color, the roughness and the share of metal stay in
/// (0, 1), η and k more than 0, and the index of refraction more than 1.
///
/// ```
/// use softray::modules::MaterialParamsConfig;
/// use softray::prelude::*;
/// let device = Device::flex().autodiff();
/// let params = MaterialParamsConfig::new()
///     .with_diffuse([0.6, 0.3, 0.1])
///     .with_specular(Some([0.2, 0.2, 0.2]))
///     .init(&device)?;
/// let object = Object::new(shapes::cube(&Device::flex())).with_material(params.material());
/// # let _ = object;
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Module)]
pub struct MaterialParams {
    /// Logits of the shares of light that the surface reflects diffusely, reflects specularly and absorbs:
    /// `[3, 3]`, one row per color channel, or `[3, 2]` (diffuse, absorbed) where nothing is specular. The
    /// softmax of a row gives the shares.
    pub shares: Param<Tensor<2>>,
    /// ln of the Phong exponent, `[1]`, where something is specular.
    pub log_shininess: Option<Param<Tensor<1>>>,
    /// ln of the emitted radiance, `[3]`, where something is emitted.
    pub log_emission: Option<Param<Tensor<1>>>,
    /// ln(r/(1 − r)) of the roughness r of facets, `[1]`, where the material is one of facets.
    pub roughness: Option<Param<Tensor<1>>>,
    /// ln(m/(1 − m)) of the share m of metal, `[1]`, of metallic–roughness.
    pub metallic: Option<Param<Tensor<1>>>,
    /// ln of η and k of a conductor, `[6]`, or of the index of refraction of a dielectric less 1, `[1]`.
    pub log_index: Option<Param<Tensor<1>>>,
}

impl MaterialParams {
    /// Parameters of a material of constant colors, in the device's default float type, without a Phong lobe and
    /// without emission where it is constantly black.
    ///
    /// # Errors
    /// Like [`MaterialParamsConfig::init`], or if a color is a texture
    /// ([`TextureParams`](super::TextureParams) is for those), or a tensor can't be read.
    pub fn from_material(material: &Material, device: &Device) -> Result<Self> {
        let color = |field: &str, albedo: &ColorTexture| {
            let ColorTexture::Constant(p) = albedo else {
                let object = format!("material {}", material.name);
                let expected = "a constant color; TextureParams is for textures";
                return Err(Error::invalid(object, field, "a texture", expected));
            };
            p.values()
        };
        let number = |field: &str, texture: &ScalarTexture| {
            let ScalarTexture::Constant(p) = texture else {
                let object = format!("material {}", material.name);
                return Err(Error::invalid(object, field, "a texture", "a number"));
            };
            Ok(p.values()?[0])
        };
        let least = |p: &Parameter<3>| Ok::<_, Error>(p.values()?.map(|x| x.max(LEAST)));
        let mut config = MaterialParamsConfig::new();
        match &material.bsdf {
            Bsdf::Phong {
                diffuse,
                specular,
                shininess,
            } => {
                config.diffuse = color("diffuse", diffuse)?;
                if specular.reflects() {
                    config.specular = Some(color("specular", specular)?);
                    [config.shininess] = shininess.values()?;
                }
            }
            Bsdf::MetallicRoughness {
                base_color,
                metallic,
                roughness,
                ..
            } => {
                config.diffuse = color("base_color", base_color)?;
                config.metallic = number("metallic", metallic)?;
                config.roughness = Some(number("roughness", roughness)?);
            }
            Bsdf::Conductor {
                eta,
                extinction,
                roughness,
                ..
            } => {
                config.diffuse = [0.0; 3];
                config.conductor = Some([least(eta)?, least(extinction)?]);
                config.roughness = Some(number("roughness", roughness)?);
            }
            Bsdf::Dielectric {
                tint,
                ior,
                roughness,
                ..
            } => {
                config.diffuse = color("tint", tint)?;
                config.ior = Some(number("ior", ior)?);
                config.roughness = Some(number("roughness", roughness)?);
            }
        }
        if material.emits() {
            config = config.with_emission(Some(color("emission", &material.emission)?));
        }
        config.init(device)
    }

    /// The material, in the graph of the parameters.
    pub fn material(&self) -> Material {
        let shares = softmax(self.shares.val(), 1);
        let part = |i: usize| shares.clone().slice([0..3, i..i + 1]).reshape([3]);
        let material = match &self.roughness {
            Some(roughness) => self.facets(part(0), sigmoid(roughness.val())),
            None => match &self.log_shininess {
                Some(log) => Material::phong(part(0), part(1), positive(log.val())),
                None => Material::diffuse(part(0)),
            },
        };
        match &self.log_emission {
            Some(log) => material.with_emission(positive(log.val())),
            None => material,
        }
    }

    /// The material of facets with a base color or a tint.
    fn facets(&self, base: Tensor<1>, roughness: Tensor<1>) -> Material {
        let index = self.log_index.as_ref().map(|log| positive(log.val()));
        match (&self.metallic, index) {
            (Some(metal), _) => Material::metallic_roughness(base, sigmoid(metal.val()), roughness),
            (None, Some(index)) if index.dims() == [6] => {
                let half = |i: usize| index.clone().slice(3 * i..3 * i + 3);
                Material::conductor(half(0), half(1), roughness)
            }
            (None, Some(index)) => Material::new(Bsdf::Dielectric {
                tint: base.into(),
                ior: (index + 1.0).into(),
                roughness: roughness.into(),
                compensated: true,
            }),
            (None, None) => Material::diffuse(base),
        }
    }
}
