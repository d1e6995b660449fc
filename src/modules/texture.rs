use burn::module::{Module, Param};
use burn::tensor::activation::sigmoid;
use burn::tensor::{Device, Tensor};

use super::values::{leaf, positive};
use crate::error::{Error, Result};
use crate::geometry::host_values;
#[cfg(doc)]
use crate::scene::Material;
use crate::scene::{Albedo, Environment, Range, Wrap};

/// Texels begin this far from 0 and 1, where a logit has no gradient.
const MARGIN: f64 = 1e-3;
/// Radiance begins with at least this, which has a logarithm.
const LEAST_RADIANCE: f64 = 1e-3;
/// Slopes of a normal map begin with at most this.
const STEEPEST: f64 = 10.0;

/// A texture whose texels stay between 0 and 1: they are the logistic function of the parameters.
///
/// ```
/// use softray::modules::TextureParams;
/// use softray::prelude::*;
/// let texture = TextureParams::grey(16, 32, &Device::flex().autodiff());
/// let material = Material::diffuse(texture.albedo(Wrap::Repeat));
/// # let _ = material;
/// ```
#[derive(Module)]
pub struct TextureParams {
    /// Logits ln(a/(1 − a)) of the texels, `[H, W, 3]`.
    pub logits: Param<Tensor<3>>,
}

impl TextureParams {
    /// A texture of height × width texels of 0.5, in the device's default float type.
    pub fn grey(height: usize, width: usize, device: &Device) -> Self {
        Self {
            logits: leaf(vec![0.0; height * width * 3], [height, width, 3], device),
        }
    }

    /// Parameters that begin with the texels of an image `[H, W, 3]`, on its device and in its float type. Those
    /// within 1e-3 of 0 or 1 begin at that distance.
    ///
    /// # Errors
    /// If the shape is another, a value is outside of [0, 1], or the image can't be read.
    pub fn from_image(image: Tensor<3>) -> Result<Self> {
        check_map("texture", &image, Range::Share)?;
        let texels = image.detach().clamp(MARGIN, 1.0 - MARGIN);
        let odds = texels.clone() / texels.neg().add_scalar(1.0);
        Ok(Self {
            logits: Param::from_tensor(odds.log().detach()),
        })
    }

    /// The texels `[H, W, 3]`, in the graph of the parameters.
    pub fn texels(&self) -> Tensor<3> {
        sigmoid(self.logits.val())
    }

    /// The albedo, in the graph of the parameters.
    pub fn albedo(&self, wrap: Wrap) -> Albedo {
        let texels = self.texels();
        Albedo::Texture { texels, wrap }
    }
}

/// A normal map whose normals stay on the outer side of the surface: the parameters are slopes, and a texel is
/// (x, y, 1), made of unit length.
///
/// ```
/// use softray::modules::NormalMapParams;
/// use softray::prelude::*;
/// let map = NormalMapParams::flat(16, 32, &Device::flex().autodiff());
/// let material = Material::default().normal_map(map.texels(), 1.0);
/// # let _ = material;
/// ```
#[derive(Module)]
pub struct NormalMapParams {
    /// Tangents of the angles by which the normal is tilted along increasing u and v, `[H, W, 2]`.
    pub slopes: Param<Tensor<3>>,
}

impl NormalMapParams {
    /// A map of height × width texels that tilts nothing, in the device's default float type.
    pub fn flat(height: usize, width: usize, device: &Device) -> Self {
        Self {
            slopes: leaf(vec![0.0; height * width * 2], [height, width, 2], device),
        }
    }

    /// Parameters that begin with the texels of a map `[H, W, 3]` in [−1, 1] (see [`Material::normal_map`]), on its
    /// device and in its float type. Those that tilt by more than 84° begin there.
    ///
    /// # Errors
    /// If the shape is another, a value is not finite, or the map can't be read.
    pub fn from_map(map: Tensor<3>) -> Result<Self> {
        check_map("normal map", &map, Range::Finite)?;
        let texels = map.detach();
        let (tilt, up) = (texels.clone().narrow(2, 0, 2), texels.narrow(2, 2, 1));
        let slopes = (tilt / up.clamp_min(1e-3)).clamp(-STEEPEST, STEEPEST);
        Ok(Self {
            slopes: Param::from_tensor(slopes.detach()),
        })
    }

    /// The texels `[H, W, 3]`, of unit length, in the graph of the parameters.
    pub fn texels(&self) -> Tensor<3> {
        let slopes = self.slopes.val();
        let up = slopes.ones_like().narrow(2, 0, 1);
        let texels = Tensor::cat(vec![slopes, up], 2);
        let length = texels.clone().powi_scalar(2).sum_dim(2).sqrt();
        texels / length
    }
}

/// An environment map whose radiance stays more than 0 and has no upper bound: the parameters are its
/// logarithms.
///
/// ```
/// use softray::modules::EnvironmentParams;
/// use softray::prelude::*;
/// let sky = EnvironmentParams::uniform(8, 16, 0.5, &Device::flex().autodiff())?;
/// let scene = Scene::new().environment(sky.environment());
/// # let _ = scene;
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Module)]
pub struct EnvironmentParams {
    /// ln of the radiance, `[H, W, 3]`.
    pub logs: Param<Tensor<3>>,
}

impl EnvironmentParams {
    /// A map of one radiance, > 0, with height × width texels, in the device's default float type.
    ///
    /// # Errors
    /// If the radiance is not a number > 0, or there are no texels.
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

    /// Parameters that begin with a map of radiance `[H, W, 3]` (see [`Environment::Map`]), on its device and in
    /// its float type. Texels under 1e-3 begin at 1e-3.
    ///
    /// # Errors
    /// If the shape is another, a value is not a number ≥ 0, or the map can't be read.
    pub fn from_map(map: Tensor<3>) -> Result<Self> {
        check_map("environment", &map, Range::NotNegative)?;
        let logs = map.detach().clamp_min(LEAST_RADIANCE).log();
        Ok(Self {
            logs: Param::from_tensor(logs.detach()),
        })
    }

    /// Radiance `[H, W, 3]`, in the graph of the parameters.
    pub fn texels(&self) -> Tensor<3> {
        positive(self.logs.val())
    }

    /// The environment, in the graph of the parameters.
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
