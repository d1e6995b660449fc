//! Where the camera stands and where it looks, from one image.

pub(crate) mod common;

use burn::module::{Module, Param};
use burn::optim::AdamConfig;
use clap::Parser;
use softray::optim::{BlurSchedule, Evaluation, Rate, loss};
use softray::prelude::*;

use common::study::{Arguments, Failure, Outcome, Study, curves, distance, numbers, picture};

#[derive(Module, Debug)]
struct Pose {
    /// Scene units.
    eye: Param<Tensor<1>>,
    /// The point looked at, scene units.
    target: Param<Tensor<1>>,
}

const EYE: [f64; 3] = [1.2, 1.5, 4.0];
const TARGET: [f64; 3] = [0.0, 0.5, 0.0];
const START_EYE: [f64; 3] = [2.0, 1.1, 4.5];
const START_TARGET: [f64; 3] = [0.3, 0.75, 0.0];

/// Blocks of several colours on a floor.
fn scene(device: &Device) -> Scene {
    let block = |size: [f64; 3], place: [f64; 3], degrees: f64, colour: [f64; 3]| {
        let pose = Transform::new()
            .scale(Tensor::from_floats(size.map(|s| 0.5 * s), device))
            .axis_angle(
                [0.0, 1.0, 0.0],
                Tensor::from_floats([degrees.to_radians()], device),
            )
            .translation(Tensor::from_floats(place, device));
        Object::new(shapes::cube(device).transformed(&pose)).material(Material::diffuse(colour))
    };
    let floor = shapes::quad(
        [-2.0, 0.0, 2.0],
        [2.0, 0.0, 2.0],
        [2.0, 0.0, -2.0],
        [-2.0, 0.0, -2.0],
        device,
    );
    Scene::new()
        .with(Object::new(floor).material(Material::diffuse([0.35, 0.35, 0.4])))
        .with(block(
            [0.8, 1.2, 0.8],
            [-0.7, 0.6, -0.3],
            25.0,
            [0.8, 0.25, 0.2],
        ))
        .with(block(
            [0.7, 0.7, 0.7],
            [0.6, 0.35, 0.4],
            -15.0,
            [0.2, 0.6, 0.3],
        ))
        .with(block(
            [1.4, 0.3, 0.4],
            [0.3, 0.15, -1.0],
            10.0,
            [0.85, 0.7, 0.2],
        ))
        .with(Object::new(ball(device)).material(Material::diffuse([0.2, 0.35, 0.8])))
        .environment([0.9, 0.95, 1.0])
}

/// The point looked at, as far away as the target: what is nearer or further on the same line is the
/// same to a camera.
fn aim(pose: &Pose) -> Vec<f64> {
    let [eye, target] = [&pose.eye, &pose.target].map(|p| {
        let p = numbers(&p.val());
        glam::DVec3::new(p[0], p[1], p[2])
    });
    let far = glam::DVec3::from(EYE).distance(TARGET.into());
    (eye + (target - eye).normalize() * far).to_array().to_vec()
}

fn ball(device: &Device) -> Mesh {
    shapes::icosphere(1, device)
        .scaled(Tensor::from_floats([0.3], device))
        .translated(Tensor::from_floats([-0.5, 0.3, 0.9], device))
}

pub(crate) fn run(arguments: &Arguments) -> Result<Outcome, Failure> {
    let device = arguments.device()?;
    let scene = scene(&device);
    let camera = |eye: Tensor<1>, target: Tensor<1>| Camera::look_at(eye, target).fov_y(38.0);
    let fixed = |eye: &[f64], target: &[f64]| {
        let tensor = |v: &[f64]| Tensor::from_floats([v[0], v[1], v[2]], &device);
        camera(tensor(eye), tensor(target))
    };
    let goal = fixed(&EYE, &TARGET);
    let size = arguments.either(40, 64);
    let options = RenderOptions::new(size, size).bounces(0);
    let sigma = BlurSchedule::sharp_sigma(&scene, &goal, size)?;
    let sharp = options.clone().samples(1024).sigma(sigma).seed(1 << 50);
    let target = render(&scene, &goal, &sharp)?.radiance;

    let study = Study::new(
        "camera_pose",
        "The pose of a camera",
        arguments,
        arguments.either(250, 400),
    );
    let leaf =
        |at: [f64; 3]| Param::from_tensor(Tensor::from_floats(at, &device.clone().autodiff()));
    let module = Pose {
        eye: leaf(START_EYE),
        target: leaf(START_TARGET),
    };
    let both = |pose: &Pose| [numbers(&pose.eye.val()), aim(pose)].concat();
    let far = |both: &[f64]| distance(both, &[EYE, TARGET].concat());
    let fitted = study
        .fit(module, AdamConfig::new().with_beta_2(0.99).init())
        .rate(Rate::cosine(0.03))
        .sigma(BlurSchedule::auto(&scene, &goal, size, study.steps())?)
        .run(|pose: &Pose, step: &_| {
            let camera = camera(pose.eye.val(), pose.target.val());
            let few = options.clone().samples(8);
            let see = |k| render(&scene, &camera, &step.options(&few, k));
            let (a, b) = (see(0)?.radiance, see(1)?.radiance);
            let loss = loss::multi_scale_unbiased(a.clone(), b, target.clone(), 4);
            Ok(Evaluation::new(loss)
                .value("eye", distance(&numbers(&pose.eye.val()), &EYE))
                .value("target", distance(&aim(pose), &TARGET))
                .image("render", a))
        })?;

    let found = both(&fitted.module);
    let images = [
        (
            "initial",
            picture(&scene, &fixed(&START_EYE, &START_TARGET), &sharp)?,
        ),
        ("target", picture(&scene, &goal, &sharp)?),
        (
            "final",
            picture(&scene, &fixed(&found[..3], &found[3..]), &sharp)?,
        ),
    ];
    let plots = vec![curves(
        &fitted.history,
        "distances, scene units",
        &["eye", "target"],
        true,
    )];
    let outcome = Outcome {
        errors: [far(&[START_EYE, START_TARGET].concat()), far(&found)],
        of: "distance of eye and target together, scene units".into(),
        others: Vec::new(),
    };
    study.finish(&fitted, images, plots, outcome)
}

fn main() -> Result<(), Failure> {
    env_logger::init();
    run(&Arguments::parse())?;
    Ok(())
}
