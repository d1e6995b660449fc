//! A network that predicts shape, pose and albedo of an object from one image. The shape is a ball whose vertices it
//! moves. Renders are the only training signal: the prediction is rendered from the input camera and from one other
//! camera, and compared with the images there. Renders use the true camera and light; the input of the network is the
//! image alone.

pub(crate) mod basis;
#[path = "../common/mod.rs"]
pub(crate) mod common;
pub(crate) mod dataset;
pub(crate) mod evaluate;
pub(crate) mod grid;
pub(crate) mod network;
pub(crate) mod numbers;
pub(crate) mod render;
pub(crate) mod settings;
pub(crate) mod shape;
pub(crate) mod train;

use std::time::Instant;

use burn::optim::AdamConfig;
use clap::Parser;
use softray::optim::{Fit, MeshRegularizer, Rate};

use common::study::{Arguments, Failure};
use dataset::Dataset;
use evaluate::{Baselines, predict, predict_and_measure};
use network::{Decoder, Network};
use settings::Settings;
use train::Trainer;

/// Overlaps of the validation set's silhouettes, in the input views and in the other views.
#[derive(Clone, Copy, Debug)]
#[allow(dead_code)] // only tests read the fields
pub(crate) struct Outcome {
    pub baselines: Baselines,
    pub before: [f64; 2],
    pub after: [f64; 2],
    /// After training, for the same number of objects of the training set.
    pub learned: [f64; 2],
}

impl Outcome {
    fn print(&self) {
        let line = |what: &str, [input, other]: [f64; 2]| {
            println!("validation IoU {what}: {input:.4} input view, {other:.4} other views");
        };
        let [input, other] = self.learned;
        println!("training IoU of the network: {input:.4} input view, {other:.4} other views");
        line("of the network", self.after);
        line("of the network before training", self.before);
        line("of the mean shape", self.baselines.mean);
        line(
            &format!(
                "of the mean shape, scaled by {:.2} to fit best",
                self.baselines.scale
            ),
            self.baselines.scaled,
        );
        line(
            "of the mean shape, told each object's place",
            self.baselines.placed,
        );
        let margin = [0, 1].map(|k| self.after[k] - self.baselines.mean[k]);
        line("above the mean shape", margin);
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<Outcome, Failure> {
    let mut settings = arguments.either(Settings::quick(), Settings::full());
    settings.steps = arguments.steps.unwrap_or(settings.steps);
    learn(arguments, &settings)
}

pub(crate) fn learn(arguments: &Arguments, settings: &Settings) -> Result<Outcome, Failure> {
    let start = Instant::now();
    let device = arguments.device()?;
    let tracked = device.clone().autodiff();
    let seed = |k: u64| 2 * arguments.seed + k;
    let make = |name, k, count| Dataset::new((name, seed(k)), (count, settings.views), &device);
    let data = make("training set", 0, settings.train)?.with_mirrored();
    let validation = make("validation", 1, settings.validation)?;
    println!(
        "rendered {} objects in {:.1} s",
        settings.train + settings.validation,
        start.elapsed().as_secs_f64()
    );
    let ball = |subdivisions| Decoder::new(subdivisions, settings.degree, &device);
    let (coarse, fine) = (
        ball(settings.subdivisions[0])?,
        ball(settings.subdivisions[1])?,
    );
    let baselines = Baselines::new(&data, &validation, &fine, &device)?;

    tracked.seed(arguments.seed);
    let channels = &settings.channels;
    let network = Network::new(channels, settings.hidden, settings.degree, &tracked);
    let trainer = Trainer {
        settings,
        data: &data,
        validation: &validation,
        decoder: &coarse,
        measured: &fine,
        regular: MeshRegularizer::from_mesh(&coarse.ball)?,
        device: device.clone(),
    };
    let before = predict_and_measure(&validation, &network, &fine, &device)?;
    let trained = Fit::new(network, AdamConfig::new().init(), settings.steps)
        .with_seed(arguments.seed)
        .with_rate(Rate::cosine(settings.rate))
        .with_blur(settings.blur()?)
        .with_clip(1.0)
        .with_folder(arguments.out.join("mesh_predictor"))
        .with_checkpoint_every(25)
        .with_restart(!arguments.resume)
        .run(|network: &Network, step: &_| trainer.evaluate(network, step))?;

    let network = &trained.module;
    let after = predict_and_measure(&validation, network, &fine, &device)?;
    let learned = make("part of the training set", 0, settings.validation)?;
    let learned = predict_and_measure(&learned, network, &fine, &device)?;
    let bodies = predict(&validation, network, &fine, &device);
    let path = arguments.out.join("mesh_predictor.png");
    let shown = (&fine, &bodies);
    grid::write(
        &path,
        &validation,
        shown,
        (&trained.history, &baselines),
        &device,
    )?;

    let mean = |name: &str| {
        let times = trained.history.curve(name);
        times.iter().map(|t| t.1).sum::<f64>() / times.len().max(1) as f64
    };
    let rows = &trained.history.rows;
    println!(
        "a step {:.3} s, of which forward {:.3} s network, {:.3} s renders",
        rows.last().map_or(0.0, |row| row.seconds) / rows.len().max(1) as f64,
        mean(train::NETWORK_SECONDS),
        mean(train::RENDER_SECONDS),
    );
    println!(
        "{} steps, {:.1} s in all\nwrote {}",
        trained.history.rows.len(),
        start.elapsed().as_secs_f64(),
        path.display()
    );
    Ok(Outcome {
        baselines,
        before,
        after,
        learned,
    })
}

fn main() -> Result<(), Failure> {
    common::log();
    run(&Arguments::parse())?.print();
    Ok(())
}
