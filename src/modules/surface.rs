use burn::config::Config;
use burn::module::Module;
use burn::nn::{Linear, LinearConfig};
use burn::tensor::activation::{leaky_relu, sigmoid};
use burn::tensor::{Device, Tensor};

use super::values::logit;
use crate::error::{Error, Result};
use crate::scene::Range;

/// The factor of the last layer's outputs: logits need to move farther than weights.
const GAIN: f64 = 3.0;
/// The least roughness: a smoother surface would show more of the light than a map of it has.
const LEAST: f64 = 0.1;

/// The configuration of a [`SurfaceNetwork`], which starts about as rather smooth paint everywhere.
#[derive(Config, Debug)]
pub struct SurfaceNetworkConfig {
    /// The number of neurons of a layer.
    #[config(default = 32)]
    pub width: usize,
    /// The number of octaves of waves by which it knows places; 0 if colors alone count.
    #[config(default = 2)]
    pub octaves: usize,
    /// The metallic share about which it starts, in (0, 1).
    #[config(default = 0.05)]
    pub metallic: f64,
    /// The roughness about which it starts, in (0.1, 1).
    #[config(default = 0.34)]
    pub roughness: f64,
}

impl SurfaceNetworkConfig {
    /// Creates the network, in the device's default float type.
    ///
    /// # Errors
    /// If the width is 0, or a start is outside of its range.
    pub fn init(&self, device: &Device) -> Result<SurfaceNetwork> {
        Error::unless(self.width > 0, "surface network", "width", 0, "at least 1")?;
        let starts = [self.metallic, (self.roughness - LEAST) / (1.0 - LEAST)];
        Range::Share.check("surface network", "metallic and roughness", &starts)?;
        let layer = |from, to| LinearConfig::new(from, to).init(device);
        let starts = starts.map(|x| logit(x.clamp(1e-3, 1.0 - 1e-3)) as f32);
        Ok(SurfaceNetwork {
            first: layer(3 + 6 * self.octaves, self.width),
            second: layer(self.width, self.width),
            last: layer(self.width, 2),
            starts: Tensor::<1>::from_floats(starts, device).unsqueeze(),
            octaves: self.octaves,
        })
    }
}

/// Metallic and roughness of the points of a surface, as a function of their base color and place.
///
/// A texture of free texels learns them slowly from photographs: they show in highlights, which pass each texel in a few
/// photographs only. A small network shares what one of them shows with all points of a similar color, and nearby. (Like the
/// networks of nvdiffrec, Munkberg et al. 2022, but with the color as an input.)
///
/// ```
/// use softray::modules::SurfaceNetworkConfig;
/// use softray::prelude::*;
/// let device = Device::flex().autodiff();
/// let network = SurfaceNetworkConfig::new().init(&device)?;
/// let colors = Tensor::from_floats([[0.1, 0.4, 0.5], [1.0, 0.8, 0.3]], &device);
/// let places = Tensor::from_floats([[0.0, 0.5, 0.0], [0.2, -0.5, 0.1]], &device);
/// let [metallic, roughness] = network.forward(colors, places);
/// assert_eq!((metallic.dims(), roughness.dims()), ([2], [2]));
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Module)]
pub struct SurfaceNetwork {
    /// The layers, with leaky rectifiers between them.
    pub first: Linear,
    /// The second layer.
    pub second: Linear,
    /// The last layer, whose outputs are logits.
    pub last: Linear,
    /// The logits about which it starts, `[1, 2]`.
    starts: Tensor<2>,
    octaves: usize,
}

impl SurfaceNetwork {
    /// Returns the metallic shares, 0 to 1, and the values of roughness, 0.1 to 1, of N points: of linear base colors `[N, 3]`
    /// from 0 to 1, and places `[N, 3]` in a frame in which the object is about as large as the unit
    /// ball; places may be on a device without autodiff.
    pub fn forward(&self, colors: Tensor<2>, places: Tensor<2>) -> [Tensor<1>; 2] {
        let places = if colors.is_autodiff() {
            places.autodiff()
        } else {
            places
        };
        let mut inputs = vec![colors * 4.0 - 2.0];
        for octave in 0..self.octaves {
            let angles = places.clone() * (std::f64::consts::FRAC_PI_2 * 2f64.powi(octave as i32));
            inputs.extend([angles.clone().sin(), angles.cos()]);
        }
        let x = leaky_relu(self.first.forward(Tensor::cat(inputs, 1)), 0.05);
        let x = leaky_relu(self.second.forward(x), 0.05);
        let shares = sigmoid(self.last.forward(x) * GAIN + self.starts.clone());
        let output = |k: usize| shares.clone().narrow(1, k, 1).squeeze_dim::<1>(1);
        [output(0), output(1) * (1.0 - LEAST) + LEAST]
    }
}
