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

use clap::Parser;
use softray::prelude::Device;

use common::study::{self, Failure};
use dataset::Dataset;
use evaluate::{Baselines, predict, predict_and_measure};
use network::Network;
use settings::Settings;
use train::{Place, Trainer};

/// A network that predicts meshes from single images, trained by renders.
#[derive(Parser)]
struct Arguments {
    #[command(flatten)]
    study: study::Arguments,
    /// Devices that share the objects of each step, as in `--devices flex,vulkan`; with the feature `remote` devices of
    /// servers too, as in `--devices ws://127.0.0.1:3000,ws://127.0.0.1:3001`. Their gradients are summed on the device
    /// of `--device`, where the network and the optimizer stay. Default: the device of `--device`.
    #[arg(long, value_delimiter = ',', value_name = "DEVICE,…")]
    devices: Vec<String>,
}

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

fn run(arguments: &Arguments) -> Result<Outcome, Failure> {
    let study = &arguments.study;
    let mut settings = study.either(Settings::quick(), Settings::full());
    settings.steps = study.steps.unwrap_or(settings.steps);
    let names = arguments.devices.iter().map(|name| Some(name.as_str()));
    let devices = names.map(softray::device::named);
    learn(study, &settings, devices.collect::<softray::Result<_>>()?)
}

/// Trains over some devices, or on that of the arguments if there are none.
pub(crate) fn learn(
    arguments: &study::Arguments,
    settings: &Settings,
    mut devices: Vec<Device>,
) -> Result<Outcome, Failure> {
    let start = Instant::now();
    let device = arguments.device()?;
    if devices.is_empty() {
        devices.push(device.clone());
    }
    if devices.len() > settings.batch {
        let objects = settings.batch;
        return Err(format!("--devices: at most {objects}, the objects of a step").into());
    }
    let seed = |k: u64| 2 * arguments.seed + k;
    let make = |name, k, count| Dataset::new((name, seed(k)), (count, settings.views), &device);
    let data = make("training set", 0, settings.train)?.with_mirrored();
    let validation = make("validation", 1, settings.validation)?;
    println!(
        "rendered {} objects in {:.1} s",
        settings.train + settings.validation,
        start.elapsed().as_secs_f64()
    );
    let fine = Place::new(settings, device.clone())?.measured;
    let baselines = Baselines::new(&data, &validation, &fine, &device)?;

    let places = devices.into_iter().map(|d| Place::new(settings, d));
    let trainer = Trainer {
        settings,
        data: &data,
        validation: &validation,
        places: places.collect::<softray::Result<_>>()?,
    };
    let network = Network::new(settings, arguments.seed, &device);
    let before = predict_and_measure(&validation, &network, &fine, &device)?;
    let trained = trainer.train(network, arguments)?;

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
