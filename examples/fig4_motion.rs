//! Figure 4 of the paper: recovers the velocity and the vertices of an icosahedron together, from one image with
//! motion blur.

pub(crate) mod common;

use burn::module::{Module, Param};
use burn::optim::AdamConfig;
use burn::tensor::TensorData;
use clap::Parser;
use softray::optim::{BlurSchedule, Evaluation, MeshRegularizer, Rate, loss};
use softray::prelude::*;

use common::study::{Arguments, Failure, Outcome, Study, distance, numbers, picture};

#[derive(Module, Debug)]
struct Moving {
    /// Vertices at the start of the shutter `[V, 3]`, scene units.
    vertices: Param<Tensor<2>>,
    /// Displacement over the shutter `[3]` in units of [`UNIT`].
    velocity: Param<Tensor<1>>,
}

/// Scene units per unit of the velocity parameter: its steps are larger than those of the vertices by this factor.
const UNIT: f64 = 4.0;
/// Sideways and up. The camera is near, so that the size of the body in the image shows motion along the view.
const VELOCITY: [f32; 3] = [0.9, 0.35, 0.0];

#[expect(
    clippy::too_many_lines,
    reason = "a program from its scene to its figure"
)]
pub(crate) fn run(arguments: &Arguments) -> Result<Outcome, Failure> {
    let device = arguments.device()?;
    let camera = Camera::look_at([0.4, 0.2, 3.0], [0.4, 0.2, 0.0]).with_fov_y(70.0);
    let size = arguments.either(48, 64);
    let options = RenderOptions::new(size, size).with_bounces(0);
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
            .with_object(
                Object::new(icosahedron.clone().with_vertices(vertices))
                    .with_name("icosahedron")
                    .with_material(Material::diffuse([0.8, 0.6, 0.4]))
                    .with_velocity(velocity),
            )
            .with_object(
                Object::new(light.clone()).with_material(Material::emitter([40.0, 40.0, 40.0])),
            )
            .with_environment([0.25, 0.3, 0.35])
    };
    // The target is taller than wide and has a tip pulled out.
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
    let sharp = options.clone().with_samples(2048).with_seed(1 << 50);
    let target = render(&still, &camera, &sharp)?.radiance;

    let study = Study::new(
        "fig4_motion",
        "Velocity and geometry from motion blur",
        arguments,
        arguments.either(450, 600),
    );
    // The start is a coarse guess: a ball at rest.
    let first = flat(&round).iter().map(|x| 0.8 * x).collect::<Vec<_>>();
    let topology = MeshRegularizer::from_mesh(&icosahedron)?;
    let module = Moving {
        vertices: Param::from_tensor(tensor(&first).autodiff()),
        velocity: Param::from_tensor(Tensor::zeros([3], &device.clone().autodiff())),
    };
    let fitted = study
        .fit(module, AdamConfig::new().with_beta_2(0.99).init())
        .with_rate(Rate::cosine(0.01))
        .with_blur(BlurSchedule::decay(17.0, 0.6, study.steps() / 2)?)
        .run(|moving: &Moving, step: &_| {
            let (vertices, velocity) = (moving.vertices.val(), moving.velocity.val() * UNIT);
            let scene = scene(vertices.clone(), velocity.clone());
            let few = options.clone().with_samples(16);
            let see = |k| render(&scene, &camera, &step.options(&few, k));
            let (a, b) = (see(0)?.radiance, see(1)?.radiance);
            let image = loss::mse_unbiased(a.clone(), b, target.clone())?;
            // The regularizer holds vertices that are not visible close to their neighbors.
            let smooth = topology.laplacian(vertices.clone().unsqueeze());
            let far = distance(&numbers(&velocity), &VELOCITY.map(f64::from));
            Ok(Evaluation::new(image + smooth * 2e-3)
                .with_value("velocity error", far)
                .with_value("x", numbers(&velocity)[0])
                .with_value("y", numbers(&velocity)[1])
                .with_value("z", numbers(&velocity)[2])
                .with_image("render", a)
                .with_target("render", target.clone()))
        })?;

    let (vertices, velocity) = (
        fitted.module.vertices.val().inner(),
        fitted.module.velocity.val().inner() * UNIT,
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
    let plots = vec![
        fitted
            .history
            .plot("velocity (target 0.9, 0.35, 0)", &["x", "y", "z"])?,
        fitted
            .history
            .plot("its error, scene units", &["velocity error"])?
            .with_log_scale(),
    ];
    // One image contains little about vertices on the far side, so silhouettes at rest are compared.
    let outline = |vertices: Tensor<2>| -> Result<Tensor<2>, Failure> {
        let still = scene(vertices, Tensor::zeros([3], &device));
        let image = render(
            &still,
            &camera,
            &sharp.clone().with_samples(64).with_opacity(),
        )?;
        Ok(image.opacity.ok_or("opacity was asked for")?)
    };
    let wanted = outline(tensor(&goal))?;
    let overlap = |vertices: Tensor<2>| -> Result<f64, Failure> {
        Ok(loss::iou(&outline(vertices)?, &wanted, 0.5)?)
    };
    let goal_velocity = VELOCITY.map(f64::from);
    let outcome = Outcome {
        errors: [
            distance(&[0.0; 3], &goal_velocity),
            distance(&numbers(&velocity), &goal_velocity),
        ],
        of: "error of the velocity, scene units".into(),
        others: vec![
            (
                "silhouette IoU of the body at rest, start".into(),
                overlap(tensor(&first))?,
            ),
            (
                "silhouette IoU of the body at rest, end".into(),
                overlap(vertices)?,
            ),
        ],
    };
    study.finish(&fitted, images, plots, outcome)
}

fn main() -> Result<(), Failure> {
    common::log();
    run(&Arguments::parse())?;
    Ok(())
}
