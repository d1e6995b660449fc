//! Bodies that are deformed balls, to compare with: spherical harmonics offset vertices of a ball, which is then rotated and
//! translated.

use burn::module::Module;
use burn::nn::{Linear, LinearConfig};
use burn::tensor::activation::tanh;
use burn::tensor::{Device, Tensor, TensorData};
use glam::DVec3;
use softray::optim::MeshRegularizer;
use softray::prelude::{Mesh, Transform, shapes};

use super::harmonics::{degrees, harmonics};
use super::network::{RADIUS, row};

/// The highest degree of the harmonics.
const DEGREE: usize = 8;
/// Subdivisions of the ball.
const SUBDIVISIONS: u32 = 3;
/// The largest translation of a body along an axis, in scene units. It keeps bodies inside the image, since no
/// gradient would bring them back.
const FARTHEST: f64 = 0.5;

/// Linear layers for each part of the output.
#[derive(Module, Debug)]
pub struct TemplateHead {
    offsets: Linear,
    rotation: Linear,
    translation: Linear,
}

impl TemplateHead {
    pub fn new(hidden: usize, device: &Device) -> Self {
        let linear = |output: usize| LinearConfig::new(hidden, output).init(device);
        Self {
            offsets: linear(3 * degrees(DEGREE).len()),
            rotation: linear(6),
            translation: linear(3),
        }
    }
}

/// The ball, and functions at its vertices.
#[derive(Clone)]
pub struct Template {
    ball: Mesh,
    /// `[K, V]`, smaller at higher degrees, so that finer details are learned later.
    basis: Tensor<2>,
    pub regular: MeshRegularizer,
}

impl Template {
    pub fn new(device: &Device) -> softray::Result<Self> {
        let sphere = shapes::icosphere(SUBDIVISIONS, device);
        let directions = sphere.host_vertices()?;
        let (functions, vertices) = (degrees(DEGREE), directions.len());
        let mut values = vec![0_f32; functions.len() * vertices];
        for (v, &direction) in directions.iter().enumerate() {
            let at = harmonics(DEGREE, DVec3::from(direction).normalize());
            for (k, (value, &l)) in at.iter().zip(&functions).enumerate() {
                values[k * vertices + v] = (0.6 * value / l as f64) as f32;
            }
        }
        let basis = TensorData::new(values, [functions.len(), vertices]);
        let ball = sphere.vertices.clone() * RADIUS;
        let ball = sphere.with_vertices(ball);
        Ok(Self {
            regular: MeshRegularizer::from_mesh(&ball)?,
            ball,
            basis: Tensor::from_data(basis, device),
        })
    }

    /// Returns the bodies of codes `[B, hidden]`. Images determine a body, but not its split into offsets and rotation:
    /// harmonics of degree 1 are linear maps, so a rotation can be part of either.
    pub fn bodies(&self, head: &TemplateHead, code: Tensor<2>) -> Vec<Mesh> {
        let count = code.dims()[0];
        let offsets = head.offsets.forward(code.clone());
        let [functions, vertices] = self.basis.dims();
        let offsets = offsets.reshape([3 * count, functions]);
        let offsets = offsets.matmul(self.basis.clone());
        let offsets = offsets.reshape([count, 3, vertices]).swap_dims(1, 2);
        let ball = self.ball.vertices.clone();
        let upright = [[1.0, 0.0, 0.0, 0.0, 1.0, 0.0]];
        let upright = Tensor::<2>::from_floats(upright, &code.device());
        let rotation = head.rotation.forward(code.clone()) + upright;
        let translation = tanh(head.translation.forward(code)) * FARTHEST;
        let body = |i: usize| {
            let pose = Transform::new()
                .with_six_d(row(&rotation, i))
                .with_translation(row(&translation, i));
            let local = offsets.clone().slice([i..i + 1]).squeeze_dim(0) + ball.clone();
            self.ball.clone().with_vertices(pose.apply(local))
        };
        (0..count).map(body).collect()
    }
}
