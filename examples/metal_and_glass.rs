//! Gold and glass under a lamp and a sky, and a fit of their roughness from one image.

pub(crate) mod common;

use burn::module::{Module, Param};
use burn::optim::AdamConfig;
use burn::tensor::TensorData;
use burn::tensor::activation::sigmoid;
use clap::Parser;
use softray::optim::{Evaluation, Rate, loss};
use softray::prelude::*;

use common::study::{Arguments, Failure, Outcome, Study, distance, numbers, picture};

/// The index of refraction of gold in red, green and blue light: η and k.
const GOLD: [[f64; 3]; 2] = [[0.143, 0.375, 1.442], [3.983, 2.386, 1.603]];
/// The roughness of the gold and the glass.
const TARGET: [f64; 2] = [0.2, 0.1];
const START: [f64; 2] = [0.5, 0.4];

#[derive(Module, Debug)]
struct Surfaces {
    /// ln(r/(1 − r)) with each roughness r.
    roughness: Param<Tensor<1>>,
}

/// A sky with a bright horizon and a soft sun, `[H, W, 3]`.
fn sky(device: &Device) -> Tensor<3> {
    let (rows, columns) = (32, 64);
    let texel = |i: usize| {
        let height = ((i / columns) as f64 + 0.5) / rows as f64;
        let turn = ((i % columns) as f64 + 0.5) / columns as f64;
        let up = (std::f64::consts::PI * height).cos();
        let sun = (-40.0 * ((height - 0.3).powi(2) + (turn - 0.75).powi(2))).exp();
        let haze = (-4.0 * up.abs()).exp();
        let blue = [0.12, 0.22, 0.45].map(|c| if up > 0.0 { c } else { 0.4 * c });
        let warm = [1.0, 0.8, 0.55];
        std::array::from_fn::<f64, 3, _>(|c| blue[c] + warm[c] * (0.45 * haze + 2.5 * sun))
    };
    let texels: Vec<f64> = (0..rows * columns).flat_map(texel).collect();
    Tensor::from_data(TensorData::new(texels, [rows, columns, 3]), device)
}

/// A checkerboard of two colors.
fn squares(device: &Device) -> ColorTexture {
    let n = 64;
    let texel = |i: usize| match (i / n / 8 + i % n / 8) % 2 {
        0 => [0.55, 0.5, 0.45],
        _ => [0.12, 0.14, 0.18],
    };
    let texels: Vec<f64> = (0..n * n).flat_map(texel).collect();
    ColorTexture::texture(Tensor::from_data(
        TensorData::new(texels, [n, n, 3]),
        device,
    ))
}

fn scene(roughness: &Tensor<1>, device: &Device) -> Scene {
    let part = |i: usize| roughness.clone().slice(i..i + 1);
    let ball = |x: f64, z: f64| {
        let sphere = shapes::icosphere(4, device);
        let normals = sphere.vertices.clone();
        let ball = sphere.with_normals(normals).scaled(0.8);
        Object::new(ball.translated([x, 0.8, z]))
    };
    let lamp = shapes::quad(
        [-2.6, 3.6, -0.4],
        [-1.2, 3.6, -0.4],
        [-1.2, 3.6, 1.0],
        [-2.6, 3.6, 1.0],
        device,
    );
    let floor = Object::new(shapes::plane_grid(8.0, 8.0, 1, 1, device));
    Scene::new()
        .with_object(floor.with_material(Material::metallic_roughness(squares(device), 0.0, 0.35)))
        .with_object(ball(-0.95, 0.0).with_material(Material::conductor(GOLD[0], GOLD[1], part(0))))
        .with_object(ball(0.95, 0.35).with_material(Material::dielectric(1.5, part(1))))
        .with_object(Object::new(lamp).with_material(Material::emitter([14.0, 13.0, 11.0])))
        .with_environment(Environment::map(sky(device)))
}

pub(crate) fn run(arguments: &Arguments) -> Result<Outcome, Failure> {
    let device = arguments.device()?;
    let camera = Camera::look_at([0.3, 2.0, 5.2], [0.0, 0.65, 0.0]).with_fov_y(34.0);
    let at = |values: [f64; 2]| {
        let data = TensorData::new(values.to_vec(), [2]);
        Tensor::<1>::from_data(data, &device)
    };
    let fixed = |values: [f64; 2]| scene(&at(values), &device);
    let [width, height, samples] = arguments.either([96, 72, 16], [384, 288, 256]);
    let large = RenderOptions::new(width, height)
        .with_samples(samples as u32)
        .with_bounces(6);
    std::fs::create_dir_all(&arguments.out)?;
    let file = arguments.out.join("metal_and_glass_scene.png");
    picture(&fixed([0.15, 0.0]), &camera, &large)?.write(&file)?;
    println!("wrote {}", file.display());

    let [width, height] = arguments.either([32, 24], [64, 48]);
    let options = RenderOptions::new(width, height).with_bounces(4);
    let sharp = options.clone().with_samples(1024).with_seed(1 << 50);
    let still = fixed(TARGET);
    let target = render(&still, &camera, &sharp)?.radiance;
    let study = Study::new(
        "metal_and_glass",
        "Roughness of gold and of glass",
        arguments,
        arguments.either(120, 150),
    );
    let logits = START.map(|r| (r / (1.0 - r)).ln());
    let leaf = at(logits).autodiff();
    let module = Surfaces {
        roughness: Param::from_tensor(leaf),
    };
    let fitted = study
        .fit(module, AdamConfig::new().with_beta_2(0.99).init())
        .with_rate(Rate::cosine(0.08))
        .run(|surfaces: &Surfaces, step: &_| {
            let roughness = sigmoid(surfaces.roughness.val());
            let scene = scene(&roughness, &device);
            let few = options.clone().with_samples(arguments.either(16, 8));
            let see = |k| render(&scene, &camera, &step.options(&few, k));
            let (a, b) = (see(0)?.radiance, see(1)?.radiance);
            let loss = loss::mse_unbiased(a.clone(), b, target.clone())?;
            Ok(Evaluation::new(loss)
                .with_value("roughness", distance(&numbers(&roughness), &TARGET))
                .with_image("render", a)
                .with_target("render", target.clone()))
        })?;

    let found = numbers(&sigmoid(fitted.module.roughness.val()));
    let images = [
        ("initial", picture(&fixed(START), &camera, &sharp)?),
        ("target", picture(&still, &camera, &sharp)?),
        (
            "final",
            picture(&fixed([found[0], found[1]]), &camera, &sharp)?,
        ),
    ];
    let plot = fitted
        .history
        .plot("distance to the target's", &["roughness"])?
        .with_log_scale();
    let names = ["gold", "glass"];
    let others = names.iter().zip(&found).zip(TARGET);
    let outcome = Outcome {
        errors: [distance(&START, &TARGET), distance(&found, &TARGET)],
        of: "distance of the two roughnesses together".into(),
        others: others
            .map(|((name, &r), wanted)| (format!("{name} (target {wanted})"), r))
            .collect(),
    };
    study.finish(&fitted, images, vec![plot], outcome)
}

fn main() -> Result<(), Failure> {
    common::log();
    run(&Arguments::parse())?;
    Ok(())
}
