//! burn's `Learner` trains a network by renders of its predictions: the shape of a body from one image.
//!
//! The loop, metrics, checkpoints and the learning rate are burn's. `--resume` continues from the newest checkpoint.

use std::error::Error;
use std::path::{Path, PathBuf};

use burn::data::dataloader::{DataLoaderBuilder, batcher::Batcher};
use burn::data::dataset::{DatasetError, InMemDataset};
use burn::lr_scheduler::cosine::CosineAnnealingLrSchedulerConfig as Cosine;
use burn::lr_scheduler::module_lr_scheduler::ModuleLearningRate;
use burn::module::{Module, Param, ParamId};
use burn::nn::{Linear, LinearConfig};
use burn::optim::{AdamConfig, GradientsParams, ModuleOptimizer};
use burn::tensor::{ExecutionError, Int, activation::tanh};
use burn::train::SupervisedTraining;
use burn::train::metric::{Adaptor, LossInput, LossMetric};
use burn::train::{ExecutionStrategy, Interrupter, ItemLazy, Learner, MultiDeviceOptim};
use burn::train::{InferenceStep, TrainOutput, TrainStep};
use clap::Parser;
use softray::modules::Renderer;
use softray::optim::{BlurSchedule, loss};
use softray::prelude::*;

const SIZE: usize = 12;
const BATCH: usize = 8;
const BATCHES: usize = 8;
/// The seed of renders that are not steps.
const SEED: u64 = 1 << 50;

#[derive(Parser)]
struct Arguments {
    /// Train for fewer epochs.
    #[arg(long)]
    quick: bool,
    /// Resume a stopped training from its newest checkpoint.
    #[arg(long)]
    resume: bool,
    /// Device, as in BURN_DEVICE. Several devices train together, each with its share of the batches; with the feature
    /// `remote` devices of servers too, as in `--device ws://127.0.0.1:3000 --device ws://127.0.0.1:3001`.
    #[arg(long = "device")]
    devices: Vec<String>,
    /// Folder for checkpoints and metrics.
    #[arg(long, default_value = "out/learner")]
    out: PathBuf,
}

#[derive(Module, Debug)]
struct Predictor {
    hidden: Linear,
    offsets: Linear,
    renderer: Renderer,
    /// The number of steps taken, `[1]`, for seeds and blur. As a parameter it is part of checkpoints.
    steps: Param<Tensor<1, Int>>,
    #[module(skip)]
    blur: BlurSchedule,
    /// The number of devices whose gradients burn sums.
    #[module(skip)]
    devices: usize,
    #[module(skip)]
    errors: Errors,
}

impl Predictor {
    fn new(steps: usize, devices: usize, device: &Device) -> softray::Result<Self> {
        let vertices = shapes::icosphere(1, device).vertices.dims()[0];
        Ok(Self {
            hidden: LinearConfig::new(3 * SIZE * SIZE, 64).init(device),
            offsets: LinearConfig::new(64, 3 * vertices).init(device),
            renderer: Renderer::new(options(2))?,
            steps: Param::initialized(ParamId::new(), Tensor::zeros([1], device)),
            blur: BlurSchedule::decay(4.0, 1.0, steps / 2)?,
            devices,
            errors: Errors::default(),
        })
    }

    /// Compares renders of the predictions with the images `[B, H, W, 3]`.
    fn compare(&self, images: Tensor<4>, view: &Renderer, seed: u64) -> softray::Result<Tensor<1>> {
        let inputs = images.clone().flatten::<2>(1, 3) * 2.0;
        let offsets = self.offsets.forward(tanh(self.hidden.forward(inputs)));
        let count = images.dims()[0] as i32;
        let bodies = bodies(offsets.reshape([count, -1, 3]) * 0.3)?;
        let [a, b] = view.forward_pair_batch(&bodies, seed)?;
        loss::mse_unbiased(a.radiance, b.radiance, images)
    }
}

impl TrainStep for Predictor {
    type Input = Tensor<4>;
    type Output = Loss;

    fn step(&self, images: Tensor<4>) -> TrainOutput<Loss> {
        let step = self.steps.val().into_scalar::<i64>() as u64;
        let view = self.renderer.clone().with_blur(self.blur.at(step as usize));
        match view.and_then(|view| self.compare(images, &view, step)) {
            Ok(loss) => {
                // The mean over all devices is a sum of their shares.
                let share = loss.clone() * (self.devices as f64).recip();
                TrainOutput::new(self, share.backward(), Loss(loss))
            }
            Err(error) => {
                let (grads, item) = (GradientsParams::new(), self.errors.stop(error));
                TrainOutput { grads, item }
            }
        }
    }

    fn optimize(
        mut self,
        adam: &mut ModuleOptimizer,
        rate: ModuleLearningRate,
        by: GradientsParams,
    ) -> Self {
        self.steps = self.steps.map(|steps| steps + 1);
        adam.step(rate, self, by)
    }
}

impl InferenceStep for Predictor {
    type Input = Tensor<4>;
    type Output = Loss;

    fn step(&self, images: Tensor<4>) -> Loss {
        let loss = self.compare(images, &self.renderer, SEED);
        loss.map_or_else(|error| self.errors.stop(error), Loss)
    }
}

/// What metrics receive. It could have fields of any rank, and an `Adaptor` for each metric.
struct Loss(Tensor<1>);

impl Adaptor<LossInput> for Loss {
    fn adapt(&self) -> LossInput {
        LossInput::new(self.0.clone())
    }
}

impl ItemLazy for Loss {
    fn sync(self) -> Result<Self, ExecutionError> {
        Ok(Self(self.0.without_autodiff()))
    }
}

/// The way out for errors, because burn's steps return none.
#[derive(Clone, Default)]
struct Errors(Interrupter);

impl Errors {
    /// burn ends the training after this step, without a checkpoint, and returns the error.
    fn stop(&self, error: softray::Error) -> Loss {
        self.0.fail(DatasetError::new(error));
        Loss(Tensor::full([1], f32::NAN, &Device::default()))
    }
}

impl std::fmt::Debug for Errors {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Errors")
    }
}

struct Stack;

impl Batcher<Tensor<3>, Tensor<4>> for Stack {
    fn batch(&self, images: Vec<Tensor<3>>, device: &Device) -> Tensor<4> {
        Tensor::stack::<4>(images, 0).to_device(&device.clone().inner())
    }
}

/// Bodies by offsets `[B, V, 3]` from a ball.
fn bodies(offsets: Tensor<3>) -> softray::Result<Batch> {
    let ball = shapes::icosphere(1, &offsets.device());
    let object = Object::new(ball.clone()).with_material(Material::diffuse([0.8, 0.4, 0.2]));
    let scene = Scene::new()
        .with_object(object.with_name("body"))
        .with_light(Light::directional([-1.0, -1.0, -1.0], [3.0, 3.0, 3.0]));
    let camera = Camera::look_at([0.0, 0.5, 4.0], [0.0, 0.0, 0.0]).with_fov_y(40.0);
    let vertices = ball.vertices.unsqueeze::<3>() + offsets;
    Batch::product(vec![scene; vertices.dims()[0]], &[camera])?.with_vertices("body", vertices)
}

/// Images of bodies with random stretches, each `[H, W, 3]`.
fn images(count: usize, device: &Device) -> softray::Result<Vec<Tensor<3>>> {
    let uniform = burn::tensor::Distribution::Uniform(-0.4, 0.4);
    let ball = shapes::icosphere(1, device).vertices.unsqueeze::<3>();
    let bodies = bodies(ball * Tensor::random([count, 1, 3], uniform, device))?;
    let images = render_batch(&bodies, &options(64).with_seed(SEED))?.radiance;
    let images = images.iter_dim(0).map(|image| image.squeeze_dim(0));
    Ok(images.collect())
}

fn options(samples: u32) -> RenderOptions {
    let options = RenderOptions::new(SIZE, SIZE).with_bounces(0);
    options.with_samples(samples)
}

/// Returns the newest epoch that has all files.
fn newest(folder: &Path, epochs: usize) -> Option<usize> {
    let file = |name: &str, epoch| folder.join(format!("checkpoint/{name}-{epoch}.bpk"));
    let has = |name, epoch| file(name, epoch).exists();
    let whole = |&e: &usize| has("model", e) && has("optim", e) && has("scheduler", e);
    (1..=epochs).rev().find(whole)
}

/// Trains on images, and returns the network.
fn train(
    network: Predictor,
    images: [Vec<Tensor<3>>; 2],
    epochs: usize,
    devices: &[Device],
    arguments: &Arguments,
) -> Result<Predictor, Box<dyn Error>> {
    let [seen, unseen] = images.map(|images| {
        let loader = DataLoaderBuilder::new(Stack).batch_size(BATCH);
        loader.build(InMemDataset::new(images))
    });
    let rate = Cosine::new(1e-2, epochs * BATCHES / devices.len()).init()?;
    let on = devices.iter().map(|device| device.clone().autodiff());
    let strategy = ExecutionStrategy::multi(on.collect(), MultiDeviceOptim::OptimMainDevice);
    let mut training = SupervisedTraining::new(&arguments.out, seen, unseen)
        .metrics((LossMetric::new(),))
        .with_default_checkpointers()
        .with_application_logger(None)
        .with_training_strategy(strategy.into())
        .with_interrupter(network.errors.0.clone())
        .num_epochs(epochs);
    if let Some(epoch) = newest(&arguments.out, epochs).filter(|_| arguments.resume) {
        training = training.checkpoint(epoch);
    }
    let result = training.launch(Learner::new(network, AdamConfig::new().init(), rate));
    match result.error {
        Some(error) => Err(error.to_string().into()),
        None => Ok(result.model),
    }
}

/// Returns the mean squared difference of unseen images before and after the training.
fn run(arguments: &Arguments) -> Result<[f32; 2], Box<dyn Error>> {
    let names = arguments.devices.iter().map(|name| Some(name.as_str()));
    let names = names.chain(arguments.devices.is_empty().then_some(None));
    let devices = names.map(softray::device::named);
    let devices = devices.collect::<softray::Result<Vec<Device>>>()?;
    let device = devices[0].clone();
    device.seed(1);
    let epochs = if arguments.quick { 10 } else { 60 };
    let steps = epochs * BATCHES / devices.len();
    let network = Predictor::new(steps, devices.len(), &device.clone().autodiff())?;
    let (seen, unseen) = (images(BATCHES * BATCH, &device)?, images(BATCH, &device)?);
    let all = Tensor::stack::<4>(unseen.clone(), 0);
    let measure = |network: &Predictor| -> softray::Result<f32> {
        let loss = network.compare(all.clone(), &network.renderer, SEED)?;
        Ok(loss.into_scalar())
    };
    let before = measure(&network.valid())?;
    let after = measure(&train(
        network,
        [seen, unseen],
        epochs,
        &devices,
        arguments,
    )?)?;
    println!("difference of unseen images: {before:.5} before, {after:.5} after {epochs} epochs");
    Ok([before, after])
}

fn main() -> Result<(), Box<dyn Error>> {
    run(&Arguments::parse()).map(|_| ())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arguments(name: &str) -> Arguments {
        let name = format!("softray-{name}-{}", std::process::id());
        Arguments {
            quick: true,
            resume: false,
            devices: Vec::new(),
            out: std::env::temp_dir().join(name),
        }
    }

    #[test]
    fn an_error_of_a_render_ends_the_training() {
        let arguments = arguments("errors");
        let device = Device::flex();
        let network = Predictor::new(BATCHES, 1, &device.clone().autodiff()).expect("a network");
        let broken = Tensor::full([SIZE, SIZE, 3], f32::NAN, &device);
        let images = [vec![broken], Vec::new()];
        let error = train(network, images, 1, &[device], &arguments).expect_err("NaN");
        assert!(error.to_string().contains("body"), "{error}");
        assert_eq!(newest(&arguments.out, 1), None);
        std::fs::remove_dir_all(arguments.out).expect("a folder");
    }
}
