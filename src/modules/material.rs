use burn::config::Config;
use burn::module::{Module, Param};
use burn::tensor::activation::softmax;
use burn::tensor::{Device, Tensor};

use super::values::{leaf, positive};
use crate::error::{Error, Result};
use crate::scene::{Albedo, Material, Range};

const OBJECT: &str = "material";
/// The least share of a channel's light that a part begins with, and the least emission: 0 has no
/// logarithm.
const LEAST: f64 = 1e-3;

/// Makes a [`MaterialParams`].
#[derive(Config, Debug)]
pub struct MaterialParamsConfig {
    /// k_d, RGB in [0, 1].
    #[config(default = "[0.5, 0.5, 0.5]")]
    pub diffuse: [f64; 3],
    /// k_s, RGB in [0, 1]; without it there is no Phong lobe.
    pub specular: Option<[f64; 3]>,
    /// The exponent of the Phong lobe, > 0; it counts where there is one.
    #[config(default = 10.0)]
    pub shininess: f64,
    /// Radiance of the front side, RGB ≥ 0; without it nothing is emitted.
    pub emission: Option<[f64; 3]>,
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
        let constant = Material::diffuse(self.diffuse).specular(specular, self.shininess);
        constant.check_energy(OBJECT)?;
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
        })
    }
}

/// A material that can't make energy: of each channel's light a share is reflected diffusely, a share
/// specularly, and a share absorbed, by a softmax. Shininess and emission stay more than 0: they are
/// kept as logarithms.
///
/// ```
/// use softray::modules::MaterialParamsConfig;
/// use softray::prelude::*;
/// let device = Device::flex().autodiff();
/// let params = MaterialParamsConfig::new()
///     .with_diffuse([0.6, 0.3, 0.1])
///     .with_specular(Some([0.2, 0.2, 0.2]))
///     .init(&device)?;
/// let object = Object::new(shapes::cube(&Device::flex())).material(params.material());
/// # let _ = object;
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Module)]
pub struct MaterialParams {
    /// Logits of the shares of light that the surface reflects diffusely, reflects specularly and absorbs:
    /// `[3, 3]`, one row per colour channel, or `[3, 2]` (diffuse, absorbed) where nothing is specular. The
    /// softmax of a row gives the shares.
    pub shares: Param<Tensor<2>>,
    /// ln of the Phong exponent, `[1]`, where something is specular.
    pub log_shininess: Option<Param<Tensor<1>>>,
    /// ln of the emitted radiance, `[3]`, where something is emitted.
    pub log_emission: Option<Param<Tensor<1>>>,
}

impl MaterialParams {
    /// Parameters of a material of constant colours, in the device's default float type, without a Phong lobe and
    /// without emission where it is constantly black.
    ///
    /// # Errors
    /// Like [`MaterialParamsConfig::init`], or if a colour is a texture
    /// ([`TextureParams`](super::TextureParams) is for those), or a tensor can't be read.
    pub fn from_material(material: &Material, device: &Device) -> Result<Self> {
        let colour = |field: &str, albedo: &Albedo| {
            let Albedo::Constant(p) = albedo else {
                let object = format!("material {}", material.name);
                let expected = "a constant colour; TextureParams is for textures";
                return Err(Error::invalid(object, field, "a texture", expected));
            };
            p.values()
        };
        let mut config =
            MaterialParamsConfig::new().with_diffuse(colour("diffuse", &material.diffuse)?);
        if material.specular.reflects() {
            let [shininess] = material.shininess.values()?;
            config = config
                .with_specular(Some(colour("specular", &material.specular)?))
                .with_shininess(shininess);
        }
        if material.emits() {
            config = config.with_emission(Some(colour("emission", &material.emission)?));
        }
        config.init(device)
    }

    /// The material, in the graph of the parameters.
    pub fn material(&self) -> Material {
        let shares = softmax(self.shares.val(), 1);
        let part = |i: usize| shares.clone().slice([0..3, i..i + 1]).reshape([3]);
        let mut material = Material::diffuse(part(0));
        if let Some(log) = &self.log_shininess {
            material = material.specular(part(1), positive(log.val()));
        }
        match &self.log_emission {
            Some(log) => material.emission(positive(log.val())),
            None => material,
        }
    }
}
