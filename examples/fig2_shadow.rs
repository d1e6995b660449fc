//! Figure 2 of the paper: the caster is out of view, and its place is found from its shadow alone.

pub(crate) mod common;

use burn::module::{Module, Param};
use burn::optim::AdamConfig;
use clap::Parser;
use softray::optim::{BlurSchedule, Evaluation, Rate, Step, loss, pixel_footprint};
use softray::prelude::*;

use common::study::{
    Arguments, Failure, Outcome, Problem, Study, curves, distance, numbers, picture,
};

#[derive(Module, Debug)]
pub(crate) struct Caster {
    /// Offset from the target's place, scene units.
    offset: Param<Tensor<1>>,
}

/// Where the fit starts: the two shadows do not touch.
const START: [f64; 3] = [1.2, 0.0, 0.0];

/// The scene, and the image of it that is to be met.
pub(crate) struct Shadow {
    size: usize,
    file: SceneFile,
    device: Device,
    options: RenderOptions,
    sharp: RenderOptions,
    target: Tensor<3>,
}

impl Shadow {
    pub(crate) fn new(size: usize, device: &Device) -> Result<Self, Failure> {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/shadow/scene.json");
        let file = SceneFile::load(path, device)?;
        let options = RenderOptions::new(size, size).bounces(0);
        let sharp = BlurSchedule::sharp_sigma(&file.scene, &file.camera, size)?;
        let sharp = options.clone().samples(1024).sigma(sharp).seed(1 << 50);
        let target = render(&file.scene, &file.camera, &sharp)?.radiance;
        Ok(Self {
            size,
            file,
            device: device.clone(),
            options,
            sharp,
            target,
        })
    }

    fn scene(&self, offset: Tensor<1>) -> Scene {
        let moved = |o: Object| o.map_mesh(|m| m.translated(offset.clone()));
        self.file.scene.clone().map_object("occluder", moved)
    }
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

    fn footprint(&self) -> softray::Result<f64> {
        pixel_footprint(&self.file.scene, &self.file.camera, self.size)
    }

    fn evaluate(&self, caster: &Caster, step: &Step) -> softray::Result<Evaluation> {
        let scene = self.scene(caster.offset.val());
        let few = self.options.clone().samples(8);
        let see = |k| render(&scene, &self.file.camera, &step.options(&few, k));
        let (a, b) = (see(0)?.radiance, see(1)?.radiance);
        let loss = loss::mse_unbiased(a.clone(), b, self.target.clone());
        let at = numbers(&caster.offset.val());
        Ok(Evaluation::new(loss)
            .value("x", at[0])
            .value("y", at[1])
            .value("z", at[2])
            .value("distance", self.error(caster))
            .image("render", a))
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
    // Four footprints of the coarser image, a fifth of the caster's edge; a quarter of one in the end.
    let footprint = pixel_footprint(&shadow.file.scene, &shadow.file.camera, 32)?;
    let (wide, narrow) = ((4.0 * footprint).powi(2), (0.25 * footprint).powi(2));
    let fitted = study
        .fit(
            shadow.start(START[0]),
            AdamConfig::new().with_beta_2(0.99).init(),
        )
        .rate(Rate::exponential(0.06, 0.006))
        .sigma(BlurSchedule::decay(wide, narrow, study.steps() / 2)?)
        .run(|caster: &Caster, step: &_| shadow.evaluate(caster, step))?;

    let found = numbers(&fitted.module.offset.val());
    let place = |at: &[f64]| {
        let offset = Tensor::from_floats([at[0], at[1], at[2]], &device);
        picture(&shadow.scene(offset), &shadow.file.camera, &shadow.sharp)
    };
    let images = [
        ("initial", place(&START)?),
        ("target", place(&[0.0; 3])?),
        ("final", place(&found)?),
    ];
    let plots = vec![
        curves(&fitted.history, "offset", &["x", "y", "z"], false),
        curves(
            &fitted.history,
            "distance to the target",
            &["distance"],
            true,
        ),
    ];
    let outcome = Outcome {
        errors: [START[0], shadow.error(&fitted.module)],
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
