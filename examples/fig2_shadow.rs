//! Figure 2 of the paper: the caster is out of view, and its place is found from its shadow alone.

pub(crate) mod common;

use burn::module::{Module, Param};
use burn::optim::AdamConfig;
use clap::Parser;
use softray::optim::{BlurSchedule, Evaluation, Rate, loss, pixel_footprint};
use softray::prelude::*;

use common::study::{Arguments, Failure, Outcome, Study, curves, distance, numbers, picture};

#[derive(Module, Debug)]
struct Caster {
    /// Offset from the target's place, scene units.
    offset: Param<Tensor<1>>,
}

/// Where the fit starts: the two shadows do not touch.
const START: [f32; 3] = [1.2, 0.0, 0.0];

pub(crate) fn run(arguments: &Arguments) -> Result<Outcome, Failure> {
    let device = arguments.device()?;
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/shadow/scene.json");
    let file = SceneFile::load(path, &device)?;
    let size = arguments.either(32, 64);
    let options = RenderOptions::new(size, size).bounces(0);
    let scene = |offset: Tensor<1>| {
        let moved = |o: Object| o.map_mesh(|m| m.translated(offset.clone()));
        file.scene.clone().map_object("occluder", moved)
    };
    let sharp = BlurSchedule::sharp_sigma(&file.scene, &file.camera, size)?;
    let sharp = options.clone().samples(1024).sigma(sharp).seed(1 << 50);
    let target = render(&file.scene, &file.camera, &sharp)?.radiance;

    let study = Study::new(
        "fig2_shadow",
        "A place from its shadow alone",
        arguments,
        arguments.either(240, 400),
    );
    // Four footprints of the coarser image, a fifth of the caster's edge; a quarter of one in the end.
    let footprint = pixel_footprint(&file.scene, &file.camera, 32)?;
    let (wide, narrow) = ((4.0 * footprint).powi(2), (0.25 * footprint).powi(2));
    let start = Tensor::from_floats(START, &device.clone().autodiff());
    let module = Caster {
        offset: Param::from_tensor(start),
    };
    let fitted = study
        .fit(module, AdamConfig::new().with_beta_2(0.99).init())
        .rate(Rate::exponential(0.06, 0.006))
        .sigma(BlurSchedule::decay(wide, narrow, study.steps() / 2)?)
        .run(|caster: &Caster, step: &_| {
            let scene = scene(caster.offset.val());
            let few = options.clone().samples(8);
            let see = |k| render(&scene, &file.camera, &step.options(&few, k));
            let (a, b) = (see(0)?.radiance, see(1)?.radiance);
            let loss = loss::mse_unbiased(a.clone(), b, target.clone());
            let at = numbers(&caster.offset.val());
            Ok(Evaluation::new(loss)
                .value("x", at[0])
                .value("y", at[1])
                .value("z", at[2])
                .value("distance", distance(&at, &[0.0; 3]))
                .image("render", a))
        })?;

    let found = numbers(&fitted.module.offset.val());
    let place = |at: [f32; 3]| {
        picture(
            &scene(Tensor::from_floats(at, &device)),
            &file.camera,
            &sharp,
        )
    };
    let images = [
        ("initial", place(START)?),
        ("target", place([0.0; 3])?),
        ("final", place([0, 1, 2].map(|i: usize| found[i] as f32))?),
    ];
    let plots = vec![
        curves(&fitted.history, "offset", &["x", "y", "z"], false),
        curves(
            &fitted.history,
            "distance to the target",
            &["distance"],
            true,
        ),
    ];
    let outcome = Outcome {
        errors: [START[0].into(), distance(&found, &[0.0; 3])],
        of: "distance to the target, scene units".into(),
        others: Vec::new(),
    };
    study.finish(&fitted, images, plots, outcome)
}

fn main() -> Result<(), Failure> {
    env_logger::init();
    run(&Arguments::parse())?;
    Ok(())
}
