use burn::module::{Module, Param};
use burn::tensor::activation::sigmoid;
use burn::tensor::{Device, Tensor};

use super::values::{leaf, positive};
use crate::error::{Error, Result};
use crate::geometry::host_values;
#[cfg(doc)]
use crate::scene::Material;
use crate::scene::{ColorTexture, Environment, Range, Wrap};

/// The least initial distance of texels from 0 and 1, where a logit has no gradient.
const MARGIN: f64 = 1e-3;
/// The least initial radiance, because 0 has no logarithm.
const LEAST_RADIANCE: f64 = 1e-3;
/// The largest initial slope of a normal map.
const STEEPEST: f64 = 10.0;

/// A texture whose texels stay between 0 and 1: a texel is the logistic function of its parameter.
///
/// ```
/// use softray::modules::TextureParams;
/// use softray::prelude::*;
/// let texture = TextureParams::gray(16, 32, &Device::flex().autodiff());
/// let material = Material::diffuse(texture.albedo(Wrap::Repeat));
/// # let _ = material;
/// ```
#[derive(Module)]
pub struct TextureParams {
    /// Logits ln(a/(1 − a)) of the texels a, `[H, W, 3]`.
    pub logits: Param<Tensor<3>>,
}

impl TextureParams {
    /// Creates a texture of height × width texels of 0.5, in the device's default float type.
    pub fn gray(height: usize, width: usize, device: &Device) -> Self {
        Self {
            logits: leaf(vec![0.0; height * width * 3], [height, width, 3], device),
        }
    }

    /// Creates parameters with the texels of an image `[H, W, 3]`, on its device and in its float type. Texels
    /// within 1e-3 of 0 or 1 start at that distance.
    ///
    /// # Errors
    /// If the shape differs, a value is outside of [0, 1], or the image cannot be read.
    pub fn from_image(image: Tensor<3>) -> Result<Self> {
        check_map("texture", &image, Range::Share)?;
        let texels = image.detach().clamp(MARGIN, 1.0 - MARGIN);
        let odds = texels.clone() / texels.neg().add_scalar(1.0);
        Ok(Self {
            logits: Param::from_tensor(odds.log().detach()),
        })
    }

    /// Returns the texels `[H, W, 3]`, in the graph of the parameters.
    pub fn texels(&self) -> Tensor<3> {
        sigmoid(self.logits.val())
    }

    /// Returns the albedo, in the graph of the parameters.
    pub fn albedo(&self, wrap: Wrap) -> ColorTexture {
        let texels = self.texels();
        ColorTexture::Texture { texels, wrap }
    }
}

/// A normal map whose normals stay on the outer side of the surface. The parameters are slopes. A texel is
/// (x, y, 1), normalized.
///
/// ```
/// use softray::modules::NormalMapParams;
/// use softray::prelude::*;
/// let map = NormalMapParams::flat(16, 32, &Device::flex().autodiff());
/// let material = Material::default().with_normal_map(map.texels(), 1.0);
/// # let _ = material;
/// ```
#[derive(Module)]
pub struct NormalMapParams {
    /// Tangents of the angles by which the normal is tilted along increasing u and along increasing v,
    /// `[H, W, 2]`.
    pub slopes: Param<Tensor<3>>,
}

impl NormalMapParams {
    /// Creates a map of height × width texels without tilt, in the device's default float type.
    pub fn flat(height: usize, width: usize, device: &Device) -> Self {
        Self {
            slopes: leaf(vec![0.0; height * width * 2], [height, width, 2], device),
        }
    }

    /// Creates parameters with the texels of a map `[H, W, 3]` in [−1, 1] (see [`Material::with_normal_map`]), on
    /// its device and in its float type. Slopes beyond ±10 (a tilt of 84° along an axis) start at ±10.
    ///
    /// # Errors
    /// If the shape differs, a value is not finite, or the map cannot be read.
    pub fn from_map(map: Tensor<3>) -> Result<Self> {
        check_map("normal map", &map, Range::Finite)?;
        let texels = map.detach();
        let (tilt, up) = (texels.clone().narrow(2, 0, 2), texels.narrow(2, 2, 1));
        let slopes = (tilt / up.clamp_min(1e-3)).clamp(-STEEPEST, STEEPEST);
        Ok(Self {
            slopes: Param::from_tensor(slopes.detach()),
        })
    }

    /// Returns the texels `[H, W, 3]`, of unit length, in the graph of the parameters.
    pub fn texels(&self) -> Tensor<3> {
        let slopes = self.slopes.val();
        let up = slopes.ones_like().narrow(2, 0, 1);
        let texels = Tensor::cat(vec![slopes, up], 2);
        let length = texels.clone().powi_scalar(2).sum_dim(2).sqrt();
        texels / length
    }
}

/// An environment map whose radiance stays more than 0: the parameters are its logarithms. Logarithms beyond
/// ±30 count as ±30.
///
/// ```
/// use softray::modules::EnvironmentParams;
/// use softray::prelude::*;
/// let sky = EnvironmentParams::uniform(8, 16, 0.5, &Device::flex().autodiff())?;
/// let scene = Scene::new().with_environment(sky.environment());
/// # let _ = scene;
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Module)]
pub struct EnvironmentParams {
    /// ln of the radiance, `[H, W, 3]`.
    pub logs: Param<Tensor<3>>,
}

impl EnvironmentParams {
    /// Creates a map of height × width texels with the same radiance, > 0, in the device's default float type.
    ///
    /// # Errors
    /// If the radiance is not a finite number > 0, or there are no texels.
    pub fn uniform(height: usize, width: usize, radiance: f64, device: &Device) -> Result<Self> {
        if height == 0 || width == 0 {
            let size = format!("{height} × {width}");
            let expected = "at least one row and column";
            return Err(Error::invalid("environment", "size", size, expected));
        }
        Range::Positive.check("environment", "radiance", &[radiance])?;
        let logs = vec![radiance.ln(); height * width * 3];
        Ok(Self {
            logs: leaf(logs, [height, width, 3], device),
        })
    }

    /// Creates parameters with a map of radiance `[H, W, 3]` (see [`Environment::Map`]), on its device and in
    /// its float type. Values less than 1e-3 start at 1e-3.
    ///
    /// # Errors
    /// If the shape differs, a value is not a finite number ≥ 0, or the map cannot be read.
    pub fn from_map(map: Tensor<3>) -> Result<Self> {
        check_map("environment", &map, Range::NotNegative)?;
        let logs = map.detach().clamp_min(LEAST_RADIANCE).log();
        Ok(Self {
            logs: Param::from_tensor(logs.detach()),
        })
    }

    /// Returns the radiance `[H, W, 3]`, in the graph of the parameters.
    pub fn texels(&self) -> Tensor<3> {
        positive(self.logs.val())
    }

    /// Returns the environment, in the graph of the parameters.
    pub fn environment(&self) -> Environment {
        Environment::map(self.texels())
    }
}

fn check_map(object: &str, map: &Tensor<3>, range: Range) -> Result<()> {
    let [height, width, channels] = map.dims();
    if height == 0 || width == 0 || channels != 3 {
        let found = format!("of shape [{height}, {width}, {channels}]");
        return Err(Error::invalid(object, "image", found, "shape [H, W, 3]"));
    }
    let all = host_values(map)?;
    all.chunks(1)
        .try_for_each(|number| range.check(object, "texel", number))
}
