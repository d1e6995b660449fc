//! Shapes of any topology from pictures alone: a ball becomes a torus, and another ball becomes two.
//!
//! Signed distances at the nodes of a grid are fitted (`DMTetParams`). Renders move the surface. The soft silhouettes of the
//! distances open the hole and the gap, where no render sees a surface that could move there.

pub(crate) mod common;

use burn::module::Module;
use burn::optim::AdamConfig;
use burn::tensor::Int;
use clap::Parser;
use softray::meshing::{TriangleMesh, volume_iou};
use softray::modules::{DMTetParams, DMTetParamsConfig, TetrahedralGrid};
use softray::optim::{Evaluation, Rate, Step, loss};
use softray::prelude::*;

use common::study::{Arguments, Failure, Outcome, Study, cameras_around, picture};

#[derive(Module, Debug)]
struct Shapes {
    torus: DMTetParams,
    balls: DMTetParams,
}

impl Shapes {
    fn all(&self) -> [&DMTetParams; 2] {
        [&self.torus, &self.balls]
    }
}

const VIEWS: usize = 12;
/// The length of the cube's edges, scene units.
const SIDE: f64 = 2.0;

/// A gray shape under a sky that is brighter above and on one side.
fn scene(mesh: Mesh) -> Scene {
    let sky = [
        [
            [1.2, 1.1, 1.0],
            [1.0, 0.8, 0.6],
            [0.4, 0.5, 0.7],
            [0.6, 0.7, 0.9],
        ],
        [
            [0.3, 0.3, 0.3],
            [0.3, 0.2, 0.1],
            [0.1, 0.1, 0.2],
            [0.2, 0.2, 0.3],
        ],
    ];
    let sky = Tensor::from_floats(sky, &mesh.vertices.device().inner());
    let gray = Material::diffuse([0.7; 3]);
    Scene::new()
        .with_object(Object::new(mesh).with_material(gray))
        .with_environment(Environment::map(sky))
}

/// The targets: a torus, and two balls.
fn targets(device: &Device) -> softray::Result<Vec<Mesh>> {
    let grid = TetrahedralGrid::new(64, SIDE)?;
    let nodes = grid.nodes(device);
    let axis = |i: usize| nodes.clone().narrow(3, i, 1).squeeze_dim::<3>(3);
    let far = |x: Tensor<3>, y: Tensor<3>, z: Tensor<3>| {
        (x.powi_scalar(2) + y.powi_scalar(2) + z.powi_scalar(2)).sqrt()
    };
    let [x, y, z] = [0, 1, 2].map(axis);
    let around = far(x.clone(), x.zeros_like(), z.clone()) - 0.52;
    let torus = far(around, y.clone(), y.zeros_like()) - 0.24;
    let ball = |at: f64| far(x.clone() - at, y.clone() - 0.2 * at, z.clone()) - 0.36;
    let balls = ball(-0.46).min_pair(ball(0.46));
    grid.surfaces(Tensor::stack(vec![torus, balls], 0), None)
}

#[expect(
    clippy::too_many_lines,
    reason = "a program from its scene to its figure"
)]
pub(crate) fn run(arguments: &Arguments) -> Result<Outcome, Failure> {
    let device = arguments.device()?;
    let (size, cells) = (arguments.either(32, 64), arguments.either(20, 32));
    let cameras = cameras_around(VIEWS, [0.6, 2.6, -1.8], 30.0);
    let goals = targets(&device)?;
    let options = RenderOptions::new(size, size)
        .with_bounces(0)
        .with_opacity();
    let sharp = options.clone().with_samples(256).with_seed(1 << 50);
    // Images and silhouettes of all cameras, for each shape.
    let see = |mesh: &Mesh| -> softray::Result<(Tensor<4>, Tensor<3>)> {
        let scenes = vec![scene(mesh.clone())];
        let images = render_batch(&Batch::new(scenes, cameras.clone())?, &sharp)?;
        Ok((images.radiance, images.opacity.expect("requested")))
    };
    let seen = goals.iter().map(see).collect::<Result<Vec<_>, _>>()?;

    let (title, steps) = ("Topology from pictures", arguments.either(150, 300));
    let study = Study::new("topology", title, arguments, steps);
    let ball = DMTetParamsConfig::new(cells)
        .with_side(SIDE)
        .with_radius(0.6);
    let [torus, balls] = [(), ()].map(|()| ball.init(&device.clone().autodiff()));
    let module = Shapes {
        torus: torus?,
        balls: balls?,
    };
    let grid = module.torus.grid();
    let few = options.clone().with_samples(4);
    let per_step = arguments.either(2, 3);
    let evaluate = |shapes: &Shapes, step: &Step| {
        // Views of one step are far apart.
        let views: Vec<_> = (0..per_step)
            .map(|k| (step.index + k * VIEWS / per_step) % VIEWS)
            .collect();
        let some = views
            .iter()
            .map(|&view| cameras[view].clone())
            .collect::<Vec<_>>();
        // Soft silhouettes show the way, and matter less and less.
        let soft = 1.0 - step.index as f64 / study.steps() as f64;
        let rows: Vec<i32> = views.iter().map(|&view| view as i32).collect();
        let rows = Tensor::<1, Int>::from_ints(rows.as_slice(), &device);
        let mut sum = Tensor::zeros([1], &device.clone().autodiff());
        let mut shown = None;
        for ((index, shape), (colors, silhouettes)) in
            shapes.all().into_iter().enumerate().zip(&seen)
        {
            let batch = Batch::new(vec![scene(shape.mesh()?)], some.clone())?;
            let look = |k| render_batch(&batch, &step.options(&few, 2 * index as u64 + k));
            let [a, b] = [look(0)?, look(1)?];
            let color = colors.clone().select(0, rows.clone());
            let silhouette = silhouettes.clone().select(0, rows.clone());
            shown = shown.or(Some((a.radiance.clone(), color.clone())));
            let opacity = a.opacity.expect("requested");
            sum = sum
                + loss::mse_unbiased(a.radiance, b.radiance, color)?
                + loss::silhouette_iou(opacity, silhouette.clone())? * 0.2;
            let grids = shape.distances.val().unsqueeze();
            let views: Vec<_> = some.iter().map(|camera| (0, camera.clone())).collect();
            let found = grid.opacity(grids.clone(), &views, [size; 2], 2.0 * grid.step())?;
            let soft_loss = (found - silhouette.autodiff()).powi_scalar(2).mean();
            sum = sum
                + soft_loss * (0.5 * soft)
                + loss::eikonal(grids.clone(), grid.step())? * 0.02
                + loss::bending(grids, grid.step())? * 0.02;
        }
        let mut evaluation = Evaluation::new(sum);
        if let Some((image, target)) = shown {
            let first = |images: Tensor<4>| images.narrow(0, 0, 1).squeeze_dim::<3>(0);
            evaluation = evaluation
                .with_image("torus", first(image))
                .with_target("torus", first(target));
        }
        Ok(evaluation)
    };
    let before = module.clone();
    let fitted = study
        .fit(module, AdamConfig::new().init())
        .with_rate(Rate::exponential(0.5 * grid.step(), 0.05 * grid.step()))
        .run(evaluate)?;

    // Both shapes beside each other, from above.
    let show = |meshes: &[Mesh]| {
        let mut scene = scene(meshes[0].clone());
        let gray = scene.objects[0].clone();
        let beside = meshes.iter().zip([-0.95, 0.95]).map(|(mesh, x)| {
            let mut object = gray.clone();
            object.mesh = mesh.clone().translated([x, 0.0, 0.0]);
            object
        });
        scene.objects = beside.collect::<Vec<_>>().into();
        let camera = Camera::look_at([0.0, 4.6, 4.2], [0.0; 3]).with_fov_y(34.0);
        picture(&scene, &camera, &sharp)
    };
    let still = |shapes: &Shapes| -> softray::Result<Vec<Mesh>> {
        let meshes = shapes.all().map(DMTetParams::mesh).into_iter();
        let still = |mesh: Mesh| {
            let vertices = mesh.vertices.clone().inner();
            mesh.with_vertices(vertices)
        };
        meshes.map(|mesh| mesh.map(still)).collect()
    };
    let (before, found) = (still(&before)?, still(&fitted.module)?);
    let images = [
        ("initial", show(&before)?),
        ("target", show(&goals)?),
        ("final", show(&found)?),
    ];
    let lists = |meshes: &[Mesh]| -> softray::Result<Vec<TriangleMesh>> {
        meshes.iter().map(TriangleMesh::try_from).collect()
    };
    let (before, found, goals) = (lists(&before)?, lists(&found)?, lists(&goals)?);
    let missing = |shapes: &[TriangleMesh]| -> softray::Result<f64> {
        let pairs = shapes.iter().zip(&goals);
        let shares = pairs.map(|(a, b)| volume_iou(a, b, 64));
        Ok(1.0 - shares.sum::<softray::Result<f64>>()? / 2.0)
    };
    let [torus, balls] = [found[0].statistics()?, found[1].statistics()?];
    let outcome = Outcome {
        errors: [missing(&before)?, missing(&found)?],
        of: "1 − IoU of the volumes".into(),
        others: vec![
            ("genus of the torus".into(), torus.genus.unwrap_or(0) as f64),
            ("parts of the torus".into(), torus.components as f64),
            ("parts of the balls".into(), balls.components as f64),
            ("genus of the balls".into(), balls.genus.unwrap_or(0) as f64),
        ],
    };
    study.finish(&fitted, images, Vec::new(), outcome)
}

fn main() -> Result<(), Failure> {
    common::log();
    run(&Arguments::parse())?;
    Ok(())
}
