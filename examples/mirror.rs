//! Recovers the position of an object that is visible only as a reflection in a glossy wall.

pub(crate) mod common;

use burn::module::{Module, Param};
use burn::optim::AdamConfig;
use clap::Parser;
use softray::optim::{BlurSchedule, Evaluation, Rate, Step};
use softray::prelude::*;

use common::study::{Arguments, Failure, Goal, Outcome, Problem, Study, distance, numbers};

#[derive(Module, Debug)]
pub(crate) struct Hidden {
    /// Offset along the mirror from the target's position `[2]`, in scene units.
    offset: Param<Tensor<1>>,
}

const START: [f64; 2] = [0.7, 0.35];

/// A glossy wall in front of the camera, and a bright icosahedron behind the camera, outside its view.
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
        .with_object(
            Object::new(mirror)
                .with_name("mirror")
                .with_material(Material::phong([0.02, 0.02, 0.02], [0.9, 0.9, 0.9], 1500.0)),
        )
        .with_object(
            Object::new(body)
                .with_name("hidden")
                .with_material(Material::diffuse([0.1, 0.1, 0.1]).with_emission([1.2, 0.9, 0.5])),
        )
        .with_environment([0.05, 0.06, 0.08])
}

pub(crate) struct Mirror {
    device: Device,
    goal: Goal,
}

impl Mirror {
    pub(crate) fn new(size: usize, device: &Device) -> Result<Self, Failure> {
        let camera = Camera::look_at([0.0, 0.0, 2.6], [0.0, 0.0, 0.0]).with_fov_y(55.0);
        let still = scene(Tensor::zeros([2], device), device);
        Ok(Self {
            device: device.clone(),
            goal: Goal::new(still, camera, (size, 1), 1024)?,
        })
    }

    fn at(&self, [x, y]: [f64; 2]) -> softray::Result<HostImage> {
        let offset = Tensor::from_floats([x, y], &self.device);
        self.goal.picture(&scene(offset, &self.device))
    }
}

impl Problem for Mirror {
    type Module = Hidden;

    fn start(&self, distance: f64) -> Hidden {
        let share = distance / START[0].hypot(START[1]);
        let offset = Tensor::from_floats(START.map(|x| share * x), &self.device);
        Hidden {
            offset: Param::from_tensor(offset.autodiff()),
        }
    }

    fn error(&self, hidden: &Hidden) -> f64 {
        distance(&numbers(&hidden.offset.val()), &[0.0; 2])
    }

    fn pixel(&self) -> softray::Result<f64> {
        self.goal.pixel()
    }

    fn evaluate(&self, hidden: &Hidden, step: &Step) -> softray::Result<Evaluation> {
        let scene = scene(hidden.offset.val(), &self.device);
        let at = numbers(&hidden.offset.val());
        let evaluation = self.goal.compare(&scene, step, None, 4)?;
        Ok(evaluation
            .with_value("x", at[0])
            .with_value("y", at[1])
            .with_value("distance", self.error(hidden)))
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<Outcome, Failure> {
    let device = arguments.device()?;
    let size = arguments.either(32, 64);
    let mirror = Mirror::new(size, &device)?;
    let study = Study::new(
        "mirror",
        "A place from a reflection",
        arguments,
        arguments.either(120, 240),
    );
    let far = START[0].hypot(START[1]);
    let (still, camera) = (&mirror.goal.scene, &mirror.goal.camera);
    let fitted = study
        .fit(
            mirror.start(far),
            AdamConfig::new().with_beta_2(0.99).init(),
        )
        .with_rate(Rate::cosine(0.03))
        .with_blur(BlurSchedule::auto(still, camera, size, study.steps())?)
        .run(|hidden: &Hidden, step: &_| mirror.evaluate(hidden, step))?;

    let found = numbers(&fitted.module.offset.val());
    let images = [
        ("initial", mirror.at(START)?),
        ("target", mirror.at([0.0; 2])?),
        ("final", mirror.at([found[0], found[1]])?),
    ];
    let plots = vec![
        fitted.history.plot("offset", &["x", "y"])?,
        fitted
            .history
            .plot("distance to the target", &["distance"])?
            .with_log_scale(),
    ];
    let outcome = Outcome {
        errors: [far, mirror.error(&fitted.module)],
        of: "distance to the target, scene units".into(),
        others: Vec::new(),
    };
    study.finish(&fitted, images, plots, outcome)
}

fn main() -> Result<(), Failure> {
    common::log();
    run(&Arguments::parse())?;
    Ok(())
}
