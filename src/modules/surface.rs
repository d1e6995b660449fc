use burn::config::Config;
use burn::module::Module;
use burn::nn::{Linear, LinearConfig};
use burn::tensor::activation::{leaky_relu, sigmoid};
use burn::tensor::{Device, Tensor};

use super::values::{leaf, logit};
use crate::error::{Error, Result};
use crate::scene::Range;
use softray_kernels::model::integers::mix;

/// The factor of the last layer's outputs: logits need to move farther than weights.
const GAIN: f64 = 3.0;
/// The least roughness: a smoother surface would show more of the light than a map of it has.
const LEAST: f64 = 0.1;

/// The configuration of a [`SurfaceNetwork`], which starts between paint and metal everywhere.
#[derive(Config, Debug)]
pub struct SurfaceNetworkConfig {
    /// The number of neurons of a layer.
    #[config(default = 32)]
    pub width: usize,
    /// The number of frequencies of the positional encoding; 0 to use colors alone.
    #[config(default = 2)]
    pub octaves: usize,
    /// The metallic share about which it starts, in (0, 1).
    #[config(default = 0.5)]
    pub metallic: f64,
    /// The roughness about which it starts, in (0.1, 1).
    #[config(default = 0.34)]
    pub roughness: f64,
    /// The seed of the weights.
    #[config(default = 0)]
    pub seed: u64,
}

impl SurfaceNetworkConfig {
    /// Creates the network, in the device's default float type.
    ///
    /// # Errors
    /// If the width is 0, or a start is outside of its range.
    pub fn init(&self, device: &Device) -> Result<SurfaceNetwork> {
        Error::unless(self.width > 0, "surface network", "width", 0, "at least 1")?;
        Range::Share.check("surface network", "metallic", &[self.metallic])?;
        let range = Range::Within(LEAST, 1.0);
        range.check("surface network", "roughness", &[self.roughness])?;
        let starts = [self.metallic, (self.roughness - LEAST) / (1.0 - LEAST)];
        let starts = starts.map(|x| logit(x.clamp(1e-3, 1.0 - 1e-3)));
        Ok(SurfaceNetwork {
            first: self.layer(0, [3 + 6 * self.octaves, self.width], device),
            second: self.layer(1, [self.width, self.width], device),
            last: self.layer(2, [self.width, 2], device),
            starts: leaf(starts.to_vec(), [1, 2], device).val().detach(),
            octaves: self.octaves,
        })
    }

    /// A layer whose weights are uniform in ±1/√inputs, as burn's are, but from a seed of their own.
    fn layer(&self, index: u64, [inputs, outputs]: [usize; 2], device: &Device) -> Linear {
        let bound = (inputs as f64).sqrt().recip();
        let value = |i: usize| {
            let bits = mix(mix(mix(self.seed) ^ index) ^ i as u64) >> 11;
            bound * (bits as f64 / (1u64 << 52) as f64 - 1.0)
        };
        let mut layer = LinearConfig::new(inputs, outputs).init(device);
        let weights = inputs * outputs;
        layer.weight = leaf((0..weights).map(value).collect(), [inputs, outputs], device);
        let bias: Vec<f64> = (weights..weights + outputs).map(value).collect();
        layer.bias = Some(leaf(bias, [outputs], device));
        layer
    }
}

/// Metallic and roughness of the points of a surface, as a function of their base color and position.
///
/// Independent texels learn them slowly from photographs, because only highlights show them, and few photographs show a
/// highlight at a given texel. A small network applies what it learns to points of similar color or position. (Networks of
/// nvdiffrec, Munkberg et al. 2022, have the position as their input; here the color is another.)
///
/// ```
/// use softray::modules::SurfaceNetworkConfig;
/// use softray::prelude::*;
/// let device = Device::flex().autodiff();
/// let network = SurfaceNetworkConfig::new().init(&device)?;
/// let colors = Tensor::from_floats([[0.1, 0.4, 0.5], [1.0, 0.8, 0.3]], &device);
/// let positions = Tensor::from_floats([[0.0, 0.5, 0.0], [0.2, -0.5, 0.1]], &device);
/// let [metallic, roughness] = network.forward(colors, positions);
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
    /// from 0 to 1, and positions `[N, 3]` in a frame in which the object is about as large as the unit
    /// ball; positions may be on a device without autodiff, and of another float type.
    pub fn forward(&self, colors: Tensor<2>, positions: Tensor<2>) -> [Tensor<1>; 2] {
        let dtype = colors.dtype();
        let mut positions = positions.cast(dtype);
        if colors.is_autodiff() {
            positions = positions.autodiff();
        }
        let mut inputs = vec![colors * 4.0 - 2.0];
        for octave in 0..self.octaves {
            let angles =
                positions.clone() * (std::f64::consts::FRAC_PI_2 * 2f64.powi(octave as i32));
            inputs.extend([angles.clone().sin(), angles.cos()]);
        }
        let x = leaky_relu(self.first.forward(Tensor::cat(inputs, 1)), 0.05);
        let x = leaky_relu(self.second.forward(x), 0.05);
        let shares = sigmoid(self.last.forward(x) * GAIN + self.starts.clone().cast(dtype));
        let output = |k: usize| shares.clone().narrow(1, k, 1).squeeze_dim::<1>(1);
        [output(0), output(1) * (1.0 - LEAST) + LEAST]
    }
}
