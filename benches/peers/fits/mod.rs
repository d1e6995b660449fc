//! Whole fits with a clock: rates and blur follow the time that has passed, so that every renderer gets the same.

mod mesh;
mod pose;
mod surface;

use std::time::Instant;

use burn::module::Module;
use burn::optim::{AdamConfig, GradientsParams, ModuleOptimizer};
use serde::Deserialize;
use serde_json::{Value, json};
use softray::prelude::*;

use crate::Answer;
use crate::scenes::View;

#[derive(Deserialize)]
pub struct Request {
    #[serde(flatten)]
    view: View,
    #[serde(flatten)]
    clock: Clock,
    /// Samples a pixel of a step's renders, of which there are two.
    samples: u32,
    problem: Problem,
}

/// The time of a fit.
#[derive(Deserialize)]
struct Clock {
    seconds: f64,
    /// The learning rate at the start and at the end, exponential between.
    rate: [f64; 2],
    /// How many times the error is looked at, with the clock stopped.
    looks: usize,
}

#[derive(Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
enum Problem {
    /// An object's place.
    Pose(pose::Pose),
    /// A mesh from views.
    Mesh(mesh::Views),
    /// A texture, a roughness and a light.
    Surface(surface::Surface),
}

impl Request {
    pub fn answer(&self) -> Answer {
        match &self.problem {
            Problem::Pose(p) => p.answer(self),
            Problem::Mesh(p) => p.answer(self),
            Problem::Surface(p) => p.answer(self),
        }
    }

    /// The file, and options with few samples.
    fn load(&self) -> softray::Result<(SceneFile, RenderOptions)> {
        let options = self.view.options().with_samples(self.samples);
        Ok((self.view.load()?, options))
    }
}

/// Many samples, and random numbers that no step has.
fn sharp(options: &RenderOptions) -> RenderOptions {
    options.clone().with_samples(1024).with_seed(1 << 50)
}

fn adam() -> ModuleOptimizer {
    AdamConfig::new().with_beta_2(0.99).init()
}

impl Clock {
    /// Fits a module; `loss` takes the share of the time that has passed and two seeds of the step. What is looked at
    /// is returned with its seconds, and the number of steps.
    fn run<M: Module>(
        &self,
        mut module: M,
        mut optimizer: ModuleOptimizer,
        seed: u64,
        loss: impl Fn(&M, f64, [u64; 2]) -> softray::Result<Tensor<1>>,
        look: impl Fn(&M) -> softray::Result<Value>,
    ) -> Answer {
        let seeds = |step: u64| [0, 1].map(|k| (seed << 32) + 2 * step + k);
        let _ = loss(&module, 0.0, seeds(u64::from(u32::MAX >> 2)))?.backward();
        let mut trace = vec![json!([0.0, look(&module)?])];
        let (mut passed, mut step) = (0.0, 0);
        while passed < self.seconds {
            let start = Instant::now();
            let share = passed / self.seconds;
            let rate = self.rate[0] * (self.rate[1] / self.rate[0]).powf(share);
            let gradients = loss(&module, share, seeds(step))?.backward();
            let gradients = GradientsParams::from_grads(gradients, &module);
            module = optimizer.step(rate, module, gradients);
            passed += start.elapsed().as_secs_f64();
            step += 1;
            if passed * self.looks as f64 >= trace.len() as f64 * self.seconds {
                trace.push(json!([passed, look(&module)?]));
            }
        }
        Ok(json!({ "steps": step, "trace": trace }))
    }
}

/// The share of an exponential fall that ends after two thirds of the time.
fn falling([start, end]: [f64; 2], share: f64) -> f64 {
    start * (end / start).powf((1.5 * share).min(1.0))
}
