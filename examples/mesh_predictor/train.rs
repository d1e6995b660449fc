//! The loss of a step: the difference between renders of the predictions and the images.

use std::time::Instant;

use softray::optim::{Evaluation, MeshRegularizer, Step, loss};
use softray::prelude::*;

use super::dataset::Dataset;
use super::evaluate::predict_and_measure;
use super::network::{Bodies, Decoder, Network, row};
use super::numbers::Numbers;
use super::render::{BODY, options, scene, see};
use super::settings::Settings;

/// Weights of the parts of the loss. The weight of silhouettes is 1.
const IMAGE: f64 = 20.0;
const NORMALS: f64 = 0.1;

/// Names of the forward pass's times in the history, in seconds.
pub const NETWORK_SECONDS: &str = "network s";
pub const RENDER_SECONDS: &str = "render s";

/// The inputs of training besides the network.
pub struct Trainer<'a> {
    pub settings: &'a Settings,
    pub data: &'a Dataset,
    pub validation: &'a Dataset,
    pub decoder: &'a Decoder,
    /// The decoder for the validation set.
    pub measured: &'a Decoder,
    pub regular: MeshRegularizer,
    /// A device without autodiff.
    pub device: Device,
}

/// The objects of a step: (item, eye) of the network's inputs, and of all views that are compared.
pub struct Objects {
    inputs: Vec<(usize, usize)>,
    compared: Vec<(usize, usize)>,
}

/// The parts of the loss.
pub struct Parts {
    pub image: Tensor<1>,
    pub silhouette: Tensor<1>,
    pub normals: Tensor<1>,
}

impl Parts {
    pub fn sum(&self) -> Tensor<1> {
        self.image.clone() * IMAGE + self.silhouette.clone() + self.normals.clone() * NORMALS
    }
}

impl Trainer<'_> {
    /// Chooses objects and views by the seed of the step.
    pub fn batch(&self, step: &Step) -> Objects {
        let n = &mut Numbers::new(step.seed(0), 1);
        let items = self.data.items.len();
        let inputs: Vec<_> = (0..self.settings.batch)
            .map(|_| (n.index(items), 0))
            .collect();
        let pair = |&(item, eye): &(usize, usize)| {
            let other = 1 + n.index(self.settings.views - 1);
            [(item, eye), (item, other)]
        };
        let compared = inputs.iter().flat_map(pair).collect();
        Objects { inputs, compared }
    }

    /// Returns the network's predictions for a batch.
    pub fn predict(&self, network: &Network, batch: &Objects) -> Bodies {
        let device = self.device.clone().autodiff();
        let images = self.data.images(&batch.inputs, &device).radiance;
        self.decoder.bodies(network.forward(images))
    }

    /// Returns the loss of bodies. Each view is rendered twice with independent noise, so that the variance of the
    /// noise does not bias the loss.
    pub fn compare(&self, bodies: &Bodies, batch: &Objects, step: &Step) -> softray::Result<Parts> {
        let template = |(k, &(item, _)): (usize, &(usize, usize))| {
            let light = &self.data.items[item].light;
            scene(self.decoder.ball.clone(), row(&bodies.color, k), light)
        };
        let scenes = batch.inputs.iter().enumerate().map(template).collect();
        let view = |(k, &(item, eye)): (usize, &(usize, usize))| {
            (k / 2, self.data.items[item].eyes[eye].camera())
        };
        let views = batch.compared.iter().enumerate().map(view).collect();
        let views = Batch::views(scenes, views)?;
        let views = views.with_vertices(BODY, bodies.vertices.clone())?;
        let few = options(self.settings.samples);
        let a = see(&views, &step.options(&few, 0))?;
        let b = see(&views, &step.options(&few, 1))?;
        let target = self.data.images(&batch.compared, &self.device);
        let image = (a.radiance - target.radiance.clone()) * (b.radiance - target.radiance);
        Ok(Parts {
            image: image.mean(),
            silhouette: loss::silhouette_iou((a.opacity + b.opacity) * 0.5, target.opacity)?,
            normals: self.regular.normal_consistency(bodies.vertices.clone()),
        })
    }

    /// Returns the loss of a step and, in some steps, the overlap on the validation set.
    pub fn evaluate(&self, network: &Network, step: &Step) -> softray::Result<Evaluation> {
        let batch = self.batch(step);
        let start = Instant::now();
        let bodies = self.predict(network, &batch);
        let predicted = start.elapsed();
        let parts = self.compare(&bodies, &batch, step)?;
        let rendered = start.elapsed() - predicted;
        let every = self.settings.steps.div_ceil(self.settings.evaluations);
        let validated = if step.index.is_multiple_of(every.max(1)) {
            predict_and_measure(self.validation, network, self.measured, &self.device)?
        } else {
            [f64::NAN; 2]
        };
        let value = |t: &Tensor<1>| t.clone().into_scalar::<f32>().into();
        Ok(Evaluation::new(parts.sum())
            .with_value("image", value(&parts.image))
            .with_value("silhouette", value(&parts.silhouette))
            .with_value("normals", value(&parts.normals))
            .with_value("IoU input", validated[0])
            .with_value("IoU other", validated[1])
            .with_value(NETWORK_SECONDS, predicted.as_secs_f64())
            .with_value(RENDER_SECONDS, rendered.as_secs_f64()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::module::{Module, ModuleVisitor, Param};
    use burn::optim::{GradientsParams, ModuleOptimizer, SgdConfig};
    use softray::optim::Fit;

    /// The squared length of each gradient, with the path of its parameter.
    struct Sizes<'a> {
        gradients: &'a GradientsParams,
        path: Vec<String>,
        squares: Vec<(String, f64)>,
    }

    impl ModuleVisitor for Sizes<'_> {
        fn enter_module(&mut self, name: &str, _: &str) {
            self.path.push(name.into());
        }

        fn exit_module(&mut self, _: &str, _: &str) {
            self.path.pop();
        }

        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            let gradient = self.gradients.get::<D>(param.id).expect("a gradient");
            let data = gradient.into_data();
            let square = data.iter::<f64>().map(|v| v * v).sum();
            self.squares.push((self.path.join("."), square));
        }
    }

    /// Every parameter of the network changes the renders. Along the gradient, the loss of the same step changes as
    /// the gradient predicts, except at blurred edges, where the step samples other surfaces.
    #[test]
    fn gradients_reach_the_whole_network_through_the_renderer() {
        // The variance of a noisy gradient adds to its square.
        let settings = Settings {
            samples: 16,
            ..Settings::tiny()
        };
        let device = Device::flex();
        let tracked = device.clone().autodiff();
        let data = Dataset::new(("testing", 1), (6, 2), &device).expect("renders");
        let decoder = Decoder::new(settings.subdivisions[0], settings.degree, &device);
        let decoder = decoder.expect("an icosphere");
        tracked.seed(1);
        let network = Network::new(&settings.channels, 32, settings.degree, &tracked);
        let trainer = Trainer {
            settings: &settings,
            data: &data,
            validation: &data,
            regular: MeshRegularizer::from_mesh(&decoder.ball).expect("faces"),
            decoder: &decoder,
            measured: &decoder,
            device,
        };
        let loss = |network: &Network, step: &Step| {
            let batch = trainer.batch(step);
            let bodies = trainer.predict(network, &batch);
            Ok(trainer.compare(&bodies, &batch, step)?.sum())
        };
        // With the same seed, renders and gradients are identical to the bit.
        let gradients = |network: &Network, step: &Step| -> softray::Result<GradientsParams> {
            let gradients = loss(network, step)?.backward();
            Ok(GradientsParams::from_grads(gradients, network))
        };
        Fit::new(network, SgdConfig::new().init(), 1)
            .with_blur(settings.blur().expect("a schedule"))
            .with_progress(false)
            .run(|network: &Network, step: &_| {
                let found = gradients(network, step)?;
                let mut sizes = Sizes {
                    gradients: &found,
                    path: Vec::new(),
                    squares: Vec::new(),
                };
                network.visit(&mut sizes);
                assert_eq!(sizes.squares.len(), 4 * settings.channels.len() + 10);
                for (path, square) in &sizes.squares {
                    assert!(square.is_finite() && *square > 1e-14, "{path}: {square}");
                }
                let square: f64 = sizes.squares.iter().map(|f| f.1).sum();
                const RATE: f64 = 2e-4;
                let value = |rate: f64| -> softray::Result<f64> {
                    let mut descent: ModuleOptimizer = SgdConfig::new().init();
                    let along = gradients(network, step)?;
                    let moved = descent.step(rate, network.clone(), along);
                    Ok(loss(&moved, step)?.into_scalar::<f32>().into())
                };
                let fall = (value(-RATE)? - value(RATE)?) / (2.0 * RATE);
                let ratio = fall / square;
                println!("along the gradient: {fall:.3} of {square:.3}");
                assert!((0.85..1.15).contains(&ratio), "{fall}, {square}");
                Ok(Evaluation::new(loss(network, step)?))
            })
            .expect("a step");
    }
}
