use std::time::Instant;

use clap::{Args, ValueEnum};
use softray::prelude::*;

use crate::weights::{SIZE, block_weights};
use crate::{data, load, mean_and_deviation};

#[derive(Args)]
pub struct Gradient {
    /// Which derivatives [default: the three with references].
    #[arg(value_enum)]
    cases: Vec<Case>,
    /// Samples a pixel.
    #[arg(long, default_value_t = 256)]
    spp: u32,
    /// Seeds, each a run of its own.
    #[arg(long, default_value_t = 16)]
    seeds: u64,
    /// Central differences of the same renders in place of gradients, with this step.
    #[arg(long)]
    differences: Option<f64>,
    /// Bounces, in place of those of the case.
    #[arg(long)]
    bounces: Option<u32>,
    /// Subdivisions of the ball of `sphere` in place of its own.
    #[arg(long)]
    subdivisions: Option<u32>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Case {
    /// The shadow of a triangle, moved.
    OccluderX,
    /// A ball, moved, with one bounce.
    BallZ,
    /// A block of the Cornell box, turned, with one bounce.
    TallTurn,
}

impl Case {
    /// Scene, object, bounces, name of the reference.
    fn of(self) -> (&'static str, &'static str, u32, &'static str) {
        match self {
            Self::OccluderX => ("shadow", "occluder", 0, "occluder-x"),
            Self::BallZ => ("sphere", "sphere", 1, "ball-z"),
            Self::TallTurn => ("cornell", "tall", 1, "tall-turn"),
        }
    }
}

/// The weights of a case's pixels, and Σ weights·reference.
pub fn weights(scene: &str, reference: &str) -> (Vec<f32>, f64) {
    block_weights(&data(scene).join(format!("gradient-{reference}.exr")))
}

impl Gradient {
    pub fn run(&self, visibility: Visibility) {
        let cases = if self.cases.is_empty() {
            vec![Case::OccluderX, Case::BallZ, Case::TallTurn]
        } else {
            self.cases.clone()
        };
        for case in cases {
            self.case(case, visibility);
        }
    }

    #[expect(
        clippy::too_many_lines,
        reason = "a measurement from its scene to its table"
    )]
    fn case(&self, case: Case, visibility: Visibility) {
        let (name, object, bounces, reference) = case.of();
        let bounces = self.bounces.unwrap_or(bounces);
        let file = load(name);
        let (weights, exact) = weights(name, reference);
        let device = Device::flex();
        let weights = Tensor::<1>::from_floats(weights.as_slice(), &device);
        let weights = weights.reshape([SIZE, SIZE, 1]);

        let mut scene = file.scene;
        if let (Some(n), Case::BallZ) = (self.subdivisions, case) {
            let ball = shapes::icosphere(n, &device)
                .scaled(Tensor::from_floats([0.8], &device))
                .translated(Tensor::from_floats([0.0, 0.8, 0.0], &device));
            scene = scene
                .map_object(object, |o| o.map_mesh(|_| ball.clone()))
                .expect("the object");
        }
        let vertices = scene
            .object(object)
            .expect("the object")
            .mesh
            .vertices
            .clone();
        // The mean of the corners of its triangles.
        let mesh = &scene.object(object).expect("the object").mesh;
        let host = mesh.host_vertices().expect("values");
        let corners = mesh.faces.iter().flatten();
        let count = 3.0 * mesh.faces.len() as f64;
        let mut centre = [0.0; 3];
        for &v in corners {
            for (c, x) in centre.iter_mut().zip(host[v as usize]) {
                *c += x / count;
            }
        }
        let loss = |x: &Tensor<1>, seed: u64| {
            let moved = moved(case, &vertices, x, centre);
            let scene = scene
                .clone()
                .map_object(object, |o| o.map_mesh(|m| m.with_vertices(moved.clone())))
                .expect("the object");
            let options = RenderOptions::new(SIZE, SIZE)
                .samples(self.spp)
                .bounces(bounces)
                .visibility(visibility)
                .seed(seed);
            let image = render(&scene, &file.camera, &options).expect("an image");
            (image.radiance * weights.clone()).sum()
        };
        let estimate = |seed: u64| match self.differences {
            None => {
                let leaf = Tensor::<1>::zeros([1], &device).autodiff().require_grad();
                let gradients = loss(&leaf, seed).backward();
                f64::from(
                    leaf.grad(&gradients)
                        .expect("a gradient")
                        .into_scalar::<f32>(),
                )
            }
            Some(step) => {
                let at = |x: f64| {
                    let x = Tensor::<1>::from_floats([x as f32], &device);
                    f64::from(loss(&x, seed).into_scalar::<f32>())
                };
                (at(step) - at(-step)) / (2.0 * step)
            }
        };
        estimate(0);
        let (mut values, mut times) = (Vec::new(), Vec::new());
        for seed in 0..self.seeds {
            let start = Instant::now();
            values.push(estimate(100 + seed));
            times.push(start.elapsed().as_secs_f64());
        }
        let (mean, deviation) = mean_and_deviation(&values);
        let n = values.len() as f64;
        times.sort_by(f64::total_cmp);
        let time = times[times.len() / 2];
        let e = exact.abs();
        println!(
            "{:?} softray {visibility:?} spp {}: mean/ref {:.4} ± {:.4}  sd/ref {:.4}  time {time:.4} s  \
             sd*sqrt(time)/ref {:.5}",
            case,
            self.spp,
            mean / exact,
            deviation / n.sqrt() / e,
            deviation / e,
            deviation * time.sqrt() / e,
        );
    }
}

/// The vertices as the case moves them.
fn moved(case: Case, vertices: &Tensor<2>, x: &Tensor<1>, centre: [f64; 3]) -> Tensor<2> {
    let device = Device::flex();
    let zero = Tensor::<1>::zeros([1], &device);
    let offset = |parts: Vec<Tensor<1>>| Tensor::cat(parts, 0).reshape([1, 3]);
    match case {
        Case::OccluderX => vertices.clone() + offset(vec![x.clone(), zero.clone(), zero]),
        Case::BallZ => vertices.clone() + offset(vec![zero.clone(), zero, x.clone()]),
        Case::TallTurn => {
            let centre = centre.map(|c| c as f32);
            let centre = Tensor::<1>::from_floats(centre, &device).reshape([1, 3]);
            let turn = Transform::new().axis_angle([0.0, 1.0, 0.0], x.clone());
            turn.apply(vertices.clone() - centre.clone()) + centre
        }
    }
}
