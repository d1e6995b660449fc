//! An object that is seen only by its reflection in a glossy wall.

pub(crate) mod common;

use burn::module::{Module, Param};
use burn::optim::AdamConfig;
use clap::Parser;
use softray::optim::{BlurSchedule, Evaluation, Rate, loss};
use softray::prelude::*;

use common::study::{Arguments, Failure, Outcome, Study, curves, distance, numbers, picture};

#[derive(Module, Debug)]
struct Hidden {
    /// Offset along the mirror from the target's place `[2]`, scene units.
    offset: Param<Tensor<1>>,
}

const START: [f64; 2] = [0.7, 0.35];

/// A glossy wall in front of the camera, and a bright icosahedron behind it that the camera does not see.
fn scene(offset: Tensor<1>, device: &Device) -> Scene {
    let mirror = shapes::quad(
        [-2.5, -1.8, 0.0],
        [2.5, -1.8, 0.0],
        [2.5, 1.8, 0.0],
        [-2.5, 1.8, 0.0],
        device,
    );
    let place = Tensor::cat(vec![offset, Tensor::from_floats([0.0], device)], 0)
        + Tensor::from_floats([-0.2, 0.5, 4.6], device);
    let body = shapes::icosahedron(device)
        .scaled(Tensor::from_floats([0.8], device))
        .translated(place);
    Scene::new()
        .with(
            Object::new(mirror)
                .named("mirror")
                .material(Material::diffuse([0.02, 0.02, 0.02]).specular([0.9, 0.9, 0.9], 1500.0)),
        )
        .with(
            Object::new(body)
                .named("hidden")
                .material(Material::diffuse([0.1, 0.1, 0.1]).emission([1.2, 0.9, 0.5])),
        )
        .environment([0.05, 0.06, 0.08])
}

pub(crate) fn run(arguments: &Arguments) -> Result<Outcome, Failure> {
    let device = arguments.device()?;
    let camera = Camera::look_at([0.0, 0.0, 2.6], [0.0, 0.0, 0.0]).fov_y(55.0);
    let size = arguments.either(32, 64);
    let options = RenderOptions::new(size, size).bounces(1);
    let fixed = |at: &[f64]| scene(Tensor::from_floats([at[0], at[1]], &device), &device);
    let still = fixed(&[0.0; 2]);
    let sharp = BlurSchedule::sharp_sigma(&still, &camera, size)?;
    let sharp = options.clone().samples(1024).sigma(sharp).seed(1 << 50);
    let target = render(&still, &camera, &sharp)?.radiance;

    let study = Study::new(
        "mirror",
        "A place from a reflection",
        arguments,
        arguments.either(120, 240),
    );
    let start = Tensor::from_floats(START, &device.clone().autodiff());
    let module = Hidden {
        offset: Param::from_tensor(start),
    };
    let fitted = study
        .fit(module, AdamConfig::new().with_beta_2(0.99).init())
        .rate(Rate::cosine(0.03))
        .sigma(BlurSchedule::auto(&still, &camera, size, study.steps())?)
        .run(|hidden: &Hidden, step: &_| {
            let scene = scene(hidden.offset.val(), &device);
            let few = options.clone().samples(4);
            let see = |k| render(&scene, &camera, &step.options(&few, k));
            let (a, b) = (see(0)?.radiance, see(1)?.radiance);
            let loss = loss::mse_unbiased(a.clone(), b, target.clone());
            let at = numbers(&hidden.offset.val());
            Ok(Evaluation::new(loss)
                .value("x", at[0])
                .value("y", at[1])
                .value("distance", distance(&at, &[0.0; 2]))
                .image("render", a))
        })?;

    let found = numbers(&fitted.module.offset.val());
    let images = [
        ("initial", picture(&fixed(&START), &camera, &sharp)?),
        ("target", picture(&still, &camera, &sharp)?),
        ("final", picture(&fixed(&found), &camera, &sharp)?),
    ];
    let plots = vec![
        curves(&fitted.history, "offset", &["x", "y"], false),
        curves(
            &fitted.history,
            "distance to the target",
            &["distance"],
            true,
        ),
    ];
    let outcome = Outcome {
        errors: [distance(&START, &[0.0; 2]), distance(&found, &[0.0; 2])],
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
