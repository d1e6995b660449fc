//! The measurements of `docs/ACCURACY.md` and `docs/PERFORMANCE.md`: noise, bias and time of gradients,
//! images and paths. `cargo bench --bench versus -- --help`.
//!
//! The gradient cases are those of an independent renderer's script with the same weights, so that lines
//! of both can be laid side by side.

mod gradient;
mod image;
mod speed;
mod tessellation;
#[path = "../../tests/common/weights.rs"]
mod weights;

use std::path::PathBuf;

use clap::{Parser, Subcommand};
use softray::prelude::*;

#[derive(Parser)]
#[command(about)]
struct Arguments {
    #[command(subcommand)]
    part: Part,
    /// Half-angle of the cones of bounce and shadow rays, radians.
    #[arg(long, global = true, default_value_t = 0.0)]
    angle: f64,
    /// Radius of the camera's cone, pixels.
    #[arg(long, global = true, default_value_t = 0.5)]
    pixels: f64,
    /// The paper's form in place of cones: σ in scene units squared, with γ = 1e-3.
    #[arg(long, global = true)]
    softmax: Option<f64>,
    /// Passed by cargo.
    #[arg(long, global = true, hide = true)]
    bench: bool,
}

#[derive(Subcommand)]
enum Part {
    /// Mean, noise and time of d(Σ weights·image)/d(parameter), beside the reference derivative.
    Gradient(gradient::Gradient),
    /// Paths a second, forward and with backward.
    Speed(speed::Speed),
    /// Images beside the references: mean, clipped error.
    Image(image::Images),
    /// The gradient of a ball in 80 to 81,920 faces: bias, noise and time, with a figure.
    Tessellation(tessellation::Tessellation),
}

fn main() {
    let arguments = Arguments::parse();
    let visibility = match arguments.softmax {
        Some(sigma) => Visibility::softmax(sigma, 1e-3),
        None => Visibility::Cone {
            angle: arguments.angle,
            pixels: arguments.pixels,
        },
    };
    match arguments.part {
        Part::Gradient(part) => part.run(visibility),
        Part::Speed(part) => part.run(visibility),
        Part::Image(part) => part.run(visibility),
        Part::Tessellation(part) => {
            if let Err(e) = part.run(visibility) {
                eprintln!("{e}");
                std::process::exit(1);
            }
        }
    }
}

/// The mean of numbers and their standard deviation.
fn mean_and_deviation(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    (mean, (squares / (n - 1.0)).sqrt())
}

/// A folder of reference data.
fn data(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data")
        .join(name)
}

fn load(name: &str) -> SceneFile {
    load_to(name, &Device::flex())
}

fn load_to(name: &str, device: &Device) -> SceneFile {
    SceneFile::load(data(name).join("scene.json"), device).expect("a scene")
}
