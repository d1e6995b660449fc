//! Recovers the texels of a ball from several views.

pub(crate) mod common;

use std::f64::consts::{PI, TAU};

use burn::module::{Module, Param};
use burn::optim::AdamConfig;
use burn::tensor::TensorData;
use clap::Parser;
use softray::optim::{Evaluation, Rate, loss};
use softray::prelude::*;

use common::study::{Arguments, Failure, Outcome, Study, numbers, picture};

#[derive(Module, Debug)]
struct Texture {
    /// `[H, W, 3]`. A logistic function maps them to albedos in (0, 1).
    logits: Param<Tensor<3>>,
}

const VIEWS: usize = 8;

/// A ball on a grid of longitude and latitude, with texture coordinates and a seam.
fn ball(columns: usize, rows: usize, device: &Device) -> Mesh {
    let (mut vertices, mut uvs, mut faces) = (Vec::new(), Vec::new(), Vec::new());
    for row in 0..=rows {
        for column in 0..=columns {
            let (u, v) = (column as f64 / columns as f64, row as f64 / rows as f64);
            let ((sin, cos), (up, around)) = ((TAU * u).sin_cos(), (PI * v).sin_cos());
            vertices.push([up * sin, -around, up * cos]);
            uvs.extend([u as f32, v as f32]);
        }
    }
    let at = |row: usize, column: usize| (row * (columns + 1) + column) as u32;
    for row in 0..rows {
        for column in 0..columns {
            let (a, b) = (at(row, column), at(row, column + 1));
            let (c, d) = (at(row + 1, column + 1), at(row + 1, column));
            if row > 0 {
                faces.push([a, b, c]);
            }
            if row + 1 < rows {
                faces.push([a, c, d]);
            }
        }
    }
    let count = uvs.len() / 2;
    Mesh::from_host(&vertices, faces, device)
        .with_uvs(Tensor::from_data(TensorData::new(uvs, [count, 2]), device))
}

/// Meridians, parallels and dots of several colors.
fn pattern(height: usize, width: usize) -> Vec<f32> {
    let mut texels = Vec::with_capacity(height * width * 3);
    for y in 0..height {
        for x in 0..width {
            let (u, v) = (x as f64 / width as f64, y as f64 / height as f64);
            let (stripe, ring) = ((u * 6.0 * TAU).sin() > 0.0, (v * 4.0 * TAU).sin() > 0.0);
            let dot = ((u * 6.0).fract() - 0.5).hypot((v * 4.0).fract() - 0.5) < 0.22;
            let color = match (dot, stripe == ring) {
                (true, _) => [0.85, 0.75, 0.2],
                (_, true) => [0.75, 0.2, 0.2],
                (_, false) => [0.15, 0.3, 0.65],
            };
            texels.extend(color.map(|c: f32| c));
        }
    }
    texels
}

fn cameras() -> Vec<Camera> {
    let view = |i: usize| {
        let angle = TAU * i as f64 / VIEWS as f64;
        let height = [1.6, -1.6, 0.4, -0.4][i % 4];
        let eye = [3.4 * angle.sin(), height, 3.4 * angle.cos()];
        Camera::look_at(eye, [0.0; 3]).with_fov_y(36.0)
    };
    (0..VIEWS).map(view).collect()
}

#[expect(
    clippy::too_many_lines,
    reason = "a program from its scene to its figure"
)]
pub(crate) fn run(arguments: &Arguments) -> Result<Outcome, Failure> {
    let device = arguments.device()?;
    let (height, width) = arguments.either((16, 32), (32, 64));
    let mesh = ball(24, 12, &device);
    let scene = |texels: Tensor<3>| {
        Scene::new()
            .with_object(
                Object::new(mesh.clone())
                    .with_material(Material::diffuse(ColorTexture::texture(texels))),
            )
            .with_environment([1.0, 1.0, 1.0])
    };
    let cameras = cameras();
    let size = arguments.either(32, 64);
    // No filter beyond a pixel, which keeps texels separate.
    let options = RenderOptions::new(size, size)
        .with_bounces(0)
        .with_visibility(Visibility::Cone {
            angle: 0.0,
            pixels: 0.0,
        });
    let goal = pattern(height, width);
    let data = TensorData::new(goal.clone(), [height, width, 3]);
    let still = scene(Tensor::from_data(data, &device));
    let sharp = options.clone().with_samples(512).with_seed(1 << 50);
    let see = |camera: &Camera| render(&still, camera, &sharp).map(|image| image.radiance);
    let targets = cameras
        .iter()
        .map(see)
        .collect::<softray::Result<Vec<_>>>()?;

    let study = Study::new(
        "texture",
        "Texels from eight views",
        arguments,
        arguments.either(240, 400),
    );
    let start = Tensor::zeros([height, width, 3], &device.clone().autodiff());
    let module = Texture {
        logits: Param::from_tensor(start),
    };
    let goal: Vec<f64> = goal.into_iter().map(f64::from).collect();
    // Weighted by the area of the texels on the ball.
    let rms = |t: &[f64]| {
        let (mut sum, mut all) = (0.0, 0.0);
        for (i, (a, b)) in t.iter().zip(&goal).enumerate() {
            let area = (PI * ((i / 3 / width) as f64 + 0.5) / height as f64).sin();
            sum += area * (a - b).powi(2);
            all += area;
        }
        (sum / all).sqrt()
    };
    let fitted = study
        .fit(module, AdamConfig::new().with_beta_2(0.99).init())
        .with_rate(Rate::cosine(0.5))
        .run(|texture: &Texture, step: &_| {
            let texels = burn::tensor::activation::sigmoid(texture.logits.val());
            let scene = scene(texels.clone());
            let few = options.clone().with_samples(8);
            // Views take turns, two per step.
            let (mut sum, mut first) = (None, None);
            for k in 0..2 {
                let view = (2 * step.index + k) % VIEWS;
                let see = |r| render(&scene, &cameras[view], &step.options(&few, r));
                let (a, b) = (see(2 * k as u64)?.radiance, see(2 * k as u64 + 1)?.radiance);
                first = first.or(Some((view, a.clone())));
                let loss = loss::mse_unbiased(a, b, targets[view].clone())?;
                sum = Some(match sum {
                    Some(sum) => sum + loss,
                    None => loss,
                });
            }
            let (Some(sum), Some((view, image))) = (sum, first) else {
                unreachable!("there are two views");
            };
            Ok(Evaluation::new(sum)
                .with_value("texels", rms(&numbers(&texels)))
                .with_image(format!("view {view}"), image)
                .with_target(format!("view {view}"), targets[view].clone()))
        })?;

    let gray = Tensor::full([height, width, 3], 0.5, &device);
    let found = burn::tensor::activation::sigmoid(fitted.module.logits.val().inner());
    let images = [
        ("initial", picture(&scene(gray), &cameras[0], &sharp)?),
        ("target", picture(&still, &cameras[0], &sharp)?),
        (
            "final",
            picture(&scene(found.clone()), &cameras[0], &sharp)?,
        ),
    ];
    let plots = vec![
        fitted
            .history
            .plot("error of the texels, RMS", &["texels"])?
            .with_log_scale(),
    ];
    let outcome = Outcome {
        errors: [rms(&vec![0.5; goal.len()]), rms(&numbers(&found))],
        of: "error of the texels, RMS".into(),
        others: Vec::new(),
    };
    study.finish(&fitted, images, plots, outcome)
}

fn main() -> Result<(), Failure> {
    common::log();
    run(&Arguments::parse())?;
    Ok(())
}
