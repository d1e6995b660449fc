//! Figure 5 of the paper: recovers the aperture and the focus distance of a lens from an image out of focus.

pub(crate) mod common;

use burn::module::{Module, Param};
use burn::optim::AdamConfig;
use burn::tensor::TensorData;
use clap::Parser;
use softray::optim::{Evaluation, Fitted, Rate, Residual, loss};
use softray::prelude::*;

use common::study::{Arguments, Failure, Outcome, Study, distance, numbers, picture};

#[derive(Module, Debug)]
struct Lens {
    /// The logarithms of aperture radius and focus distance, both in scene units.
    logs: Param<Tensor<1>>,
}

/// Aperture radius and focus distance, in scene units.
const TARGET: [f64; 2] = [0.3, 4.0];
const START: [f64; 2] = [0.05, 5.5];

/// A row of balls that leads away from the camera.
fn scene(device: &Device) -> Scene {
    let colors = [
        [0.8, 0.25, 0.2],
        [0.8, 0.7, 0.2],
        [0.25, 0.7, 0.3],
        [0.2, 0.4, 0.8],
    ];
    let floor = shapes::quad(
        [-4.0, 0.0, 3.0],
        [4.0, 0.0, 3.0],
        [4.0, 0.0, -6.0],
        [-4.0, 0.0, -6.0],
        device,
    );
    // The checkerboard shows the focus at every distance.
    let squares: Vec<f32> = (0..40 * 40)
        .flat_map(|i| {
            [if (i % 40 + i / 40) % 2 == 0 {
                0.7
            } else {
                0.15
            }; 3]
        })
        .collect();
    let squares = Tensor::from_data(TensorData::new(squares, [40, 40, 3]), device);
    let mut scene = Scene::new()
        .with_object(
            Object::new(floor).with_material(Material::diffuse(ColorTexture::texture(squares))),
        )
        .with_environment([0.8, 0.85, 0.9]);
    for (i, color) in colors.into_iter().enumerate() {
        let i = i as f32;
        let center = Tensor::from_floats([-0.75 + 0.55 * i, 0.35, 1.6 - 1.5 * i], device);
        let ball = shapes::icosphere(2, device)
            .scaled(Tensor::from_floats([0.35], device))
            .translated(center);
        scene = scene.with_object(Object::new(ball).with_material(Material::diffuse(color)));
    }
    scene
}

/// Fits the lens of a camera to the target.
fn fit(
    study: &Study,
    module: Lens,
    scene: &Scene,
    camera: &impl Fn(Tensor<1>, Tensor<1>) -> Camera,
    options: &RenderOptions,
    target: &Tensor<3>,
) -> softray::Result<Fitted<Lens>> {
    let view = |lens: &Lens| {
        let both = lens.logs.val().exp();
        let camera = camera(both.clone().slice([0..1]), both.clone().slice([1..2]));
        (camera, numbers(&both))
    };
    if study.by_least_squares() {
        study.least_squares(module).run(|lens, _| {
            let (camera, both) = view(lens);
            let options = options.clone().with_samples(64);
            let residual = Residual::new(scene.clone(), camera, options, target.clone());
            Ok(vec![
                residual
                    .with_value("aperture", both[0])
                    .with_value("focus", both[1]),
            ])
        })
    } else {
        study
            .fit(module, AdamConfig::new().with_beta_2(0.99).init())
            .with_rate(Rate::cosine(0.03))
            .run(|lens: &Lens, step: &_| {
                let (camera, both) = view(lens);
                let few = options.clone().with_samples(16);
                let see = |k| render(scene, &camera, &step.options(&few, k));
                let (a, b) = (see(0)?.radiance, see(1)?.radiance);
                let loss = loss::mse_unbiased(a.clone(), b, target.clone())?;
                Ok(Evaluation::new(loss)
                    .with_value("aperture", both[0])
                    .with_value("focus", both[1])
                    .with_image("render", a)
                    .with_target("render", target.clone()))
            })
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<Outcome, Failure> {
    let device = arguments.device()?;
    let scene = scene(&device);
    let camera = |aperture: Tensor<1>, focus: Tensor<1>| {
        Camera::look_at([0.0, 0.9, 5.0], [0.0, 0.35, 0.0])
            .with_fov_y(32.0)
            .with_thin_lens(aperture, focus)
    };
    let fixed = |[aperture, focus]: [f64; 2]| {
        camera(
            Tensor::from_floats([aperture], &device),
            Tensor::from_floats([focus], &device),
        )
    };
    let size = arguments.either(40, 64);
    // No other blur, since the lens blurs enough.
    let options = RenderOptions::new(size, size)
        .with_bounces(0)
        .with_visibility(Visibility::Cone {
            angle: 0.0,
            pixels: 0.0,
        });
    let sharp = options.clone().with_samples(2048).with_seed(1 << 50);
    let target = render(&scene, &fixed(TARGET), &sharp)?.radiance;

    let study = Study::new(
        "fig5_aperture",
        "A lens from its blur",
        arguments,
        arguments.either(200, 300),
    );
    let start = Tensor::from_floats(START.map(f64::ln), &device.clone().autodiff());
    let module = Lens {
        logs: Param::from_tensor(start),
    };
    let fitted = fit(&study, module, &scene, &camera, &options, &target)?;

    let found = numbers(&fitted.module.logs.val().exp());
    let images = [
        ("initial", picture(&scene, &fixed(START), &sharp)?),
        ("target", picture(&scene, &fixed(TARGET), &sharp)?),
        (
            "final",
            picture(&scene, &fixed([found[0], found[1]]), &sharp)?,
        ),
    ];
    let plots = vec![
        fitted
            .history
            .plot("aperture radius (target 0.3)", &["aperture"])?,
        fitted
            .history
            .plot("focus distance (target 4.0)", &["focus"])?,
    ];
    let logs = |v: &[f64]| v.iter().map(|x| x.ln()).collect::<Vec<_>>();
    let far = |v: &[f64]| distance(&logs(v), &logs(&TARGET));
    let outcome = Outcome {
        errors: [far(&START), far(&found)],
        of: "distance of the logarithms of aperture and focus".into(),
        others: vec![
            ("aperture radius".into(), found[0]),
            ("focus distance".into(), found[1]),
        ],
    };
    study.finish(&fitted, images, plots, outcome)
}

fn main() -> Result<(), Failure> {
    common::log();
    run(&Arguments::parse())?;
    Ok(())
}
