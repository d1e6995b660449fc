//! Recovers normal map and roughness of a hammered plate in a dark room from photographs with a lamp at several
//! places.

pub(crate) mod common;

use std::f64::consts::TAU;

use burn::module::{Module, Param};
use burn::optim::AdamConfig;
use burn::tensor::TensorData;
use burn::tensor::activation::sigmoid;
use clap::Parser;
use softray::modules::{NormalMapParams, NormalMapParamsConfig};
use softray::optim::{Evaluation, Rate};
use softray::prelude::*;

use common::study::{Arguments, Failure, Outcome, Study, numbers, picture};

/// Roughness of the plate and of the start of the fit.
const ROUGHNESS: [f64; 2] = [0.35, 0.7];
/// The number of photographs. Each has its own place of the lamp.
const PHOTOGRAPHS: usize = 6;

#[derive(Module, Debug)]
struct Plate {
    relief: NormalMapParams,
    /// ln(r/(1 − r)) with the roughness r, `[1]`.
    roughness: Param<Tensor<1>>,
}

impl Plate {
    fn roughness(&self) -> Tensor<1> {
        sigmoid(self.roughness.val())
    }
}

/// Returns the normal map of hammer dents, `[n, n, 3]`, with unit normals.
fn hammered(n: usize, device: &Device) -> Tensor<3> {
    let texel = |i: usize| {
        let (u, v) = ((i % n) as f64 / n as f64, (i / n) as f64 / n as f64);
        let mut slope = [0.0; 2];
        for k in 0..14 {
            let turn = f64::from(k) * 0.618_034;
            let (x, y) = (turn.fract(), (f64::from(k) + 0.5) / 14.0);
            let (dx, dy) = (u - x, v - y);
            let dent = (-(dx * dx + dy * dy) / (2.0 * 0.07 * 0.07)).exp();
            slope[0] -= 8.0 * dx * dent;
            slope[1] -= 8.0 * dy * dent;
        }
        let length = (slope[0].powi(2) + slope[1].powi(2) + 1.0).sqrt();
        [slope[0] / length, slope[1] / length, 1.0 / length]
    };
    let texels: Vec<f64> = (0..n * n).flat_map(texel).collect();
    Tensor::from_data(TensorData::new(texels, [n, n, 3]), device)
}

/// The plate under the lamp of a photograph.
fn scene(texels: &Tensor<3>, roughness: &Tensor<1>, photograph: usize, device: &Device) -> Scene {
    let turn = TAU * photograph as f64 / PHOTOGRAPHS as f64;
    let lamp = Light::point([1.5 * turn.cos(), 1.6, 1.5 * turn.sin()], [7.0, 6.6, 6.0]);
    let copper = Material::metallic_roughness([0.8, 0.5, 0.35], 0.5, roughness.clone());
    let plate = Object::new(shapes::plane_grid(2.0, 2.0, 1, 1, device));
    Scene::new()
        .with_object(plate.with_material(copper.with_normal_map(texels.clone(), 1.0)))
        .with_light(lamp)
}

/// Returns the logarithm that the loss compares, so that highlights and dim parts have similar weight.
fn logarithm(image: Tensor<3>) -> Tensor<3> {
    image.add_scalar(0.03).log()
}

/// Returns the mean angle between the normals of two maps, in degrees.
fn angle(a: &Tensor<3>, b: &Tensor<3>) -> f64 {
    let cosines = numbers(&(a.clone().inner() * b.clone().inner()).sum_dim(2));
    let angles = cosines.iter().map(|c| c.min(1.0).acos().to_degrees());
    angles.sum::<f64>() / cosines.len() as f64
}

pub(crate) fn run(arguments: &Arguments) -> Result<Outcome, Failure> {
    let device = arguments.device()?;
    let camera = Camera::look_at([0.0, 4.0, 1.2], [0.0; 3]).with_fov_y(27.0);
    let (n, size) = arguments.either((16, 48), (24, 96));
    let options = RenderOptions::new(size, size).with_bounces(0);
    let sharp = options.clone().with_samples(256).with_seed(1 << 50);
    let one = |r: f64| Tensor::<1>::from_floats([r], &device);
    let (relief, [roughness, start]) = (hammered(n, &device), ROUGHNESS.map(one));
    let photograph = |k| render(&scene(&relief, &roughness, k, &device), &camera, &sharp);
    let photographs: Vec<_> = (0..PHOTOGRAPHS)
        .map(|k| Ok(photograph(k)?.radiance))
        .collect::<softray::Result<_>>()?;

    let study = Study::new(
        "relief",
        "Normal map and roughness of a hammered plate",
        arguments,
        arguments.either(120, 250),
    );
    let plate = Plate {
        relief: NormalMapParamsConfig::new(n, n).init(&device.clone().autodiff())?,
        roughness: Param::from_tensor(one((ROUGHNESS[1] / (1.0 - ROUGHNESS[1])).ln()).autodiff()),
    };
    let flat = plate.relief.texels();
    let fitted = study
        .fit(plate, AdamConfig::new().with_beta_2(0.99).init())
        .with_rate(Rate::cosine(0.05))
        .run(|plate: &Plate, step: &_| {
            let (texels, roughness) = (plate.relief.texels(), plate.roughness());
            let few = options.clone().with_samples(8);
            // Each step uses half of the photographs.
            let of_step = (step.index % 2..PHOTOGRAPHS).step_by(2);
            let seen = of_step.map(|k| {
                let scene = scene(&texels, &roughness, k, &device);
                let image = render(&scene, &camera, &step.options(&few, 0))?.radiance;
                let target = photographs[k].clone();
                let difference = logarithm(image.clone()) - logarithm(target.clone());
                Ok((difference.powi_scalar(2).mean(), image, target))
            });
            let seen: Vec<_> = seen.collect::<softray::Result<_>>()?;
            let losses = seen.iter().map(|(loss, _, _)| loss.clone()).collect();
            let (_, image, target) = seen[0].clone();
            Ok(Evaluation::new(Tensor::cat(losses, 0).mean())
                .with_value("angle", angle(&texels, &relief))
                .with_image("render", image)
                .with_target("render", target))
        })?;

    let found = fitted.module.relief.texels().inner();
    let r = fitted.module.roughness().inner();
    let see = |texels, r| picture(&scene(texels, r, 0, &device), &camera, &sharp);
    let images = [
        ("initial", see(&flat.clone().inner(), &start)?),
        ("target", see(&relief, &roughness)?),
        ("final", see(&found, &r)?),
    ];
    let plot = fitted
        .history
        .plot("mean angle to the plate's normals, °", &["angle"])?
        .with_log_scale();
    let outcome = Outcome {
        errors: [angle(&flat, &relief), angle(&found, &relief)],
        of: "mean angle between normals, degrees".into(),
        others: vec![(
            format!(
                "roughness (target {}, start {})",
                ROUGHNESS[0], ROUGHNESS[1]
            ),
            numbers(&r)[0],
        )],
    };
    study.finish(&fitted, images, vec![plot], outcome)
}

fn main() -> Result<(), Failure> {
    common::log();
    run(&Arguments::parse())?;
    Ok(())
}
