//! Figure 1 of the paper: the derivative of each pixel with respect to a horizontal translation of an icosahedron,
//! and the Cornell box with Russian roulette and three widths of cones.

pub(crate) mod common;

use std::time::Instant;

use clap::Parser;
use softray::figure::{Diverging, Figure, Panel};
use softray::prelude::*;

use common::study::{Arguments, Failure, picture};

/// The agreement of the derivative image with central differences of renders with more samples.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Agreement {
    pub(crate) correlation: f64,
    /// The slope of the derivatives over the differences.
    pub(crate) slope: f64,
}

/// An icosahedron above a floor and below a square light.
fn scene(offset: Tensor<1>, device: &Device) -> Scene {
    let square = |side: f64, y: f64, down: bool| {
        let z = if down { -side } else { side };
        let corners = [[-side, y, z], [side, y, z], [side, y, -z], [-side, y, -z]];
        let [a, b, c, d] = corners;
        Object::new(shapes::quad(a, b, c, d, device))
    };
    Scene::new()
        .with_object(square(3.0, -1.0, false).with_material(Material::diffuse([0.6, 0.6, 0.6])))
        .with_object(square(0.8, 4.0, true).with_material(Material::emitter([16.0, 16.0, 16.0])))
        .with_object(
            Object::new(shapes::icosahedron(device).translated(offset))
                .with_material(Material::diffuse([0.75, 0.55, 0.35])),
        )
        .with_environment([0.15, 0.18, 0.22])
}

pub(crate) fn run(arguments: &Arguments) -> Result<Agreement, Failure> {
    let device = arguments.device()?;
    let start = Instant::now();
    let size = arguments.either(32, 96);
    let samples = arguments.either(64, 128);
    let camera = Camera::look_at([0.0, 1.4, 5.0], [0.0, 0.0, 0.0]).with_fov_y(38.0);
    let options = RenderOptions::new(size, size)
        .with_bounces(0)
        .with_samples(samples);
    let at = |x: f64| scene(Tensor::from_floats([x, 0.0, 0.0], &device), &device);

    let image = picture(&at(0.0), &camera, &options.clone().with_samples(512))?;
    // The derivatives of all pixels in one pass.
    let build = |values: &[f64]| Ok((at(values[0]), camera.clone()));
    let (scene, camera, tangents) = Tangent::of_numbers(&[0.0], build)?;
    let derivative = render_derivative(&scene, &camera, &options, &tangents)?;
    let by_x = HostImage::from_tensor(&derivative.tangents.view(0).radiance)?;
    let sum = |p: &[f32]| p.iter().map(|&v| f64::from(v)).sum::<f64>();
    let derivatives: Vec<f64> = by_x.pixels.chunks_exact(3).map(sum).collect();

    // The same derivatives by central differences.
    let h = 0.04;
    let fine = options.clone().with_samples(8 * samples);
    let [left, right] = [-h, h].map(|x| picture(&at(x), &camera, &fine));
    let (left, right) = (left?, right?);
    let differences: Vec<f64> = left
        .pixels
        .chunks_exact(3)
        .zip(right.pixels.chunks_exact(3))
        .map(|(a, b)| (sum(b) - sum(a)) / (2.0 * h))
        .collect();
    let agreement = agreement(&derivatives, &differences);

    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/cornell/scene.json");
    let cornell = SceneFile::load(path, &device)?;
    let box_size = arguments.either(48, 160);
    let boxed = |angle: f64| {
        let options = RenderOptions::new(box_size, box_size)
            .with_samples(arguments.either(32, 256))
            .with_bounces(8)
            .with_russian_roulette(2)
            .with_blur(angle);
        picture(&cornell.scene, &cornell.camera, &options)
    };
    let (sharp, soft, wide) = (boxed(0.0)?, boxed(1.0)?, boxed(6.0)?);

    let largest = differences.iter().fold(0.0f64, |a, x| a.max(x.abs()));
    let colors = Diverging::new(0.7 * largest)?;
    let signed = |caption: &str, values: Vec<f64>| {
        Panel::signed(caption, size, size, values).with_colors(colors)
    };
    let figure = Figure::new("Derivatives and blur")
        .with_row([
            Panel::new("icosahedron", &image),
            signed("∂/∂x", derivatives),
            signed("differences", differences),
        ])
        .with_row([("cones of 0°", &sharp), ("1°", &soft), ("6°", &wide)]);
    std::fs::create_dir_all(&arguments.out)?;
    let path = arguments.out.join("fig1_gradients.png");
    figure.write(&path)?;
    println!(
        "derivative image: correlation with differences {:.4}, slope {:.4}; {:.1} s",
        agreement.correlation,
        agreement.slope,
        start.elapsed().as_secs_f64()
    );
    println!("wrote {}", path.display());
    Ok(agreement)
}

/// Compares blocks of 2 × 2 pixels, since the blur spreads a derivative over neighboring pixels.
fn agreement(a: &[f64], b: &[f64]) -> Agreement {
    let size = a.len().isqrt();
    let coarse = |v: &[f64]| -> Vec<f64> {
        let half = size / 2;
        let block = |i: usize| {
            let (x, y) = (i % half * 2, i / half * 2);
            let at = |dx: usize, dy: usize| v[(y + dy) * size + x + dx];
            at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1)
        };
        (0..half * half).map(block).collect()
    };
    let (a, b) = (coarse(a), coarse(b));
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    Agreement {
        correlation: dot(&a, &b) / (dot(&a, &a) * dot(&b, &b)).sqrt(),
        slope: dot(&a, &b) / dot(&b, &b),
    }
}

fn main() -> Result<(), Failure> {
    common::log();
    run(&Arguments::parse())?;
    Ok(())
}
