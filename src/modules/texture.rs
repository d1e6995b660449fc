use burn::config::Config;
use burn::module::{Module, Param};
use burn::tensor::activation::sigmoid;
use burn::tensor::{Device, Tensor};

use super::values::{leaf, logit, positive};
use crate::error::{Error, Result};
use crate::geometry::host_values;
#[cfg(doc)]
use crate::scene::Material;
use crate::scene::{ColorTexture, Environment, Range, Wrap};

/// The least initial distance of texels from 0 and 1, where a logit has no gradient.
const MARGIN: f64 = 1e-3;
/// The least initial radiance, because 0 has no logarithm.
const MIN_RADIANCE: f64 = 1e-3;
/// The largest initial slope of a normal map.
const STEEPEST: f64 = 10.0;

/// The configuration of a [`TextureParams`], which starts with the same color everywhere.
///
/// [`TextureParams`] has an example.
#[derive(Config, Debug)]
pub struct TextureParamsConfig {
    /// The number of rows of texels.
    pub height: usize,
    /// The number of columns of texels.
    pub width: usize,
    /// The initial color, RGB in [0, 1]; 0.5 by default.
    #[config(default = "[0.5; 3]")]
    pub color: [f64; 3],
}

impl TextureParamsConfig {
    /// Creates the texture, in the device's default float type. Values within 1e-3 of 0 or 1 start at that
    /// distance.
    ///
    /// # Errors
    /// If a value is outside of [0, 1], or there are no texels.
    pub fn init(&self, device: &Device) -> Result<TextureParams> {
        let size = check_size("texture", [self.height, self.width])?;
        Range::Share.check("texture", "color", &self.color)?;
        let texels = self.color.repeat(self.height * self.width);
        Ok(TextureParams::of(texels, size, device))
    }
}

/// A texture whose texels stay between 0 and 1: a texel is the logistic function of its parameter.
///
/// ```
/// use softray::modules::TextureParamsConfig;
/// use softray::prelude::*;
/// let texture = TextureParamsConfig::new(16, 32).init(&Device::flex().autodiff())?;
/// let material = Material::diffuse(texture.texture(Wrap::Repeat));
/// # let _ = material;
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Module)]
pub struct TextureParams {
    /// Logits ln(a/(1 − a)) of the texels a, `[H, W, 3]`.
    pub logit_texels: Param<Tensor<3>>,
}

impl TextureParams {
    /// Creates parameters with the texels of an image `[H, W, 3]`, in the device's default float type. Texels
    /// within 1e-3 of 0 or 1 start at that distance.
    ///
    /// # Errors
    /// If the shape differs, a value is outside of [0, 1], or the image cannot be read.
    pub fn from_image(image: &Tensor<3>, device: &Device) -> Result<Self> {
        let texels = texels_of("texture", image, Range::Share)?;
        Ok(Self::of(texels, image.dims(), device))
    }

    fn of(texels: Vec<f64>, size: [usize; 3], device: &Device) -> Self {
        let logits = texels.iter().map(|a| logit(a.clamp(MARGIN, 1.0 - MARGIN)));
        Self {
            logit_texels: leaf(logits.collect(), size, device),
        }
    }

    /// Returns the texels `[H, W, 3]`, in the graph of the parameters.
    pub fn texels(&self) -> Tensor<3> {
        sigmoid(self.logit_texels.val())
    }

    /// Returns the texture, in the graph of the parameters.
    pub fn texture(&self, wrap: Wrap) -> ColorTexture {
        let texels = self.texels();
        ColorTexture::Texture { texels, wrap }
    }
}

/// The configuration of a [`NormalMapParams`], which starts without tilt.
///
/// [`NormalMapParams`] has an example.
#[derive(Config, Debug)]
pub struct NormalMapParamsConfig {
    /// The number of rows of texels.
    pub height: usize,
    /// The number of columns of texels.
    pub width: usize,
}

impl NormalMapParamsConfig {
    /// Creates the map, in the device's default float type.
    ///
    /// # Errors
    /// If there are no texels.
    pub fn init(&self, device: &Device) -> Result<NormalMapParams> {
        let [height, width, _] = check_size("normal map", [self.height, self.width])?;
        Ok(NormalMapParams {
            slopes: leaf(vec![0.0; height * width * 2], [height, width, 2], device),
        })
    }
}

/// A normal map whose normals stay on the outer side of the surface. The parameters are slopes. A texel is
/// (x, y, 1), normalized.
///
/// ```
/// use softray::modules::NormalMapParamsConfig;
/// use softray::prelude::*;
/// let map = NormalMapParamsConfig::new(16, 32).init(&Device::flex().autodiff())?;
/// let material = Material::default().with_normal_map(map.texels(), 1.0);
/// # let _ = material;
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Module)]
pub struct NormalMapParams {
    /// Tangents of the angles by which the normal is tilted along increasing u and along increasing v,
    /// `[H, W, 2]`.
    pub slopes: Param<Tensor<3>>,
}

impl NormalMapParams {
    /// Creates parameters with the texels of a map `[H, W, 3]` in [−1, 1] (see [`Material::with_normal_map`]), in
    /// the device's default float type. Slopes beyond ±10 (a tilt of 84° along an axis) start at ±10.
    ///
    /// # Errors
    /// If the shape differs, a value is not finite, or the map cannot be read.
    pub fn from_map(map: &Tensor<3>, device: &Device) -> Result<Self> {
        let texels = texels_of("normal map", map, Range::Finite)?;
        let slope = |tilt: f64, up: f64| (tilt / up.max(1e-3)).clamp(-STEEPEST, STEEPEST);
        let slopes = texels
            .chunks(3)
            .flat_map(|t| [slope(t[0], t[2]), slope(t[1], t[2])]);
        let [height, width, _] = map.dims();
        Ok(Self {
            slopes: leaf(slopes.collect(), [height, width, 2], device),
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

/// The configuration of an [`EnvironmentParams`], which starts with the same radiance everywhere.
///
/// [`EnvironmentParams`] has an example.
#[derive(Config, Debug)]
pub struct EnvironmentParamsConfig {
    /// The number of rows of texels.
    pub height: usize,
    /// The number of columns of texels.
    pub width: usize,
    /// The initial radiance, RGB ≥ 0; 1 by default.
    #[config(default = "[1.0; 3]")]
    pub radiance: [f64; 3],
}

impl EnvironmentParamsConfig {
    /// Creates the map, in the device's default float type. Values less than 1e-3 start at 1e-3.
    ///
    /// # Errors
    /// If a value is not a finite number ≥ 0, or there are no texels.
    pub fn init(&self, device: &Device) -> Result<EnvironmentParams> {
        let size = check_size("environment", [self.height, self.width])?;
        Range::NotNegative.check("environment", "radiance", &self.radiance)?;
        let radiance = self.radiance.repeat(self.height * self.width);
        Ok(EnvironmentParams::of(radiance, size, device))
    }
}

/// An environment map whose radiance stays more than 0: the parameters are its logarithms. Logarithms beyond
/// ±30 count as ±30.
///
/// ```
/// use softray::modules::EnvironmentParamsConfig;
/// use softray::prelude::*;
/// let sky = EnvironmentParamsConfig::new(8, 16)
///     .with_radiance([0.5; 3])
///     .init(&Device::flex().autodiff())?;
/// let scene = Scene::new().with_environment(sky.environment());
/// # let _ = scene;
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Module)]
pub struct EnvironmentParams {
    /// ln of the radiance, `[H, W, 3]`.
    pub log_radiance: Param<Tensor<3>>,
}

impl EnvironmentParams {
    /// Creates parameters with a map of radiance `[H, W, 3]` (see [`Environment::Map`]), in the device's default
    /// float type. Values less than 1e-3 start at 1e-3.
    ///
    /// # Errors
    /// If the shape differs, a value is not a finite number ≥ 0, or the map cannot be read.
    pub fn from_map(map: &Tensor<3>, device: &Device) -> Result<Self> {
        let radiance = texels_of("environment", map, Range::NotNegative)?;
        Ok(Self::of(radiance, map.dims(), device))
    }

    fn of(radiance: Vec<f64>, size: [usize; 3], device: &Device) -> Self {
        let logs = radiance.iter().map(|r| r.max(MIN_RADIANCE).ln());
        Self {
            log_radiance: leaf(logs.collect(), size, device),
        }
    }

    /// Returns new parameters with `height` rows and twice as many columns. Logarithms are looked up bilinearly.
    ///
    /// # Errors
    /// If there are no texels, or they cannot be read.
    pub fn resized(&self, height: usize) -> Result<Self> {
        let old = self.log_radiance.val();
        let [rows, columns, _] = old.dims();
        let size = check_size("environment", [height, 2 * height])?;
        let values = host_values(&old)?;
        let value = |i: usize| {
            let (channel, column, row) = (i % 3, i / 3 % size[1], i / 3 / size[1]);
            let [y, x] = [(row, rows, size[0]), (column, columns, size[1])]
                .map(|(k, old, new)| (k as f64 + 0.5) * old as f64 / new as f64 - 0.5);
            let at = |y: f64, x: f64| {
                let row = y.clamp(0.0, (rows - 1) as f64) as usize;
                let column = x.rem_euclid(columns as f64) as usize;
                values[3 * (row * columns + column) + channel]
            };
            let ([top, left], right) = ([y.floor(), x.floor()], x - x.floor());
            let of_row = |y| at(y, left) * (1.0 - right) + at(y, left + 1.0) * right;
            of_row(top) * (top + 1.0 - y) + of_row(top + 1.0) * (y - top)
        };
        let values = (0..3 * size[0] * size[1]).map(value).collect();
        Ok(Self {
            log_radiance: leaf(values, size, &old.device()),
        })
    }

    /// Returns the radiance `[H, W, 3]`, in the graph of the parameters.
    pub fn texels(&self) -> Tensor<3> {
        positive(self.log_radiance.val())
    }

    /// Returns the environment, in the graph of the parameters.
    pub fn environment(&self) -> Environment {
        Environment::map(self.texels())
    }
}

/// Returns the shape of a map of height × width texels, of which there must be one.
fn check_size(object: &str, [height, width]: [usize; 2]) -> Result<[usize; 3]> {
    let expected = "at least one row and column";
    let found = format!("{height} × {width}");
    Error::unless(height > 0 && width > 0, object, "size", found, expected)?;
    Ok([height, width, 3])
}

/// Reads the texels of a map `[H, W, 3]` and checks their range.
fn texels_of(object: &str, map: &Tensor<3>, range: Range) -> Result<Vec<f64>> {
    let [height, width, channels] = map.dims();
    if height == 0 || width == 0 || channels != 3 {
        let found = format!("of shape [{height}, {width}, {channels}]");
        return Err(Error::invalid(object, "image", found, "shape [H, W, 3]"));
    }
    let texels = host_values(map)?;
    for number in texels.chunks(1) {
        range.check(object, "texel", number)?;
    }
    Ok(texels)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Logarithms that are linear from row to row stay so, columns repeat, and a map of the same size stays as it is.
    #[test]
    fn resized_maps() -> Result<()> {
        let value = |i: usize| f64::from([0.0f32, 1.0, 2.0, 3.0][i / 24] + (i % 3) as f32);
        let logs: Vec<f64> = (0..96).map(value).collect();
        let map = EnvironmentParams {
            log_radiance: leaf(logs.clone(), [4, 8, 3], &Device::flex().autodiff()),
        };
        let of = |map: &EnvironmentParams| host_values(&map.log_radiance.val());
        assert_eq!(of(&map.resized(4)?)?, logs);
        let fine = map.resized(8)?;
        assert_eq!(fine.log_radiance.dims(), [8, 16, 3]);
        assert!(fine.log_radiance.val().is_require_grad());
        let fine = of(&fine)?;
        for (row, expected) in [0.0, 0.25, 0.75, 1.25, 1.75, 2.25, 2.75, 3.0]
            .iter()
            .enumerate()
        {
            for i in 0..48 {
                let expected = expected + (i % 3) as f64;
                assert!((fine[48 * row + i] - expected).abs() < 1e-6, "{row} {i}");
            }
        }
        assert!(map.resized(0).is_err());
        Ok(())
    }
}
