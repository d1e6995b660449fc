//! A network that predicts the shape and the albedo of an object from one image. The shape can have any topology: the network
//! predicts signed distances, and the surface is where they are zero. Renders are the only training signal: the prediction is
//! rendered from the input camera and from one other camera, and compared with the images there; soft silhouettes of the
//! distances are compared from nine cameras. Renders use the true camera and light; the input of the network is the image
//! alone.

#[path = "../common/mod.rs"]
pub(crate) mod common;
pub(crate) mod dataset;
pub(crate) mod evaluate;
pub(crate) mod harmonics;
pub(crate) mod network;
pub(crate) mod numbers;
pub(crate) mod optimizer;
pub(crate) mod picture;
pub(crate) mod render;
pub(crate) mod settings;
pub(crate) mod shape;
pub(crate) mod template;
pub(crate) mod train;

use std::time::Instant;

use clap::Parser;
use softray::prelude::Device;

use common::study::{self, Failure};
use dataset::Dataset;
use evaluate::{Scores, measure, predict, visible_side};
use network::Network;
use settings::Settings;
use train::{Place, Trainer};

/// A network that predicts meshes from single images, trained by renders.
#[derive(Parser)]
struct Arguments {
    #[command(flatten)]
    study: study::Arguments,
    /// Predict deformed balls in place of surfaces of any topology, to compare with.
    #[arg(long)]
    template: bool,
    /// Compare depth as well, as if the images came from a depth camera.
    #[arg(long)]
    depth: bool,
    /// Train with this many objects (default 2,048; 200 with --quick).
    #[arg(long)]
    objects: Option<usize>,
    /// Devices that share the objects of each step, as in `--devices flex,vulkan`; with the feature `remote` devices of
    /// servers too, as in `--devices ws://127.0.0.1:3000,ws://127.0.0.1:3001`. Their gradients are summed on the device
    /// of `--device`, where the network and the optimizer stay. Default: the device of `--device`.
    #[arg(long, value_delimiter = ',', value_name = "DEVICE,…")]
    devices: Vec<String>,
}

/// Scores of objects that the training has not seen, before and after it, and of as many that it has seen.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Outcome {
    pub before: Scores,
    pub after: Scores,
    pub learned: Scores,
    /// See [`visible_side`], of the validation.
    pub visible_side: f64,
}

impl Outcome {
    fn print(&self) {
        let rows = [
            ("before training", &self.before),
            ("validation", &self.after),
            ("training set", &self.learned),
        ];
        for (what, scores) in rows {
            let Scores {
                silhouettes,
                of_another,
                volume,
                genus,
                parts,
                flaws,
            } = scores;
            println!(
                "{what}: IoU of silhouettes {:.3} input, {:.3} others ({:.3}, {:.3} for another object); of volumes {volume:.3}",
                silhouettes[0], silhouettes[1], of_another[0], of_another[1]
            );
            println!(
                "    genus right for {} of {} with a hole, {} of {} without; {parts:.2} parts; {} folds, {} crossings, {} not closed",
                genus[0][0], genus[0][1], genus[1][0], genus[1][1], flaws[0], flaws[1], flaws[2]
            );
        }
        println!(
            "IoU of volumes of bodies whose visible side is exact: {:.3}",
            self.visible_side
        );
    }
}

fn run(arguments: &Arguments) -> Result<Outcome, Failure> {
    let study = &arguments.study;
    let mut settings = study.either(Settings::quick(), Settings::full());
    settings.steps = study.steps.unwrap_or(settings.steps);
    settings.train = arguments.objects.unwrap_or(settings.train);
    settings.depth = arguments.depth;
    settings.template = arguments.template;
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
    let make = |name, k, count| Dataset::new((name, seed(k)), count, settings, &device);
    let data = make("training set", 0, settings.train)?.with_mirrored();
    let validation = make("validation", 1, settings.validation)?;
    println!(
        "rendered {} objects in {:.1} s",
        settings.train + settings.validation,
        start.elapsed().as_secs_f64()
    );
    let decoder = Place::new(settings, device.clone())?.decoder;
    let scores = |data: &Dataset, network: &Network| {
        measure(data, &predict(data, network, &decoder, &device)?, &device)
    };
    let places = devices.into_iter().map(|d| Place::new(settings, d));
    let trainer = Trainer {
        settings,
        data: &data,
        validation: &validation,
        places: places.collect::<softray::Result<_>>()?,
    };
    let network = Network::new(settings, arguments.seed, &device);
    let before = scores(&validation, &network)?;
    let trained = trainer.train(network, arguments)?;

    let network = &trained.module;
    let seen = settings.validation.min(settings.train);
    let learned = scores(&data.truncated(seen), network)?;
    let bodies = predict(&validation, network, &decoder, &device)?;
    let after = measure(&validation, &bodies, &device)?;
    let path = arguments.out.join(format!("{}.png", settings.name()));
    picture::write(&path, &validation, &bodies, &trained.history, &device)?;

    let mean = |name: &str| {
        let times = trained.history.curve(name);
        times.iter().map(|t| t.1).sum::<f64>() / times.len().max(1) as f64
    };
    let rows = &trained.history.rows;
    println!(
        "a step {:.3} s, of which forward {:.3} s network, {:.3} s renders, {:.3} s soft silhouettes",
        rows.last().map_or(0.0, |row| row.seconds) / rows.len().max(1) as f64,
        mean(train::NETWORK_SECONDS),
        mean(train::RENDER_SECONDS),
        mean(train::SOFT_SECONDS),
    );
    println!(
        "{} steps, {:.1} s in all\nwrote {}",
        trained.history.rows.len(),
        start.elapsed().as_secs_f64(),
        path.display()
    );
    Ok(Outcome {
        before,
        after,
        learned,
        visible_side: visible_side(&validation)?,
    })
}

fn main() -> Result<(), Failure> {
    common::log();
    run(&Arguments::parse())?.print();
    Ok(())
}
