//! Recovers albedo, specular albedo and shininess of a ball from one image under two lights.

pub(crate) mod common;

use burn::module::{Module, Param};
use burn::optim::AdamConfig;
use burn::tensor::activation::sigmoid;
use clap::Parser;
use softray::optim::{Evaluation, Fitted, Rate, Residual, loss};
use softray::prelude::*;

use common::study::{Arguments, Failure, Outcome, Study, distance, numbers, picture};

#[derive(Module, Debug)]
struct Surface {
    /// A logistic function maps them to k_d and k_s in (0, 1).
    diffuse: Param<Tensor<1>>,
    specular: Param<Tensor<1>>,
    /// The logarithm of the Phong exponent.
    shininess: Param<Tensor<1>>,
}

/// k_d, k_s and the logarithm of the exponent.
const TARGET: [f64; 7] = [0.55, 0.2, 0.1, 0.25, 0.3, 0.35, 3.9];
const START: [f64; 7] = [0.3, 0.3, 0.3, 0.1, 0.1, 0.1, 2.3];

fn scene(diffuse: Tensor<1>, specular: Tensor<1>, exponent: Tensor<1>, device: &Device) -> Scene {
    let sphere = shapes::icosphere(3, device);
    let normals = sphere.vertices.clone();
    let ball = sphere.with_normals(normals);
    let light = |x: f64, strength: f64| {
        let corners = [
            [x - 0.7, 3.0, 2.0],
            [x + 0.7, 3.0, 2.0],
            [x + 0.7, 3.6, 1.0],
            [x - 0.7, 3.6, 1.0],
        ];
        // Facing down and away from the camera, towards the ball.
        let [a, b, c, d] = corners;
        Object::new(shapes::quad(d, c, b, a, device))
            .with_material(Material::emitter([strength, strength, strength]))
    };
    Scene::new()
        .with_object(Object::new(ball).with_material(Material::phong(diffuse, specular, exponent)))
        .with_object(light(-1.8, 9.0))
        .with_object(light(1.8, 6.0))
        .with_environment([0.15, 0.15, 0.15])
}

fn logits(albedo: &[f64]) -> Vec<f64> {
    albedo.iter().map(|a| (a / (1.0 - a)).ln()).collect()
}

/// Returns k_d, k_s and the logarithm of the exponent.
fn all(s: &Surface) -> Vec<f64> {
    let (diffuse, specular) = (sigmoid(s.diffuse.val()), sigmoid(s.specular.val()));
    [diffuse, specular, s.shininess.val()]
        .map(|t| numbers(&t))
        .concat()
}

/// Fits the surface to the target.
fn fit(
    study: &Study,
    module: Surface,
    camera: &Camera,
    options: &RenderOptions,
    target: &Tensor<3>,
) -> softray::Result<Fitted<Surface>> {
    let device = target.device();
    let of_module = |surface: &Surface| {
        scene(
            sigmoid(surface.diffuse.val()),
            sigmoid(surface.specular.val()),
            surface.shininess.val().exp(),
            &device,
        )
    };
    let values = |surface: &Surface| {
        let all = all(surface);
        [
            ("diffuse", distance(&all[..3], &TARGET[..3])),
            ("specular", distance(&all[3..6], &TARGET[3..6])),
            ("ln shininess", (all[6] - TARGET[6]).abs()),
        ]
    };
    if study.by_least_squares() {
        study.least_squares(module).run(|surface, _| {
            let options = options.clone().with_samples(32);
            let scene = of_module(surface);
            let residual = Residual::new(scene, camera.clone(), options, target.clone());
            let with_value = |all: Residual, (name, value)| all.with_value(name, value);
            Ok(vec![values(surface).into_iter().fold(residual, with_value)])
        })
    } else {
        study
            .fit(module, AdamConfig::new().with_beta_2(0.99).init())
            .with_rate(Rate::cosine(0.06))
            .run(|surface: &Surface, step: &_| {
                let scene = of_module(surface);
                let few = options.clone().with_samples(8);
                let see = |k| render(&scene, camera, &step.options(&few, k));
                let (a, b) = (see(0)?.radiance, see(1)?.radiance);
                let loss = loss::mse_unbiased(a.clone(), b, target.clone())?;
                let evaluation = Evaluation::new(loss)
                    .with_image("render", a)
                    .with_target("render", target.clone());
                let with_value = |all: Evaluation, (name, value)| all.with_value(name, value);
                Ok(values(surface).into_iter().fold(evaluation, with_value))
            })
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<Outcome, Failure> {
    let device = arguments.device()?;
    let camera = Camera::look_at([0.0, 0.8, 4.0], [0.0, 0.0, 0.0]).with_fov_y(36.0);
    let size = arguments.either(32, 64);
    let options = RenderOptions::new(size, size).with_bounces(0);
    let fixed = |v: &[f64]| {
        let three = |v: &[f64]| Tensor::from_floats([v[0], v[1], v[2]], &device);
        let exponent = Tensor::from_floats([v[6].exp()], &device);
        scene(three(&v[..3]), three(&v[3..6]), exponent, &device)
    };
    let still = fixed(&TARGET);
    let sharp = options.clone().with_samples(2048).with_seed(1 << 50);
    let target = render(&still, &camera, &sharp)?.radiance;

    let study = Study::new(
        "material",
        "Albedo, gloss and shininess",
        arguments,
        arguments.either(250, 400),
    );
    let leaf = |v: &[f64]| {
        let values: Vec<f32> = v.iter().map(|&x| x as f32).collect();
        let tensor = Tensor::<1>::from_floats(values.as_slice(), &device.clone().autodiff());
        Param::from_tensor(tensor)
    };
    let module = Surface {
        diffuse: leaf(&logits(&START[..3])),
        specular: leaf(&logits(&START[3..6])),
        shininess: leaf(&START[6..]),
    };
    let fitted = fit(&study, module, &camera, &options, &target)?;

    let found = all(&fitted.module);
    let images = [
        ("initial", picture(&fixed(&START), &camera, &sharp)?),
        ("target", picture(&still, &camera, &sharp)?),
        ("final", picture(&fixed(&found), &camera, &sharp)?),
    ];
    let plots = vec![
        fitted
            .history
            .plot(
                "distances to the target's",
                &["diffuse", "specular", "ln shininess"],
            )?
            .with_log_scale(),
    ];
    let outcome = Outcome {
        errors: [distance(&START, &TARGET), distance(&found, &TARGET)],
        of: "distance of k_d, k_s and ln of the exponent together".into(),
        others: vec![("exponent (target 49.4)".into(), found[6].exp())],
    };
    study.finish(&fitted, images, plots, outcome)
}

fn main() -> Result<(), Failure> {
    common::log();
    run(&Arguments::parse())?;
    Ok(())
}
