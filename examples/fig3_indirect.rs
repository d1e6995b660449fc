//! Figure 3 of the paper: recovers the rotation of a white cube from the light of a red and a green wall.
//! No emitter shines on the cube, so all its light has bounced. The blur decreases over the fit.

pub(crate) mod common;

use burn::module::{Module, Param};
use burn::optim::AdamConfig;
use clap::Parser;
use softray::optim::{BlurSchedule, Evaluation, Rate, Step};
use softray::prelude::*;

use common::study::{Arguments, Failure, Goal, Outcome, Problem, Study, numbers};

#[derive(Module, Debug)]
pub(crate) struct Turn {
    /// The angle from the target about the vertical axis, in radians: the epsilon of Adam is large beside gradients by degrees.
    angle: Param<Tensor<1>>,
}

const START: f64 = 30.0;
/// The rotation of the target cube, in degrees.
const TARGET: f64 = 20.0;

/// Walls to the left and right, a floor, and two emitters above the cube. Each emitter faces a wall.
fn scene(angle: &Tensor<1>, device: &Device) -> Scene {
    let quad = |corners: [[f64; 3]; 4]| {
        let [a, b, c, d] = corners;
        Object::new(shapes::quad(a, b, c, d, device))
    };
    let wall = |x: f64| {
        let corners = [[x, 0.0, 2.0], [x, 0.0, -2.0], [x, 3.0, -2.0], [x, 3.0, 2.0]];
        quad(corners)
    };
    // `towards` is −1 for a light that faces −x, the left wall, and 1 for +x.
    let light = |x: f64, towards: f64| {
        let z = 0.5 * towards;
        let corners = [[x, 1.6, z], [x, 1.6, -z], [x, 2.2, -z], [x, 2.2, z]];
        quad(corners).with_material(Material::emitter([14.0, 14.0, 14.0]))
    };
    let turned = angle.clone() * 1f64.to_degrees() + TARGET;
    let turn = Transform::new()
        .with_scale(Tensor::from_floats([0.5], device))
        .with_axis_angle([0.0, 1.0, 0.0], turned)
        .with_translation(Tensor::from_floats([0.0, 0.5, 0.0], device));
    let floor = quad([
        [-2.0, 0.0, 2.0],
        [2.0, 0.0, 2.0],
        [2.0, 0.0, -2.0],
        [-2.0, 0.0, -2.0],
    ]);
    Scene::new()
        .with_object(
            wall(-1.6)
                .with_name("red")
                .with_material(Material::diffuse([0.8, 0.05, 0.05])),
        )
        .with_object(
            wall(1.6)
                .with_name("green")
                .with_material(Material::diffuse([0.05, 0.8, 0.05])),
        )
        .with_object(
            floor
                .with_name("floor")
                .with_material(Material::diffuse([0.2, 0.2, 0.2])),
        )
        .with_object(light(-0.9, -1.0).with_name("light on red"))
        .with_object(light(0.9, 1.0).with_name("light on green"))
        .with_object(
            Object::new(shapes::cube(device).transformed(&turn))
                .with_name("cube")
                .with_material(Material::diffuse([0.85, 0.85, 0.85])),
        )
}

pub(crate) struct Indirect {
    device: Device,
    goal: Goal,
}

impl Indirect {
    pub(crate) fn new(size: usize, device: &Device) -> Result<Self, Failure> {
        let camera = Camera::look_at([0.0, 1.3, 3.6], [0.0, 0.6, 0.0]).with_fov_y(34.0);
        let still = scene(&Tensor::zeros([1], device), device);
        Ok(Self {
            device: device.clone(),
            goal: Goal::new(still, camera, (size, 1), 2048)?,
        })
    }
}

impl Problem for Indirect {
    type Module = Turn;

    /// `distance` is in degrees.
    fn start(&self, distance: f64) -> Turn {
        let angle = Tensor::from_floats([distance.to_radians()], &self.device);
        Turn {
            angle: Param::from_tensor(angle.autodiff()),
        }
    }

    fn error(&self, turn: &Turn) -> f64 {
        numbers(&turn.angle.val())[0].to_degrees().abs()
    }

    fn pixel(&self) -> softray::Result<f64> {
        self.goal.pixel()
    }

    fn evaluate(&self, turn: &Turn, step: &Step) -> softray::Result<Evaluation> {
        let scene = scene(&turn.angle.val(), &self.device);
        let degrees = numbers(&turn.angle.val())[0].to_degrees();
        let evaluation = self.goal.compare(&scene, step, None, 16)?;
        Ok(evaluation.with_value("degrees", degrees))
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<Outcome, Failure> {
    let device = arguments.device()?;
    let size = arguments.either(32, 64);
    let indirect = Indirect::new(size, &device)?;
    let study = Study::new(
        "fig3_indirect",
        "A rotation from indirect light",
        arguments,
        arguments.either(200, 300),
    );
    let (still, camera) = (&indirect.goal.scene, &indirect.goal.camera);
    let fitted = study
        .fit(
            indirect.start(START),
            AdamConfig::new().with_beta_2(0.99).init(),
        )
        .with_rate(Rate::cosine(0.02))
        .with_blur(BlurSchedule::auto(still, camera, size, study.steps())?)
        .run(|turn: &Turn, step: &_| indirect.evaluate(turn, step))?;

    let found = numbers(&fitted.module.angle.val())[0].to_degrees();
    let turned = |degrees: f64| {
        let angle = Tensor::from_floats([degrees.to_radians()], &device);
        indirect.goal.picture(&scene(&angle, &device))
    };
    let images = [
        ("initial", turned(START)?),
        ("target", turned(0.0)?),
        ("final", turned(found)?),
    ];
    let plots = vec![
        fitted
            .history
            .plot("angle to the target, °", &["degrees"])?,
        fitted.history.plot("blur, °", &["blur"])?.with_log_scale(),
    ];
    let outcome = Outcome {
        errors: [START, found.abs()],
        of: "angle to the target, °".into(),
        others: Vec::new(),
    };
    study.finish(&fitted, images, plots, outcome)
}

fn main() -> Result<(), Failure> {
    common::log();
    run(&Arguments::parse())?;
    Ok(())
}
