//! Images beside the references, and paths a second on any device: `cargo bench --bench versus -- --help`.
//! What is measured beside other renderers is in `benches/peers`.

mod image;
mod speed;

use std::path::PathBuf;

use clap::{Parser, Subcommand};
use softray::prelude::*;

#[derive(Parser)]
#[command(about)]
struct Arguments {
    #[command(subcommand)]
    part: Part,
    /// Half-angle of the cones of bounce and shadow rays, degrees.
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
    /// Paths a second, forward and with backward.
    Speed(speed::Speed),
    /// Images beside the references: mean, clipped error.
    Image(image::Images),
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
        Part::Speed(part) => part.run(visibility),
        Part::Image(part) => part.run(visibility),
    }
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
