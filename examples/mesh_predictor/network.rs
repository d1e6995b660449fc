//! The network that maps an image to a body and its color.

use burn::module::Module;
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::nn::{GroupNorm, GroupNormConfig, Initializer, Linear, LinearConfig, PaddingConfig2d};
use burn::tensor::activation::{relu, sigmoid};
use burn::tensor::{Device, Tensor};
use softray::modules::TetrahedralGrid;
use softray::prelude::{Mesh, Scene};

use super::render::{Light, scene};
use super::settings::Settings;
use super::template::{Template, TemplateHead};

/// The radius of the ball that an untrained network predicts, in scene units.
pub const RADIUS: f64 = 0.55;
/// What the outputs of the network are multiplied by: distances in scene units.
const SCALE: f64 = 0.3;
/// The gain of the last kernel's start, so small that the first bodies are about a ball.
const START: f64 = 0.05;

fn convolution([input, output]: [usize; 2], kernel: usize) -> Conv2dConfig {
    let side = kernel / 2;
    Conv2dConfig::new([input, output], [kernel; 2])
        .with_padding(PaddingConfig2d::Explicit(side, side, side, side))
}

/// Two convolutions beside a shortcut, with norms before them (He et al. 2016, *Identity Mappings in Deep Residual
/// Networks*).
#[derive(Module, Debug)]
pub struct Residual {
    norms: [GroupNorm; 2],
    convolutions: [Conv2d; 2],
    shortcut: Conv2d,
}

impl Residual {
    fn new([input, output]: [usize; 2], stride: usize, device: &Device) -> Self {
        let norm = |channels| GroupNormConfig::new(4, channels).init(device);
        let strided = |kernel| {
            let config = convolution([input, output], kernel);
            config.with_stride([stride; 2]).init(device)
        };
        Self {
            norms: [norm(input), norm(output)],
            convolutions: [strided(3), convolution([output; 2], 3).init(device)],
            shortcut: strided(1),
        }
    }

    fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        let mut y = x.clone();
        for (norm, convolution) in self.norms.iter().zip(&self.convolutions) {
            y = convolution.forward(relu(norm.forward(y)));
        }
        self.shortcut.forward(x) + y
    }
}

/// From features of the image at each resolution to distances at the nodes of a grid (a U-Net, Ronneberger et al. 2015). The
/// rows and columns of a feature map are about those of the grid as the input camera sees it: perspective moves nodes by at
/// most a sixth of the image. Its channels are the nodes along the third axis.
#[derive(Module, Debug)]
struct GridHead {
    start: Linear,
    levels: Vec<Residual>,
    norm: GroupNorm,
    distances: Conv2d,
}

impl GridHead {
    fn new(settings: &Settings, device: &Device) -> Self {
        let channels = &settings.channels;
        let last = channels.len() - 1;
        // The level of the grid's resolution.
        let first = (settings.size / settings.nodes).ilog2() as usize - 1;
        let level =
            |k: usize| Residual::new([channels[k + 1] + channels[k], channels[k]], 1, device);
        let fine = channels[first];
        Self {
            start: LinearConfig::new(settings.hidden, channels[last]).init(device),
            levels: (first..last).rev().map(level).collect(),
            norm: GroupNormConfig::new(4, fine).init(device),
            distances: convolution([fine, settings.nodes], 3)
                .with_initializer(Initializer::KaimingUniform {
                    gain: START,
                    fan_out_only: false,
                })
                .init(device),
        }
    }

    /// Distances `[B, N, N, N]` along x, y and z, of features, the finest first, and codes `[B, hidden]`.
    fn forward(&self, mut features: Vec<Tensor<4>>, code: Tensor<2>) -> Tensor<4> {
        let last = features.pop().expect("features");
        let mut x = last + self.start.forward(code).unsqueeze_dims::<4>(&[2, 3]);
        for level in &self.levels {
            let skipped = features.pop().expect("features of each level");
            x = level.forward(Tensor::cat(vec![doubled(x), skipped], 1));
        }
        let out = self.distances.forward(relu(self.norm.forward(x)));
        // Rows go down, y goes up.
        out.flip([2]).permute([0, 3, 2, 1])
    }
}

/// Repeats each pixel of images `[B, C, H, W]` twice along both axes.
fn doubled(x: Tensor<4>) -> Tensor<4> {
    let [b, c, h, w] = x.dims();
    let x = x.reshape([b, c, h, 1, w, 1]).expand([b, c, h, 2, w, 2]);
    x.reshape([b, c, 2 * h, 2 * w])
}

/// A residual network, and a head for bodies of one of two kinds.
#[derive(Module, Debug)]
pub struct Network {
    stem: Conv2d,
    levels: Vec<Residual>,
    hidden: Linear,
    color: Linear,
    grid: Option<GridHead>,
    template: Option<TemplateHead>,
}

/// Bodies of B objects to render.
#[derive(Clone)]
pub struct Bodies {
    pub meshes: Vec<Mesh>,
    /// Albedo `[B, 3]`.
    pub color: Tensor<2>,
    /// The distances whose surfaces the meshes are, `[B, N, N, N]` along x, y and z in scene units.
    pub distances: Option<Tensor<4>>,
}

/// What makes bodies of the network's outputs.
#[derive(Clone)]
pub enum Decoder {
    Grid {
        grid: TetrahedralGrid,
        /// The distances of a ball, `[1, N, N, N]`.
        ball: Tensor<4>,
    },
    Template(Template),
}

impl Network {
    /// Creates the network of some settings, with random parameters by a seed, on a device without autodiff, to which it
    /// adds that.
    pub fn new(settings: &Settings, seed: u64, device: &Device) -> Self {
        let (channels, hidden) = (&settings.channels, settings.hidden);
        let device = &device.clone().autodiff();
        device.seed(seed);
        let level = |pair: &[usize]| Residual::new([pair[0], pair[1]], 2, device);
        let side = settings.size >> channels.len();
        let features = side * side * channels[channels.len() - 1];
        let stem = convolution([3, channels[0]], 5).with_stride([2; 2]);
        let template = settings.template;
        Self {
            stem: stem.init(device),
            levels: channels.windows(2).map(level).collect(),
            hidden: LinearConfig::new(features, hidden).init(device),
            color: LinearConfig::new(hidden, 3).init(device),
            grid: (!template).then(|| GridHead::new(settings, device)),
            template: template.then(|| TemplateHead::new(hidden, device)),
        }
    }

    /// Applies the network to images `[B, H, W, 3]` in linear radiance.
    pub fn forward(&self, images: Tensor<4>, decoder: &Decoder) -> softray::Result<Bodies> {
        // Centered at about 0, with a spread of about 1.
        let mut x = self
            .stem
            .forward((images.permute([0, 3, 1, 2]) - 0.4) * 4.0);
        let mut features = vec![x.clone()];
        for level in &self.levels {
            x = level.forward(x);
            features.push(x.clone());
        }
        let code = relu(self.hidden.forward(relu(x).flatten::<2>(1, 3)));
        let color = sigmoid(self.color.forward(code.clone()) * 3.0);
        let (meshes, distances) = match (decoder, &self.grid, &self.template) {
            (Decoder::Grid { grid, ball }, Some(head), _) => {
                let distances = head.forward(features, code) * SCALE + ball.clone();
                let distances = with_surface(distances, grid.step());
                (grid.surfaces(distances.clone(), None)?, Some(distances))
            }
            (Decoder::Template(template), _, Some(head)) => (template.bodies(head, code), None),
            _ => unreachable!("the decoder is that of the network's head"),
        };
        Ok(Bodies {
            meshes,
            color,
            distances,
        })
    }
}

/// Lowers the distances `[B, N, N, N]` of each grid whose least one is above −0.1 steps, so that this node is inside. The
/// change is constant for gradients.
fn with_surface(distances: Tensor<4>, step: f64) -> Tensor<4> {
    let [count, n, ..] = distances.dims();
    let inner = distances
        .clone()
        .slice([0..count, 1..n - 1, 1..n - 1, 1..n - 1]);
    let least = inner.reshape([count as i32, -1]).min_dim(1).detach();
    let over = (least + 0.1 * step).clamp_min(0.0);
    distances - over.unsqueeze_dims::<4>(&[2, 3])
}

impl Decoder {
    /// Creates the decoder of some settings on a device without autodiff.
    pub fn new(settings: &Settings, device: &Device) -> softray::Result<Self> {
        if settings.template {
            return Ok(Self::Template(Template::new(device)?));
        }
        let grid = settings.grid()?;
        let far = grid.nodes(device).powi_scalar(2).sum_dim(3).sqrt();
        let ball = far.squeeze_dim::<3>(3).unsqueeze::<4>() - RADIUS;
        Ok(Self::Grid { grid, ball })
    }
}

impl Bodies {
    /// Returns the scene of the `i`-th body under a light.
    pub fn scene(&self, i: usize, light: &Light) -> Scene {
        scene(self.meshes[i].clone(), row(&self.color, i), light)
    }
}

/// Returns row `i`, `[C]`, of a table `[B, C]`.
pub fn row(table: &Tensor<2>, i: usize) -> Tensor<1> {
    table.clone().slice([i..i + 1]).squeeze_dim(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::{Distribution, TensorData};

    /// The distance at a node depends on the pixels where the input camera sees the node: rows go down and y goes up.
    #[test]
    fn nodes_see_their_pixels() {
        let settings = Settings::tiny();
        let device = Device::flex();
        let decoder = Decoder::new(&settings, &device).expect("a grid");
        let network = Network::new(&settings, 3, &device);
        let (size, nodes) = (settings.size, settings.nodes);
        let shape = [1, size, size, 3];
        let images = Tensor::<4>::random(shape, Distribution::Uniform(0.2, 0.6), &device);
        for [x, y] in [[2, 3], [13, 3], [2, 12]] {
            let images = images.clone().autodiff().require_grad();
            let bodies = network
                .forward(images.clone(), &decoder)
                .expect("a surface");
            let distances = bodies.distances.expect("a grid");
            let column = distances.slice([0..1, x..x + 1, y..y + 1, 0..nodes]);
            let by = images.grad(&column.powi_scalar(2).sum().backward());
            let by: TensorData = by
                .expect("a gradient")
                .powi_scalar(2)
                .sum_dim(3)
                .into_data();
            let by: Vec<f64> = by.iter::<f64>().collect();
            let most = (0..by.len()).max_by(|&a, &b| by[a].total_cmp(&by[b]));
            let most = most.expect("pixels");
            let seen = [most % size, size - 1 - most / size].map(|at| at * nodes / size);
            let apart = seen[0].abs_diff(x).max(seen[1].abs_diff(y));
            assert!(apart <= 3, "{seen:?} for {x}, {y}");
        }
    }
}
