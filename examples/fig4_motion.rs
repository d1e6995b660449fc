//! Figure 4 of the paper: the velocity of an icosahedron and its vertices together, from one image
//! blurred by its motion.

pub(crate) mod common;

use burn::module::{Module, Param};
use burn::optim::AdamConfig;
use burn::tensor::TensorData;
use clap::Parser;
use softray::optim::{BlurSchedule, Evaluation, MeshRegulariser, Rate, loss};
use softray::prelude::*;

use common::study::{Arguments, Failure, Outcome, Study, curves, distance, numbers, picture};

#[derive(Module, Debug)]
struct Moving {
    /// Vertices at the start of the shutter `[V, 3]`, scene units.
    vertices: Param<Tensor<2>>,
    /// Displacement over the shutter `[3]`, scene units.
    velocity: Param<Tensor<1>>,
}

/// Sideways and up: along the view an image tells little.
const VELOCITY: [f32; 3] = [0.9, 0.35, 0.0];

pub(crate) fn run(arguments: &Arguments) -> Result<Outcome, Failure> {
    let device = arguments.device()?;
    let camera = Camera::look_at([0.35, 0.15, 5.0], [0.35, 0.15, 0.0]).fov_y(44.0);
    let size = arguments.either(40, 64);
    let options = RenderOptions::new(size, size).bounces(0);
    let icosahedron = shapes::icosahedron(&device);
    let light = shapes::quad(
        [-3.0, 3.0, 1.0],
        [-1.0, 4.5, 1.0],
        [-1.0, 4.5, 3.0],
        [-3.0, 3.0, 3.0],
        &device,
    );
    let scene = |vertices: Tensor<2>, velocity: Tensor<1>| {
        Scene::new()
            .with(
                Object::new(icosahedron.clone().with_vertices(vertices))
                    .named("icosahedron")
                    .material(Material::diffuse([0.8, 0.6, 0.4]))
                    .velocity(velocity),
            )
            .with(Object::new(light.clone()).material(Material::emitter([40.0, 40.0, 40.0])))
            .environment([0.25, 0.3, 0.35])
    };
    // The target: taller than wide, and a tip pulled out.
    let round = icosahedron.host_vertices()?;
    let goal: Vec<[f64; 3]> = round
        .iter()
        .map(|&[x, y, z]| {
            let pull = if x > 0.5 && y > 0.0 { 1.35 } else { 1.0 };
            [0.75 * x * pull, 1.05 * y * pull, 0.9 * z]
        })
        .collect();
    let flat = |points: &[[f64; 3]]| -> Vec<f64> { points.iter().flatten().copied().collect() };
    let tensor = |points: &[f64]| {
        let values: Vec<f32> = points.iter().map(|&x| x as f32).collect();
        Tensor::<2>::from_data(TensorData::new(values, [points.len() / 3, 3]), &device)
    };
    let goal = flat(&goal);
    let still = scene(tensor(&goal), Tensor::from_floats(VELOCITY, &device));
    let sharp = BlurSchedule::sharp_sigma(&still, &camera, size)?;
    let sharp = options.clone().samples(2048).sigma(sharp).seed(1 << 50);
    let target = render(&still, &camera, &sharp)?.radiance;

    let study = Study::new(
        "fig4_motion",
        "Velocity and geometry from motion blur",
        arguments,
        arguments.either(250, 500),
    );
    // A coarse guess: a ball at rest.
    let first = flat(&round).iter().map(|x| 0.8 * x).collect::<Vec<_>>();
    let topology = MeshRegulariser::from_mesh(&icosahedron)?;
    let module = Moving {
        vertices: Param::from_tensor(tensor(&first).to_device(&device.clone().autodiff())),
        velocity: Param::from_tensor(Tensor::zeros([3], &device.clone().autodiff())),
    };
    let fitted = study
        .fit(module, AdamConfig::new().with_beta_2(0.99).init())
        .rate(Rate::cosine(0.02))
        .sigma(BlurSchedule::auto(&still, &camera, size, study.steps())?)
        .run(|moving: &Moving, step: &_| {
            let (vertices, velocity) = (moving.vertices.val(), moving.velocity.val());
            let scene = scene(vertices.clone(), velocity.clone());
            let few = options.clone().samples(16);
            let see = |k| render(&scene, &camera, &step.options(&few, k));
            let (a, b) = (see(0)?.radiance, see(1)?.radiance);
            let image = loss::mse_unbiased(a.clone(), b, target.clone());
            // What the image does not see is held by its neighbours.
            let smooth = topology.laplacian(vertices.clone().unsqueeze());
            let far = distance(&numbers(&velocity), &VELOCITY.map(f64::from));
            Ok(Evaluation::new(image + smooth * 1e-4)
                .value("velocity error", far)
                .value("vertex error", rms(&numbers(&vertices), &goal))
                .image("render", a))
        })?;

    let (vertices, velocity) = (
        fitted.module.vertices.val().inner(),
        fitted.module.velocity.val().inner(),
    );
    let images = [
        (
            "initial",
            picture(
                &scene(tensor(&first), Tensor::zeros([3], &device)),
                &camera,
                &sharp,
            )?,
        ),
        ("target", picture(&still, &camera, &sharp)?),
        (
            "final",
            picture(&scene(vertices.clone(), velocity.clone()), &camera, &sharp)?,
        ),
    ];
    let plots = vec![curves(
        &fitted.history,
        "errors, scene units",
        &["velocity error", "vertex error"],
        true,
    )];
    let goal_velocity = VELOCITY.map(f64::from);
    let outcome = Outcome {
        errors: [
            distance(&[0.0; 3], &goal_velocity),
            distance(&numbers(&velocity), &goal_velocity),
        ],
        of: "error of the velocity, scene units".into(),
        others: vec![
            ("vertices at the start, RMS".into(), rms(&first, &goal)),
            (
                "vertices at the end, RMS".into(),
                rms(&numbers(&vertices), &goal),
            ),
        ],
    };
    study.finish(&fitted, images, plots, outcome)
}

/// The root of the mean squared distance of points.
fn rms(a: &[f64], b: &[f64]) -> f64 {
    distance(a, b) / (a.len() as f64 / 3.0).sqrt()
}

fn main() -> Result<(), Failure> {
    env_logger::init();
    run(&Arguments::parse())?;
    Ok(())
}
