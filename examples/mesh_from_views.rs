//! Recovers a mesh from twelve views: large steps and regularizers turn a ball into a bent, dented body.

pub(crate) mod common;

use burn::module::{Module, Param};
use clap::Parser;
use softray::optim::{
    BlurSchedule, Evaluation, LargeSteps, LargeStepsConfig, MeshRegularizer, Rate, loss,
    sample_points,
};
use softray::prelude::*;

use common::study::{Arguments, Failure, Outcome, Study, cameras_around, picture};

#[derive(Module, Debug)]
struct Body {
    /// `[V, 3]`, scene units.
    vertices: Param<Tensor<2>>,
}

const VIEWS: usize = 12;
/// Points of each surface for the Chamfer distance.
const POINTS: usize = 4000;

/// Maps a point of the ball to the target: stretched, with three lobes, a dent and a bend.
fn formed([x, y, z]: [f64; 3]) -> [f64; 3] {
    let around = z.atan2(x);
    let flat = (1.0 - y * y).max(0.0);
    let lobes = 1.0 + 0.22 * (3.0 * around).cos() * flat;
    let dent = 1.0 - 0.45 * (-4.0 * ((y - 1.0).powi(2) + 0.5 * flat)).exp();
    let (x, y, z) = (0.8 * x * lobes, 1.05 * y * dent, 0.8 * z * lobes);
    [x + 0.25 * y * y - 0.1, y, z]
}

#[expect(
    clippy::too_many_lines,
    reason = "a program from its scene to its figure"
)]
pub(crate) fn run(arguments: &Arguments) -> Result<Outcome, Failure> {
    let device = arguments.device()?;
    let ball = shapes::icosphere(arguments.either(2, 3), &device);
    let fine = shapes::icosphere(4, &device);
    let points: Vec<[f64; 3]> = fine.host_vertices()?.into_iter().map(formed).collect();
    let goal = Mesh::from_host(&points, fine.faces.to_vec(), &device);
    let light = |x: f64, z: f64, color: [f64; 3]| {
        let corners = [
            [x - 1.0, 5.0, z - 1.0],
            [x + 1.0, 5.0, z - 1.0],
            [x + 1.0, 5.0, z + 1.0],
            [x - 1.0, 5.0, z + 1.0],
        ];
        let [a, b, c, d] = corners;
        Object::new(shapes::quad(a, b, c, d, &device)).with_material(Material::emitter(color))
    };
    // Light comes from all sides, and its color depends on the direction.
    let scene = |mesh: Mesh| {
        Scene::new()
            .with_object(
                Object::new(mesh)
                    .with_name("body")
                    .with_material(Material::diffuse([0.7, 0.7, 0.7])),
            )
            .with_object(light(-3.0, 2.0, [18.0, 9.0, 6.0]))
            .with_object(light(3.0, -2.0, [6.0, 9.0, 18.0]))
            .with_environment([0.35, 0.4, 0.45])
    };
    let cameras = cameras_around(VIEWS, [0.3, 2.2, -1.6], 40.0);
    let size = arguments.either(32, 64);
    let options = RenderOptions::new(size, size).with_bounces(0);
    let still = scene(goal.clone());
    let sharp = options
        .clone()
        .with_samples(256)
        .with_seed(1 << 50)
        .with_opacity();
    let see = |camera: &Camera| -> Result<(Tensor<3>, Tensor<2>), Failure> {
        let image = render(&still, camera, &sharp)?;
        let opacity = image.opacity.ok_or("opacity is requested")?;
        Ok((image.radiance, opacity))
    };
    let targets = cameras.iter().map(see).collect::<Result<Vec<_>, _>>()?;

    let study = Study::new(
        "mesh_from_views",
        "A mesh from twelve views",
        arguments,
        arguments.either(200, 500),
    );
    let topology = MeshRegularizer::from_mesh(&ball)?;
    let first = ball.vertices.clone().mul_scalar(0.75);
    let module = Body {
        vertices: Param::from_tensor(first.clone().autodiff()),
    };
    let wanted = sample_points(&goal, POINTS, 0)?;
    let steps = LargeSteps::from_mesh(&ball, &LargeStepsConfig::default().with_lambda(8.0))?;
    let per_step = arguments.either(2, 3);
    let fitted = study
        .fit(module, steps)
        .with_rate(Rate::exponential(0.2, 0.02))
        .with_blur(BlurSchedule::decay(2.3, 0.6, study.steps() / 2)?)
        .run(|body: &Body, step: &_| {
            let vertices = body.vertices.val();
            let scene = scene(ball.clone().with_vertices(vertices.clone()));
            let few = options.clone().with_samples(4).with_opacity();
            let (mut sum, mut first) = (Tensor::zeros([1], &vertices.device()), None);
            for k in 0..per_step {
                // Views take turns; views of one step are far apart.
                let view = (step.index + k * VIEWS / per_step) % VIEWS;
                let see = |r| render(&scene, &cameras[view], &step.options(&few, r));
                let (a, b) = (see(2 * k as u64)?, see(2 * k as u64 + 1)?);
                let (target, silhouette) = targets[view].clone();
                first = first.or(Some((view, a.radiance.clone(), target.clone())));
                if let Some(opacity) = a.opacity {
                    sum = sum + loss::silhouette_iou(opacity, silhouette)? * 0.2;
                }
                sum = sum + loss::mse_unbiased(a.radiance, b.radiance, target)?;
            }
            let batch = vertices.unsqueeze();
            let regular = topology.laplacian(batch.clone()) * 0.05
                + topology.normal_consistency(batch) * 0.002;
            let mut evaluation = Evaluation::new(sum / per_step as f64 + regular);
            if let Some((view, image, target)) = first {
                let name = format!("view {view}");
                evaluation = evaluation
                    .with_image(&name, image)
                    .with_target(name, target);
            }
            Ok(evaluation)
        })?;

    let found = ball
        .clone()
        .with_vertices(fitted.module.vertices.val().inner());
    let before = ball.with_vertices(first);
    let show = options.clone().with_samples(256);
    let images = [
        (
            "initial",
            picture(&scene(before.clone()), &cameras[1], &show)?,
        ),
        ("target", picture(&still, &cameras[1], &show)?),
        ("final", picture(&scene(found.clone()), &cameras[1], &show)?),
    ];
    let iou = |mesh: &Mesh| -> Result<f64, Failure> {
        let scene = scene(mesh.clone());
        let mut sum = 0.0;
        for (camera, (_, silhouette)) in cameras.iter().zip(&targets) {
            let opacity = render(&scene, camera, &sharp)?.opacity;
            let opacity = opacity.ok_or("opacity is requested")?;
            sum += loss::iou(&opacity, silhouette, 0.5)?;
        }
        Ok(sum / VIEWS as f64)
    };
    let apart = |mesh: &Mesh| -> softray::Result<f64> {
        let distance = loss::chamfer(sample_points(mesh, POINTS, 1)?, wanted.clone())?;
        Ok(distance.into_scalar::<f32>().into())
    };
    let errors = [apart(&before)?, apart(&found)?];
    let outcome = Outcome {
        errors,
        of: "Chamfer distance, mean squared, both ways, scene units²".into(),
        others: vec![
            ("Chamfer distance at the end, root".into(), errors[1].sqrt()),
            ("silhouette IoU at the start".into(), iou(&before)?),
            ("silhouette IoU at the end".into(), iou(&found)?),
        ],
    };
    let plots = vec![fitted.history.plot("blur, °", &["blur"])?.with_log_scale()];
    study.finish(&fitted, images, plots, outcome)
}

fn main() -> Result<(), Failure> {
    common::log();
    run(&Arguments::parse())?;
    Ok(())
}
