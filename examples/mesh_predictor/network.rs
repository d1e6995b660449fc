//! The network that maps an image to a deformed ball, its pose and its color.

use burn::module::Module;
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::nn::{GroupNorm, GroupNormConfig, Linear, LinearConfig, PaddingConfig2d};
use burn::tensor::activation::{relu, sigmoid, tanh};
use burn::tensor::{Device, Tensor, TensorData};
use glam::DVec3;
use softray::prelude::{Mesh, Scene, Transform, shapes};

use super::basis::{degrees, harmonics};
use super::render::{Light, SIZE, scene};
use super::settings::Settings;

/// The radius of the ball before deformation, in scene units.
const RADIUS: f64 = 0.55;
/// The largest translation of a body along an axis, in scene units. It keeps bodies inside the image, since no
/// gradient would bring them back.
const FARTHEST: f64 = 0.5;

/// Convolutions with stride 2, a hidden layer, and a linear layer for each part of the output.
#[derive(Module, Debug)]
pub struct Network {
    convolutions: Vec<Conv2d>,
    norms: Vec<GroupNorm>,
    hidden: Linear,
    offsets: Linear,
    rotation: Linear,
    translation: Linear,
    color: Linear,
}

/// The output of the network for B images.
pub struct Code {
    /// Coefficients of the vertices' offsets `[B, 3, K]`.
    pub offsets: Tensor<3>,
    /// The first two columns of rotations `[B, 6]`.
    pub rotation: Tensor<2>,
    /// `[B, 3]`, in scene units.
    pub translation: Tensor<2>,
    /// Albedo `[B, 3]`.
    pub color: Tensor<2>,
}

impl Network {
    /// Creates the network of some settings, with random parameters by a seed, on a device without autodiff, to which it
    /// adds that.
    pub fn new(settings: &Settings, seed: u64, device: &Device) -> Self {
        let (channels, hidden) = (&settings.channels, settings.hidden);
        let device = &device.clone().autodiff();
        device.seed(seed);
        let inputs = std::iter::once(3).chain(channels.iter().copied());
        let convolution = |(input, &output): (usize, &usize)| {
            Conv2dConfig::new([input, output], [3, 3])
                .with_stride([2, 2])
                .with_padding(PaddingConfig2d::Explicit(1, 1, 1, 1))
                .init(device)
        };
        let norm = |&channels: &usize| GroupNormConfig::new(4, channels).init(device);
        let side = SIZE >> channels.len();
        let features = side * side * channels.last().copied().unwrap_or(3);
        let linear = |input: usize, output: usize| LinearConfig::new(input, output).init(device);
        Self {
            convolutions: inputs.zip(channels).map(convolution).collect(),
            norms: channels.iter().map(norm).collect(),
            hidden: linear(features, hidden),
            offsets: linear(hidden, 3 * degrees(settings.degree).len()),
            rotation: linear(hidden, 6),
            translation: linear(hidden, 3),
            color: linear(hidden, 3),
        }
    }

    /// Applies the network to images `[B, H, W, 3]` in linear radiance.
    pub fn forward(&self, images: Tensor<4>) -> Code {
        let count = images.dims()[0];
        // Centered at about 0, with a spread of about 1.
        let mut x = (images.permute([0, 3, 1, 2]) - 0.4) * 4.0;
        for (convolution, norm) in self.convolutions.iter().zip(&self.norms) {
            x = relu(norm.forward(convolution.forward(x)));
        }
        let x = relu(self.hidden.forward(x.flatten::<2>(1, 3)));
        let device = x.device();
        let upright = Tensor::<2>::from_floats([[1.0, 0.0, 0.0, 0.0, 1.0, 0.0]], &device);
        let offsets = self.offsets.forward(x.clone());
        let functions = offsets.dims()[1] / 3;
        Code {
            offsets: offsets.reshape([count, 3, functions]),
            rotation: self.rotation.forward(x.clone()) + upright,
            translation: tanh(self.translation.forward(x.clone())) * FARTHEST,
            color: sigmoid(self.color.forward(x) * 3.0),
        }
    }
}

/// Computes vertices from codes: sums of spherical harmonics offset the vertices of a ball, which is then rotated and
/// translated.
///
/// Images determine the resulting body, but not its split into offsets and rotation: harmonics of degree 1 are linear
/// maps, so a rotation can be part of either.
#[derive(Clone)]
pub struct Decoder {
    /// The ball of radius [`RADIUS`].
    pub ball: Mesh,
    /// The directions of its vertices.
    pub directions: Vec<DVec3>,
    /// The functions at the vertices `[K, V]`, smaller at higher degrees, so that finer details are learned later.
    basis: Tensor<2>,
}

/// Bodies to render.
#[derive(Clone)]
pub struct Bodies {
    /// `[B, V, 3]`, in scene units.
    pub vertices: Tensor<3>,
    /// Albedo `[B, 3]`.
    pub color: Tensor<2>,
}

impl Decoder {
    /// Creates a decoder for an icosphere with `subdivisions` subdivisions and harmonics up to `degree`.
    pub fn new(subdivisions: u32, degree: usize, device: &Device) -> softray::Result<Self> {
        let sphere = shapes::icosphere(subdivisions, device);
        let directions = sphere.host_vertices()?.into_iter();
        let directions: Vec<DVec3> = directions.map(|v| DVec3::from(v).normalize()).collect();
        let (functions, vertices) = (degrees(degree), directions.len());
        let mut values = vec![0_f32; functions.len() * vertices];
        for (v, direction) in directions.iter().enumerate() {
            let at = harmonics(degree, *direction);
            for (k, (value, &l)) in at.iter().zip(&functions).enumerate() {
                values[k * vertices + v] = (0.6 * value / l as f64) as f32;
            }
        }
        let basis = TensorData::new(values, [functions.len(), vertices]);
        let ball = sphere.vertices.clone() * RADIUS;
        Ok(Self {
            ball: sphere.with_vertices(ball),
            directions,
            basis: Tensor::from_data(basis, device),
        })
    }

    /// Returns the bodies of codes.
    pub fn bodies(&self, code: Code) -> Bodies {
        let [count, _, functions] = code.offsets.dims();
        let vertices = self.directions.len();
        let offsets = code.offsets.reshape([3 * count, functions]);
        let offsets = offsets.matmul(self.basis.clone());
        let offsets = offsets.reshape([count, 3, vertices]).swap_dims(1, 2);
        let local = self.ball.vertices.clone().unsqueeze::<3>() + offsets;
        let placed = |i: usize| {
            let pose = Transform::new()
                .with_six_d(row(&code.rotation, i))
                .with_translation(row(&code.translation, i));
            pose.apply(local.clone().slice([i..i + 1]).squeeze_dim(0))
        };
        Bodies {
            vertices: Tensor::stack((0..count).map(placed).collect(), 0),
            color: code.color,
        }
    }

    /// Returns the scene of the `i`-th body under a light.
    pub fn scene(&self, bodies: &Bodies, i: usize, light: &Light) -> Scene {
        let vertices = bodies.vertices.clone().slice([i..i + 1]).squeeze_dim(0);
        let mesh = self.ball.clone().with_vertices(vertices);
        scene(mesh, row(&bodies.color, i), light)
    }
}

/// Returns row `i`, `[C]`, of a table `[B, C]`.
pub fn row(table: &Tensor<2>, i: usize) -> Tensor<1> {
    table.clone().slice([i..i + 1]).squeeze_dim(0)
}
