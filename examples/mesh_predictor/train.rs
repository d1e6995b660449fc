//! The loss of a step: the difference between renders of the predictions and the images.

use std::time::{Duration, Instant};

use softray::optim::{Evaluation, Fit, Fitted, Part, Rate, Step, loss};
use softray::prelude::*;

use super::common::study::Arguments;
use super::dataset::Dataset;
use super::evaluate::predict_and_overlap;
use super::network::{Bodies, Decoder, Network};
use super::numbers::Numbers;
use super::optimizer::optimizer;
use super::render::see;
use super::settings::Settings;

/// Weights of the parts of the loss. The weight of silhouettes is 1.
const IMAGE: f64 = 20.0;
const DEPTH: f64 = 20.0;
/// The weight of soft silhouettes, which open holes, at the start. It falls linearly over the steps, to the share `LEAST_SOFT`.
const SOFT: f64 = 2.0;
const LEAST_SOFT: f64 = 0.25;
/// Weights of penalties: of grids whose values are not distances, of grids that bend, and of templates that bend.
const EIKONAL: f64 = 0.05;
const BENDING: f64 = 0.05;
const NORMALS: f64 = 0.1;
/// The softness of soft silhouettes, over the step of the grid.
const SOFTNESS: f64 = 1.0;
/// The share of the steps in which the learning rate rises.
const WARM_UP: f64 = 0.02;

/// Names of the forward pass's times in the history, in seconds; means over the devices.
pub const NETWORK_SECONDS: &str = "network s";
pub const RENDER_SECONDS: &str = "render s";
pub const SOFT_SECONDS: &str = "soft s";

/// The inputs of training besides the network.
pub struct Trainer<'a> {
    pub settings: &'a Settings,
    pub data: &'a Dataset,
    pub validation: &'a Dataset,
    /// The devices that share the objects of each step. The first one measures on the validation set.
    pub places: Vec<Place>,
}

/// A device that evaluates steps, and its constants.
pub struct Place {
    /// Without autodiff.
    pub device: Device,
    pub decoder: Decoder,
}

impl Place {
    pub fn new(settings: &Settings, device: Device) -> softray::Result<Self> {
        let decoder = Decoder::new(settings, &device)?;
        Ok(Self { device, decoder })
    }
}

/// Objects of a step: items, each with the eye that is compared besides that of the network's input.
pub struct Objects {
    all: Vec<(usize, usize)>,
    /// The number of the step's objects before these.
    before: usize,
}

impl Objects {
    /// The share of a device.
    fn of_part(&self, part: &Part) -> Self {
        let numbers: Vec<usize> = (0..self.all.len()).collect();
        let own = part.of(&numbers).as_slice();
        Self {
            all: own.iter().map(|&k| self.all[k]).collect(),
            before: own[0],
        }
    }

    /// (item, eye) of the network's inputs.
    fn inputs(&self) -> Vec<(usize, usize)> {
        self.all.iter().map(|&(item, _)| (item, 0)).collect()
    }

    /// (item, eye) of all views that are compared, two of each object.
    fn compared(&self) -> Vec<(usize, usize)> {
        let pair = |&(item, other): &(usize, usize)| [(item, 0), (item, other)];
        self.all.iter().flat_map(pair).collect()
    }
}

/// The parts of the loss.
pub struct Parts {
    /// Of radiance and depth, with their weights.
    pub image: Tensor<1>,
    pub silhouette: Tensor<1>,
    /// Of soft silhouettes, with their weight.
    pub soft: Tensor<1>,
    /// Penalties of the shape, with their weights.
    pub shape: Tensor<1>,
    /// The time that `soft` and `shape` took.
    soft_time: Duration,
}

impl Parts {
    pub fn sum(&self) -> Tensor<1> {
        self.image.clone() + self.silhouette.clone() + self.soft.clone() + self.shape.clone()
    }
}

impl Trainer<'_> {
    /// Trains a network, which stays on its device.
    pub fn train(
        &self,
        network: Network,
        arguments: &Arguments,
    ) -> softray::Result<Fitted<Network>> {
        let settings = self.settings;
        let devices: Vec<Device> = self.places.iter().map(|p| p.device.clone()).collect();
        let warm_up = (WARM_UP * settings.steps as f64).ceil() as usize;
        Fit::new(network, optimizer(), settings.steps)
            .with_seed(arguments.seed)
            .with_rate(Rate::cosine(settings.rate).with_warm_up(warm_up))
            .with_blur(settings.blur()?)
            .with_clip(1.0)
            .with_folder(arguments.out.join(settings.name()))
            .with_checkpoint_every(50)
            .with_restart(!arguments.resume)
            .run_over(&devices, |network: &Network, step, part| {
                self.evaluate(network, step, part)
            })
    }

    /// Chooses objects and views by the seed of the step.
    pub fn batch(&self, step: &Step) -> Objects {
        let n = &mut Numbers::new(step.seed(0), 1);
        let count = self.settings.batch;
        let items: Vec<_> = (0..count).map(|_| n.index(self.data.items.len())).collect();
        let mut other = || 1 + n.index(self.settings.views - 1);
        Objects {
            all: items.into_iter().map(|item| (item, other())).collect(),
            before: 0,
        }
    }

    /// Returns the network's predictions for a batch.
    pub fn predict(
        &self,
        network: &Network,
        batch: &Objects,
        place: &Place,
    ) -> softray::Result<Bodies> {
        let device = place.device.clone().autodiff();
        let images = self.data.images(&batch.inputs(), &device).radiance;
        network.forward(images, &place.decoder)
    }

    /// Returns the loss of bodies. Each view is rendered twice with independent noise, so that the variance of the
    /// noise does not bias the loss. The noise of an object does not depend on the device that renders it.
    pub fn compare(
        &self,
        bodies: &Bodies,
        batch: &Objects,
        step: &Step,
        place: &Place,
    ) -> softray::Result<Parts> {
        let light = |item: usize| &self.data.items[item].light;
        let scenes = batch.all.iter().enumerate();
        let scenes = scenes.map(|(k, &(item, _))| bodies.scene(k, light(item)));
        let compared = batch.compared();
        let eye = |&(item, eye): &(usize, usize)| self.data.items[item].eyes[eye].camera();
        let cameras = compared.iter().map(eye).enumerate();
        let views = cameras.flat_map(|(k, camera)| [(k / 2, camera.clone()), (k / 2, camera)]);
        let rendered = Batch::views(scenes.collect(), views.collect())?;
        let size = self.settings.render_size(step.index);
        let few = self.settings.options(size, self.settings.samples);
        // Two renders of two views of each object.
        let few = step.options(&few, 0).of_view(4 * batch.before);
        let seen = see(&rendered, &few)?;
        let target = self.data.images(&compared, &place.device).shrunk(size)?;
        let differ = |found: Tensor<4>, target: Tensor<4>| {
            let [_, h, w, c] = target.dims();
            let pairs = found.reshape([-1, 2, h as i32, w as i32, c as i32]);
            let [a, b] = [0, 1].map(|k| pairs.clone().narrow(1, k, 1).squeeze_dim::<4>(1));
            loss::mse_unbiased(a, b, target)
        };
        let mut image = differ(seen.radiance, target.radiance)? * IMAGE;
        if let (Some(found), Some(target)) = (seen.depth, target.depth) {
            image = image + differ(found.unsqueeze_dim(3), target.unsqueeze_dim(3))? * DEPTH;
        }
        let pairs = seen.opacity.reshape([-1, 2, size as i32, size as i32]);
        let opacity = pairs.mean_dim(1).squeeze_dim::<3>(1);
        let start = Instant::now();
        let [soft, shape] = self.shape_terms(bodies, batch, step, place)?;
        let soft_time = start.elapsed();
        Ok(Parts {
            image,
            silhouette: loss::silhouette_iou(opacity, target.opacity)?,
            soft,
            shape,
            soft_time,
        })
    }

    /// Returns the loss of soft silhouettes from all eyes, and penalties of the shapes.
    fn shape_terms(
        &self,
        bodies: &Bodies,
        batch: &Objects,
        step: &Step,
        place: &Place,
    ) -> softray::Result<[Tensor<1>; 2]> {
        match (&place.decoder, &bodies.distances) {
            (Decoder::Grid { grid, .. }, Some(distances)) => {
                let (cell, size) = (grid.step(), [self.settings.nodes; 2]);
                let (mut which, mut views) = (Vec::new(), Vec::new());
                for (k, &(item, _)) in batch.all.iter().enumerate() {
                    for (i, eye) in self.data.items[item].eyes.iter().enumerate() {
                        which.push((item, i));
                        views.push((k, eye.camera()));
                    }
                }
                let seen = grid.opacity(distances.clone(), &views, size, SOFTNESS * cell)?;
                let soft = cross_entropy(seen, self.data.silhouettes(&which, &place.device));
                let weight = SOFT * (1.0 - self.settings.done(step.index)).max(LEAST_SOFT);
                let eikonal = loss::eikonal(distances.clone(), cell)? * EIKONAL;
                let bending = loss::bending(distances.clone(), cell)? * BENDING;
                Ok([soft * weight, eikonal + bending])
            }
            (Decoder::Template(template), _) => {
                let vertices = bodies.meshes.iter().map(|mesh| mesh.vertices.clone());
                let vertices = Tensor::stack(vertices.collect(), 0);
                let none = Tensor::zeros([1], &bodies.color.device());
                Ok([
                    none,
                    template.regular.normal_consistency(vertices) * NORMALS,
                ])
            }
            _ => unreachable!("grids have distances"),
        }
    }

    /// Returns a device's part of the loss of a step and, in some steps, the overlap on the validation set.
    pub fn evaluate(
        &self,
        network: &Network,
        step: &Step,
        part: &Part,
    ) -> softray::Result<Evaluation> {
        let place = &self.places[part.index];
        let all = self.batch(step);
        let batch = all.of_part(part);
        let start = Instant::now();
        let bodies = self.predict(network, &batch, place)?;
        let predicted = start.elapsed();
        let parts = self.compare(&bodies, &batch, step, place)?;
        let rendered = start.elapsed() - predicted - parts.soft_time;
        let every = self.settings.steps.div_ceil(self.settings.evaluations);
        let validated = match part.index {
            0 if step.index.is_multiple_of(every.max(1)) => {
                predict_and_overlap(self.validation, network, &place.decoder, &place.device)?
            }
            0 => [f64::NAN; 2],
            _ => [0.0; 2],
        };
        // Losses and values are summed over the devices: of means, each device adds its share.
        let share = batch.all.len() as f64 / all.all.len() as f64;
        let value = |t: &Tensor<1>| share * f64::from(t.clone().into_scalar::<f32>());
        let seconds = |time: Duration| time.as_secs_f64() / part.count as f64;
        Ok(Evaluation::new(parts.sum() * share)
            .with_value("image", value(&parts.image))
            .with_value("silhouette", value(&parts.silhouette))
            .with_value("soft", value(&parts.soft))
            .with_value("shape", value(&parts.shape))
            .with_value("IoU input", validated[0])
            .with_value("IoU other", validated[1])
            .with_value(NETWORK_SECONDS, seconds(predicted))
            .with_value(RENDER_SECONDS, seconds(rendered))
            .with_value(SOFT_SECONDS, seconds(parts.soft_time)))
    }
}

/// The mean binary cross-entropy. Unlike that of squares, its gradient is large where an opacity is entirely wrong, unless
/// the ray misses the grid.
fn cross_entropy(opacity: Tensor<3>, target: Tensor<3>) -> Tensor<1> {
    let logarithm = |share: Tensor<3>| share.clamp_min(1e-6).log();
    let [opaque, clear] = [opacity.clone(), opacity.neg() + 1.0].map(logarithm);
    ((opaque - clear.clone()) * target + clear).mean().neg()
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::module::{Module, ModuleVisitor, Param};
    use burn::optim::{GradientsParams, ModuleOptimizer, SgdConfig};

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

    /// Every parameter of the network changes the renders. Along the gradient, the loss of the same step changes as the
    /// gradient predicts. With few samples, a difference of two renders would be noise: each sample hits a body or not.
    #[test]
    fn gradients_reach_the_whole_network_through_the_renderer() {
        for template in [false, true] {
            check_gradients(&Settings {
                samples: 256,
                depth: !template,
                template,
                ..Settings::tiny()
            });
        }
    }

    fn check_gradients(settings: &Settings) {
        const RATE: f64 = 1e-3;
        let device = Device::flex();
        let data = Dataset::new(("testing", 1), 6, settings, &device).expect("renders");
        let network = Network::new(settings, 1, &device);
        let trainer = Trainer {
            settings,
            data: &data,
            validation: &data,
            places: vec![Place::new(settings, device).expect("a decoder")],
        };
        let place = &trainer.places[0];
        let loss = |network: &Network, step: &Step| {
            let batch = trainer.batch(step);
            let bodies = trainer.predict(network, &batch, place)?;
            Ok(trainer.compare(&bodies, &batch, step, place)?.sum())
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
                // Weights and biases of six layers, and of five in each level of the encoder and of a U-Net.
                let levels = settings.channels.len() - 1;
                let each = if settings.template { 10 } else { 20 };
                assert_eq!(sizes.squares.len(), 12 + each * levels);
                for (path, square) in &sizes.squares {
                    assert!(square.is_finite() && *square > 1e-14, "{path}: {square}");
                }
                let square: f64 = sizes.squares.iter().map(|f| f.1).sum();
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
