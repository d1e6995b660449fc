//! Figure 2 of the paper: recovers the position of an occluder outside the view from its shadow alone. With
//! `--least-squares` it takes a fraction of the time, but arrives with about half of the seeds only.

pub(crate) mod common;

use burn::module::{Module, Param};
use burn::optim::AdamConfig;
use clap::Parser;
use softray::optim::{BlurSchedule, Evaluation, Rate, Residual, Step};
use softray::prelude::*;

use common::study::{Arguments, Failure, Goal, Outcome, Problem, Study, distance, numbers};

#[derive(Module, Debug)]
pub(crate) struct Caster {
    /// Offset from the target's position, in scene units.
    offset: Param<Tensor<1>>,
}

/// The start of the fit. The shadow lies outside the image, except for the part that the widest cones blur into it.
const START: [f64; 3] = [2.0, 0.0, 0.0];

pub(crate) struct Shadow {
    device: Device,
    goal: Goal,
}

impl Shadow {
    pub(crate) fn new(size: usize, device: &Device) -> Result<Self, Failure> {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/shadow/scene.json");
        let file = SceneFile::load(path, device)?;
        Ok(Self {
            device: device.clone(),
            goal: Goal::new(file.scene, file.camera, (size, 0), 1024)?,
        })
    }

    /// Returns the numbers that the history keeps.
    fn values(&self, caster: &Caster) -> impl Iterator<Item = (&'static str, f64)> {
        let mut at = numbers(&caster.offset.val());
        at.push(self.error(caster));
        ["x", "y", "z", "distance"].into_iter().zip(at)
    }

    /// Returns the view of a step for a fit by least squares.
    fn residual(&self, caster: &Caster, step: &Step) -> softray::Result<Residual> {
        let goal = &self.goal;
        let mut options = step.options(&goal.options.clone().with_samples(32), 0);
        options = options.with_visibility(visibility(step));
        options.blur = None;
        let scene = self.scene(caster.offset.val())?;
        let residual = Residual::new(scene, goal.camera.clone(), options, goal.image.clone());
        let values = self.values(caster);
        Ok(values.fold(residual, |all, (name, value)| all.with_value(name, value)))
    }

    fn scene(&self, offset: Tensor<1>) -> softray::Result<Scene> {
        let moved = |o: Object| o.map_mesh(|m| m.translated(offset.clone()));
        self.goal.scene.clone().map_object("occluder", moved)
    }
}

/// Returns the visibility of a step, which blurs the shadow, not the view.
fn visibility(step: &Step) -> Visibility {
    let angle = step.blur().unwrap_or(0.0);
    Visibility::Cone { angle, pixels: 0.5 }
}

impl Problem for Shadow {
    type Module = Caster;

    fn start(&self, distance: f64) -> Caster {
        let offset = Tensor::from_floats([distance, 0.0, 0.0], &self.device);
        Caster {
            offset: Param::from_tensor(offset.autodiff()),
        }
    }

    fn error(&self, caster: &Caster) -> f64 {
        distance(&numbers(&caster.offset.val()), &[0.0; 3])
    }

    fn pixel(&self) -> softray::Result<f64> {
        self.goal.pixel()
    }

    fn evaluate(&self, caster: &Caster, step: &Step) -> softray::Result<Evaluation> {
        let scene = self.scene(caster.offset.val())?;
        let seen = Some(visibility(step));
        let evaluation = self.goal.compare(&scene, step, seen, 8)?;
        let values = self.values(caster);
        Ok(values.fold(evaluation, |all, (name, value)| all.with_value(name, value)))
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<Outcome, Failure> {
    let device = arguments.device()?;
    let shadow = Shadow::new(arguments.either(32, 64), &device)?;
    let study = Study::new(
        "fig2_shadow",
        "A place from its shadow alone",
        arguments,
        arguments.either(240, 400),
    );
    let start = shadow.start(START[0]);
    let schedule = BlurSchedule::decay(66.0, 1.0, study.steps() * 2 / 3)?;
    let fitted = if study.by_least_squares() {
        let fit = study.least_squares(start).with_blur(schedule);
        fit.run(|caster, step| Ok(vec![shadow.residual(caster, step)?]))?
    } else {
        study
            .fit(start, AdamConfig::new().with_beta_2(0.99).init())
            .with_rate(Rate::exponential(0.06, 0.006))
            .with_blur(schedule)
            .run(|caster: &Caster, step: &_| shadow.evaluate(caster, step))?
    };

    let found = numbers(&fitted.module.offset.val());
    let place = |at: &[f64]| {
        let offset = Tensor::from_floats([at[0], at[1], at[2]], &device);
        shadow.goal.picture(&shadow.scene(offset)?)
    };
    let images = [
        ("initial", place(&START)?),
        ("target", place(&[0.0; 3])?),
        ("final", place(&found)?),
    ];
    let plots = vec![
        fitted.history.plot("offset", &["x", "y", "z"])?,
        fitted
            .history
            .plot("distance to the target", &["distance"])?
            .with_log_scale(),
    ];
    let outcome = Outcome {
        errors: [START[0], shadow.error(&fitted.module)],
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
