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
const MIN_INITIAL: f64 = 1e-3;

/// The configuration of a [`MaterialParams`].
///
/// [`MaterialParams`] has an example.
#[derive(Config, Debug)]
pub struct MaterialParamsConfig {
    /// k_d, or the base color or tint of facets, RGB in [0, 1]; 0.5 by default.
    #[config(default = "[0.5, 0.5, 0.5]")]
    pub diffuse: [f64; 3],
    /// k_s, RGB in [0, 1]; by default there is no Phong lobe.
    pub specular: Option<[f64; 3]>,
    /// The exponent of the Phong lobe, > 0, if there is one; 10 by default.
    #[config(default = 10.0)]
    pub shininess: f64,
    /// Radiance of the front side, RGB ≥ 0; by default nothing is emitted.
    pub emission: Option<[f64; 3]>,
    /// The roughness of facets in [0, 1]. With it the material has facets and no Phong lobe: it is a metal if
    /// `conductor` is set, clear matter if `ior` is set, and otherwise [`Material::metallic_roughness`].
    pub roughness: Option<f64>,
    /// The share of metal in [0, 1]; 0 by default.
    #[config(default = 0.0)]
    pub metallic: f64,
    /// η and k of a conductor, RGB > 0.
    pub conductor: Option<[[f64; 3]; 2]>,
    /// The index of refraction of a dielectric, > 1.
    pub ior: Option<f64>,
    /// Whether light that scatters several times between microfacets is added ([`Material::with_compensated`]);
    /// true by default.
    #[config(default = true)]
    pub compensated: bool,
}

impl MaterialParamsConfig {
    /// Creates the parameters, in the device's default float type. The diffuse, the specular and the absorbed share
    /// start at about 1e-3 at least, and an emission at 1e-3. The roughness and the share of metal start within
    /// [1e-3, 1 − 1e-3].
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
        self.check_facets()?;
        let sum: [f64; 3] = std::array::from_fn(|i| self.diffuse[i] + specular[i]);
        let log = |x: f64| x.max(MIN_INITIAL).ln();
        let shares = |c: usize| {
            let absorbed = 1.0 - sum[c];
            match self.specular {
                Some(_) => vec![log(self.diffuse[c]), log(specular[c]), log(absorbed)],
                None => vec![log(self.diffuse[c]), log(absorbed)],
            }
        };
        let parts = shares(0).len();
        let shininess = vec![self.shininess.ln()];
        let share = |p: f64| {
            let p = p.clamp(MIN_INITIAL, 1.0 - MIN_INITIAL);
            leaf(vec![logit(p)], [1], device)
        };
        let logs = |v: [f64; 3]| leaf(v.map(f64::ln).to_vec(), [3], device);
        let mixed = self.roughness.is_some() && self.conductor.is_none() && self.ior.is_none();
        Ok(MaterialParams {
            logit_shares: leaf((0..3).flat_map(shares).collect(), [3, parts], device),
            log_shininess: self.specular.map(|_| leaf(shininess, [1], device)),
            log_emission: self
                .emission
                .map(|e| leaf(e.map(log).to_vec(), [3], device)),
            logit_roughness: self.roughness.map(share),
            logit_metallic: mixed.then(|| share(self.metallic)),
            log_eta: self.conductor.map(|[eta, _]| logs(eta)),
            log_extinction: self.conductor.map(|[_, k]| logs(k)),
            log_contrast: self
                .ior
                .map(|ior| leaf(vec![(ior - 1.0).ln()], [1], device)),
            compensated: self.compensated,
        })
    }

    /// Checks the parameters of facets, and that no others are given.
    fn check_facets(&self) -> Result<()> {
        let Some(roughness) = self.roughness else {
            let given = self.conductor.is_some() || self.ior.is_some();
            let expected = "a number in [0, 1], since there is a conductor or an ior";
            return Error::unless(!given, OBJECT, "roughness", "none", expected);
        };
        let one = self.conductor.is_none() || self.ior.is_none();
        let expected = "none, since there is a conductor";
        Error::unless(one, OBJECT, "ior", "given", expected)?;
        let matt = self.specular.is_none();
        let expected = "none, since facets have no Phong lobe";
        Error::unless(matt, OBJECT, "specular", "given", expected)?;
        Range::Share.check(OBJECT, "roughness", &[roughness])?;
        Range::Share.check(OBJECT, "metallic", &[self.metallic])?;
        let conductor = self.conductor.unwrap_or([[1.0; 3]; 2]).concat();
        Range::Positive.check(OBJECT, "conductor", &conductor)?;
        let ior = self.ior.unwrap_or(2.0);
        let expected = "an index of refraction of more than 1";
        Error::unless(ior > 1.0 && ior.is_finite(), OBJECT, "ior", ior, expected)
    }
}

/// A material that never reflects more light than it receives: a softmax divides the light of each channel into a
/// diffuse, a specular and an absorbed share. Shininess and emission stay more than 0. With facets, the diffuse
/// share is the base color or the tint; roughness and share of metal stay in (0, 1), η and k stay more than 0, and
/// the index of refraction stays more than 1.
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
    pub logit_shares: Param<Tensor<2>>,
    /// ln of the Phong exponent, `[1]`, where something is specular.
    pub log_shininess: Option<Param<Tensor<1>>>,
    /// ln of the emitted radiance, `[3]`, where something is emitted.
    pub log_emission: Option<Param<Tensor<1>>>,
    /// Logit of the roughness of facets, `[1]`, where the material has facets.
    pub logit_roughness: Option<Param<Tensor<1>>>,
    /// Logit of the share of metal, `[1]`, of a metallic–roughness material.
    pub logit_metallic: Option<Param<Tensor<1>>>,
    /// ln of η, `[3]`, of a conductor.
    pub log_eta: Option<Param<Tensor<1>>>,
    /// ln of k, `[3]`, of a conductor.
    pub log_extinction: Option<Param<Tensor<1>>>,
    /// ln of the index of refraction less 1, `[1]`, of a dielectric.
    pub log_contrast: Option<Param<Tensor<1>>>,
    /// Whether light that scatters several times between microfacets is added; a constant.
    #[module(skip)]
    compensated: bool,
}

impl MaterialParams {
    /// Creates parameters with the values of a material of constant colors, in the device's default float type. A
    /// constantly black Phong lobe or emission has no parameters. The name, the normal map and the alpha mask are
    /// left out.
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
        let least = |p: &Parameter<3>| Ok::<_, Error>(p.values()?.map(|x| x.max(MIN_INITIAL)));
        let mut config =
            MaterialParamsConfig::new().with_compensated(material.bsdf.is_compensated());
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

    /// Returns the material, in the graph of the parameters.
    pub fn material(&self) -> Material {
        let shares = softmax(self.logit_shares.val(), 1);
        let part = |i: usize| shares.clone().slice([0..3, i..i + 1]).reshape([3]);
        let material = match &self.logit_roughness {
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
        let exp = |log: &Param<Tensor<1>>| positive(log.val());
        let conductor = self.log_eta.as_ref().zip(self.log_extinction.as_ref());
        let material = match (&self.logit_metallic, conductor, &self.log_contrast) {
            (Some(metal), ..) => {
                Material::metallic_roughness(base, sigmoid(metal.val()), roughness)
            }
            (None, Some((eta, k)), _) => Material::conductor(exp(eta), exp(k), roughness),
            (None, None, Some(contrast)) => {
                Material::dielectric(exp(contrast) + 1.0, roughness).with_tint(base)
            }
            (None, None, None) => Material::diffuse(base),
        };
        material.with_compensated(self.compensated)
    }
}
