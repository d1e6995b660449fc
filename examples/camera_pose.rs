//! Recovers the position of the camera and the point it looks at from one image.

pub(crate) mod common;

use burn::module::{Module, Param};
use burn::optim::AdamConfig;
use clap::Parser;
use softray::optim::{BlurSchedule, Evaluation, Rate, Residual, Step, loss, pixel_angle};
use softray::prelude::*;

use common::study::{Arguments, Failure, Outcome, Problem, Study, distance, numbers, picture};

#[derive(Module, Debug)]
pub(crate) struct Pose {
    /// The position, in scene units.
    eye: Param<Tensor<1>>,
    /// The point that the camera looks at, in scene units.
    target: Param<Tensor<1>>,
}

const EYE: [f64; 3] = [1.2, 1.5, 4.0];
const TARGET: [f64; 3] = [0.0, 0.5, 0.0];
const START_EYE: [f64; 3] = [2.0, 1.1, 4.5];
const START_TARGET: [f64; 3] = [0.3, 0.75, 0.0];

/// Blocks of several colors on a floor.
fn scene(device: &Device) -> Scene {
    let block = |size: [f64; 3], place: [f64; 3], degrees: f64, color: [f64; 3]| {
        let pose = Transform::new()
            .with_scale(Tensor::from_floats(size.map(|s| 0.5 * s), device))
            .with_axis_angle([0.0, 1.0, 0.0], Tensor::from_floats([degrees], device))
            .with_translation(Tensor::from_floats(place, device));
        Object::new(shapes::cube(device).transformed(&pose)).with_material(Material::diffuse(color))
    };
    let floor = shapes::quad(
        [-2.0, 0.0, 2.0],
        [2.0, 0.0, 2.0],
        [2.0, 0.0, -2.0],
        [-2.0, 0.0, -2.0],
        device,
    );
    Scene::new()
        .with_object(Object::new(floor).with_material(Material::diffuse([0.35, 0.35, 0.4])))
        .with_object(block(
            [0.8, 1.2, 0.8],
            [-0.7, 0.6, -0.3],
            25.0,
            [0.8, 0.25, 0.2],
        ))
        .with_object(block(
            [0.7, 0.7, 0.7],
            [0.6, 0.35, 0.4],
            -15.0,
            [0.2, 0.6, 0.3],
        ))
        .with_object(block(
            [1.4, 0.3, 0.4],
            [0.3, 0.15, -1.0],
            10.0,
            [0.85, 0.7, 0.2],
        ))
        .with_object(Object::new(ball(device)).with_material(Material::diffuse([0.2, 0.35, 0.8])))
        .with_environment([0.9, 0.95, 1.0])
}

/// Returns the point on the view axis at the distance of the target. All points on this axis give the same camera.
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

/// The scene and its target image.
pub(crate) struct Posed {
    size: usize,
    device: Device,
    scene: Scene,
    options: RenderOptions,
    sharp: RenderOptions,
    target: Tensor<3>,
}

fn camera(eye: Tensor<1>, target: Tensor<1>) -> Camera {
    Camera::look_at(eye, target).with_fov_y(38.0)
}

impl Posed {
    pub(crate) fn new(size: usize, device: &Device) -> Result<Self, Failure> {
        let scene = scene(device);
        let options = RenderOptions::new(size, size).with_bounces(0);
        let goal = Camera::look_at(EYE, TARGET).with_fov_y(38.0);
        let sharp = options.clone().with_samples(1024).with_seed(1 << 50);
        let target = render(&scene, &goal, &sharp)?.radiance;
        Ok(Self {
            size,
            device: device.clone(),
            scene,
            options,
            sharp,
            target,
        })
    }

    fn at(&self, both: &[f64]) -> softray::Result<HostImage> {
        let tensor = |v: &[f64]| Tensor::from_floats([v[0], v[1], v[2]], &self.device);
        let camera = camera(tensor(&both[..3]), tensor(&both[3..]));
        picture(&self.scene, &camera, &self.sharp)
    }

    fn goal(&self) -> Camera {
        Camera::look_at(EYE, TARGET).with_fov_y(38.0)
    }
}

fn both(pose: &Pose) -> Vec<f64> {
    [numbers(&pose.eye.val()), aim(pose)].concat()
}

impl Problem for Posed {
    type Module = Pose;

    fn start(&self, distance: f64) -> Pose {
        let (start, goal) = ([START_EYE, START_TARGET].concat(), [EYE, TARGET].concat());
        let share = distance / far(&start);
        let at = |i: usize| goal[i] + share * (start[i] - goal[i]);
        let leaf = |first: usize| {
            let place = Tensor::from_floats([0, 1, 2].map(|i| at(first + i)), &self.device);
            Param::from_tensor(place.autodiff())
        };
        Pose {
            eye: leaf(0),
            target: leaf(3),
        }
    }

    fn error(&self, pose: &Pose) -> f64 {
        far(&both(pose))
    }

    fn pixel(&self) -> softray::Result<f64> {
        pixel_angle(&self.goal(), self.size)
    }

    fn evaluate(&self, pose: &Pose, step: &Step) -> softray::Result<Evaluation> {
        let camera = camera(pose.eye.val(), pose.target.val());
        let few = self.options.clone().with_samples(8);
        let see = |k| render(&self.scene, &camera, &step.options(&few, k));
        let (a, b) = (see(0)?.radiance, see(1)?.radiance);
        let loss = loss::multi_scale_unbiased(a.clone(), b, self.target.clone(), LEVELS)?;
        Ok(Evaluation::new(loss)
            .with_value("eye", distance(&numbers(&pose.eye.val()), &EYE))
            .with_value("target", distance(&aim(pose), &TARGET))
            .with_image("render", a)
            .with_target("render", self.target.clone()))
    }
}

impl Posed {
    /// Returns the view of a step for a fit by least squares.
    fn residual(&self, pose: &Pose, step: &Step) -> softray::Result<Residual> {
        let options = step.options(&self.options.clone().with_samples(16), 0);
        let camera = camera(pose.eye.val(), pose.target.val());
        let target = self.target.clone();
        Ok(Residual::new(self.scene.clone(), camera, options, target)
            .with_levels(LEVELS)
            .with_value("eye", distance(&numbers(&pose.eye.val()), &EYE))
            .with_value("target", distance(&aim(pose), &TARGET)))
    }
}

/// The levels of the pyramids that are compared.
const LEVELS: usize = 4;

/// Returns the distance of eye and target together from the true ones.
fn far(both: &[f64]) -> f64 {
    distance(both, &[EYE, TARGET].concat())
}

pub(crate) fn run(arguments: &Arguments) -> Result<Outcome, Failure> {
    let device = arguments.device()?;
    let size = arguments.either(40, 64);
    let posed = Posed::new(size, &device)?;
    let study = Study::new(
        "camera_pose",
        "The pose of a camera",
        arguments,
        arguments.either(250, 400),
    );
    let start = [START_EYE, START_TARGET].concat();
    let schedule = BlurSchedule::auto(&posed.scene, &posed.goal(), size, study.steps())?;
    let module = posed.start(far(&start));
    let fitted = if study.by_least_squares() {
        let fit = study.least_squares(module).with_blur(schedule);
        fit.run(|pose, step| Ok(vec![posed.residual(pose, step)?]))?
    } else {
        study
            .fit(module, AdamConfig::new().with_beta_2(0.99).init())
            .with_rate(Rate::cosine(0.03))
            .with_blur(schedule)
            .run(|pose: &Pose, step: &_| posed.evaluate(pose, step))?
    };

    let found = both(&fitted.module);
    let images = [
        ("initial", posed.at(&start)?),
        ("target", posed.at(&[EYE, TARGET].concat())?),
        ("final", posed.at(&found)?),
    ];
    let plots = vec![
        fitted
            .history
            .plot("distances, scene units", &["eye", "target"])?
            .with_log_scale(),
    ];
    let outcome = Outcome {
        errors: [far(&start), far(&found)],
        of: "distance of eye and target together, scene units".into(),
        others: Vec::new(),
    };
    study.finish(&fitted, images, plots, outcome)
}

fn main() -> Result<(), Failure> {
    common::log();
    run(&Arguments::parse())?;
    Ok(())
}
