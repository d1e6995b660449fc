//! One training step of a small network that looks at images and is taught by renders of what it
//! predicts: the same program on every device.

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::optim::{AdamConfig, GradientsParams, ModuleOptimizer};
use burn::tensor::activation::{sigmoid, tanh};
use burn::tensor::{DType, Device, Tensor, TensorData};
use softray::prelude::*;

use super::numbers::apart;
use super::values;

const ITEMS: usize = 2;
const SIZE: usize = 12;
const VERTICES: usize = 12;

/// A linear layer of products and sums: `matmul` returns zeros on the software driver of the wgpu tests
/// (ARCHITECTURE.md, *Backends*).
#[derive(Module, Debug)]
struct Dense {
    /// `[inputs, outputs]`.
    weight: Param<Tensor<2>>,
    /// `[outputs]`.
    bias: Param<Tensor<1>>,
}

impl Dense {
    fn new(inputs: usize, outputs: usize, device: &Device) -> Self {
        Self {
            weight: Param::from_tensor(Tensor::zeros([inputs, outputs], device)),
            bias: Param::from_tensor(Tensor::zeros([outputs], device)),
        }
    }

    fn forward(&self, x: Tensor<2>) -> Tensor<2> {
        let [count, inputs] = x.dims();
        let [outputs] = self.bias.dims();
        let products = x.reshape([count, inputs, 1]) * self.weight.val().unsqueeze::<3>();
        let sums = products.sum_dim(1).reshape([count, outputs]);
        sums + self.bias.val().unsqueeze::<2>()
    }
}

/// From images `[B, 3, 12, 12]` to offsets of an icosahedron's vertices and a color.
#[derive(Module, Debug)]
struct Predictor {
    encoder: Conv2d,
    offsets: Dense,
    color: Dense,
}

impl Predictor {
    fn new(device: &Device) -> Self {
        let wide = 4 * 5 * 5;
        let network = Self {
            encoder: Conv2dConfig::new([3, 4], [3, 3])
                .with_stride([2, 2])
                .init(device),
            offsets: Dense::new(wide, 3 * VERTICES, device),
            color: Dense::new(wide, 3, device),
        };
        // Backends have random numbers of their own.
        network.map(&mut Fill(0))
    }

    /// Offsets `[B, 12, 3]` and colors `[B, 3]`.
    fn forward(&self, images: Tensor<4>) -> (Tensor<3>, Tensor<2>) {
        let features: Tensor<2> = tanh(self.encoder.forward(images)).flatten(1, 3);
        let offsets = self.offsets.forward(features.clone()) * 0.2;
        let colors = sigmoid(self.color.forward(features));
        (offsets.reshape([ITEMS, VERTICES, 3]), colors)
    }
}

/// Numbers from −½ to ½ over √fan-in, the same on all devices.
struct Fill(u32);

impl ModuleMapper for Fill {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        param.map(|old| {
            let shape: [usize; D] = old.dims();
            let count: usize = shape.iter().product();
            let wide = (count as f64 / shape[0].max(shape[D - 1]) as f64).max(1.0);
            let values: Vec<f32> = (0..count)
                .map(|_| {
                    self.0 = self.0.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
                    let bits = self.0 ^ (self.0 >> 15);
                    ((f64::from(bits) / 4_294_967_296.0 - 0.5) / wide.sqrt()) as f32
                })
                .collect();
            Tensor::from_data(TensorData::new(values, shape), &old.device())
                .autodiff()
                .require_grad()
                .require_grad()
        })
    }
}

/// The values or gradients of all parameters, with their paths.
struct Gather<'a> {
    path: Vec<String>,
    gradients: Option<&'a GradientsParams>,
    values: Vec<(String, Vec<f64>)>,
}

impl ModuleVisitor for Gather<'_> {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.path.push(name.into());
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let numbers = match self.gradients {
            Some(gradients) => gradients.get::<D>(param.id).map(|g| values(&g)),
            None => Some(values(&param.val())),
        };
        let numbers = numbers.unwrap_or_default();
        self.values.push((self.path.join("."), numbers));
    }
}

fn gather(network: &Predictor, gradients: Option<&GradientsParams>) -> Vec<(String, Vec<f64>)> {
    let mut gather = Gather {
        path: Vec::new(),
        gradients,
        values: Vec::new(),
    };
    network.visit(&mut gather);
    gather.values
}

/// What a step brought.
pub struct Outcome {
    pub loss: f64,
    /// By parameter.
    pub gradients: Vec<(String, Vec<f64>)>,
    /// After the step of Adam.
    pub parameters: Vec<(String, Vec<f64>)>,
}

/// A network in training on a device.
pub struct Training {
    network: Predictor,
    optimizer: ModuleOptimizer,
    ball: Mesh,
    camera: Camera,
    options: RenderOptions,
    /// `[B, H, W, 3]`.
    targets: Tensor<4>,
}

impl Training {
    pub fn new(device: &Device) -> Self {
        let ball = shapes::icosahedron(device).cast(DType::F32);
        let camera = Camera::look_at([0.0, 0.5, 4.0], [0.0; 3]).with_fov_y(40.0);
        let options = RenderOptions::new(SIZE, SIZE)
            .with_samples(2)
            .with_bounces(0)
            .with_blur(1.146);
        let scales: [[f32; 3]; ITEMS] = [[0.8, 1.1, 0.9], [1.2, 0.7, 1.0]];
        let scales = Tensor::<2>::from_data(TensorData::from(scales), device);
        let vertices = ball.vertices.clone().unsqueeze::<3>();
        let stretched = vertices * scales.reshape([ITEMS, 1, 3]);
        let colors = [[0.9, 0.3, 0.2], [0.2, 0.5, 0.8]];
        let scenes = colors.map(|c| scene(&ball, c.into())).to_vec();
        let batch = Batch::new(scenes, vec![camera.clone()]).expect("a batch");
        let batch = batch.with_vertices("body", stretched).expect("vertices");
        let targets =
            render_batch(&batch, &options.clone().with_samples(8).with_seed(3)).expect("images");
        Self {
            network: Predictor::new(&device.clone().autodiff()),
            optimizer: AdamConfig::new().init(),
            ball,
            camera,
            options,
            targets: targets.radiance,
        }
    }

    /// One step; returns the loss and the gradients.
    pub fn step(&mut self, seed: u64) -> (f64, Vec<(String, Vec<f64>)>) {
        let images = self.targets.clone().permute([0, 3, 1, 2]);
        let (offsets, colors) = self.network.forward(images);
        let scenes = (0..ITEMS)
            .map(|i| {
                let color = colors.clone().slice([i..i + 1]).reshape([3]);
                scene(&self.ball, color.into())
            })
            .collect();
        let batch = Batch::new(scenes, vec![self.camera.clone()]).expect("a batch");
        let vertices = self.ball.vertices.clone().unsqueeze::<3>() + offsets;
        let batch = batch.with_vertices("body", vertices).expect("vertices");
        let images = render_batch(&batch, &self.options.clone().with_seed(seed)).expect("images");
        let loss = (images.radiance - self.targets.clone()).powf_scalar(2.0);
        let loss = loss.mean();
        let value = values(&loss)[0];
        let gradients = GradientsParams::from_grads(loss.backward(), &self.network);
        let found = gather(&self.network, Some(&gradients));
        self.network = self.optimizer.step(1e-2, self.network.clone(), gradients);
        (value, found)
    }
}

fn scene(ball: &Mesh, color: Parameter<3>) -> Scene {
    let material = Material::diffuse(color);
    Scene::new()
        .with_object(
            Object::new(ball.clone())
                .with_name("body")
                .with_material(material),
        )
        .with_environment([1.0, 0.9, 0.8])
}

/// The first step on a device.
pub fn step(device: &Device) -> Outcome {
    let mut training = Training::new(device);
    let (loss, gradients) = training.step(3);
    Outcome {
        loss,
        gradients,
        parameters: gather(&training.network, None),
    }
}

/// Compares two steps: losses, and gradients by parameter relative to their norm.
pub fn assert_close(a: &Outcome, b: &Outcome, bound: f64) {
    assert!(
        (a.loss - b.loss).abs() <= bound * b.loss.abs(),
        "losses {} and {}",
        a.loss,
        b.loss
    );
    assert_eq!(a.gradients.len(), b.gradients.len());
    for ((name, a), (_, b)) in a.gradients.iter().zip(&b.gradients) {
        let apart = apart(a, b);
        println!("{name}: {apart:.1e} apart");
        assert!(apart <= bound, "{name}: {apart:e} apart");
    }
}

/// The network learns by what renders say: every weight has a gradient, finite and not all zero, and
/// the step moves it.
pub fn assert_taught(outcome: &Outcome) {
    assert!(outcome.loss.is_finite() && outcome.loss > 0.0);
    assert_eq!(outcome.gradients.len(), 6);
    assert_eq!(outcome.parameters.len(), 6);
    for (name, gradient) in &outcome.gradients {
        assert!(!gradient.is_empty(), "{name} has no gradient");
        assert!(gradient.iter().all(|g| g.is_finite()), "{name}");
        assert!(gradient.iter().any(|&g| g != 0.0), "{name} is all zero");
    }
    let before = gather(&Predictor::new(&Device::flex()), None);
    for ((name, a), (_, b)) in before.iter().zip(&outcome.parameters) {
        assert_ne!(a, b, "{name} has not moved");
    }
}
