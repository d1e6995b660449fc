//! Renders the Cornell box, then rotates its short block and recovers the angle from the image.

mod common;

use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

use burn::module::Param;
use burn::optim::{AdamConfig, GradientsParams};
use clap::Parser;
use softray::prelude::*;

/// Renders the Cornell box with global illumination, then fits the rotation of its short block.
#[derive(Parser)]
pub(crate) struct Arguments {
    /// Width and height of the image. A multiple of 64 is compared with the reference.
    #[arg(long, default_value_t = 256)]
    size: usize,
    /// Paths per pixel.
    #[arg(long, default_value_t = 64)]
    spp: u32,
    /// Bounces after the first surface.
    #[arg(long, default_value_t = 3)]
    bounces: u32,
    /// Half-angle of the ray cones, in degrees.
    #[arg(long, default_value_t = 0.0)]
    angle: f64,
    /// Half-angle of the ray cones in the fit, in degrees.
    #[arg(long, default_value_t = 1.7)]
    fit_angle: f64,
    /// Number of steps of the fit.
    #[arg(long, default_value_t = 170)]
    steps: usize,
    /// Rotation of the block at the start of the fit, in degrees.
    #[arg(long, default_value_t = 10.0)]
    degrees: f64,
    /// Random seed of the fit.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Device, by its name in `softray::device::named`: flex, ndarray, wgpu, vulkan, metal, cuda or rocm. Default: the value of BURN_DEVICE, or flex.
    #[arg(long)]
    device: Option<String>,
    /// Folder for the pictures.
    #[arg(long, default_value = "out")]
    out: PathBuf,
}

fn main() -> Result<(), Box<dyn Error>> {
    common::log();
    run(&Arguments::parse()).map(|_| ())
}

/// Renders and fits. Returns the angle at the end of the fit, in degrees.
pub(crate) fn run(arguments: &Arguments) -> Result<f64, Box<dyn Error>> {
    let device = softray::device::named(arguments.device.as_deref())?;
    std::fs::create_dir_all(&arguments.out)?;
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/cornell");
    let file = SceneFile::load(data.join("scene.json"), &device)?;
    picture(arguments, &file, &data)?;
    fit(arguments, &file, &device)
}

fn picture(arguments: &Arguments, file: &SceneFile, data: &Path) -> Result<(), Box<dyn Error>> {
    let (bar, progress) = common::render_progress("rendering");
    let options = RenderOptions::new(arguments.size, arguments.size)
        .with_samples(arguments.spp)
        .with_bounces(arguments.bounces)
        .with_blur(arguments.angle)
        .with_progress(progress);
    let start = Instant::now();
    let image = render(&file.scene, &file.camera, &options)?;
    let host = HostImage::from_tensor(&image.radiance)?;
    let seconds = start.elapsed().as_secs_f64();
    bar.finish_and_clear();
    for ending in ["png", "exr"] {
        let path = arguments.out.join(format!("cornell_box.{ending}"));
        host.write(&path)?;
        println!("wrote {}", path.display());
    }
    let rays = image.statistics.rays;
    println!(
        "{seconds:.1} s, {rays} rays, {:.0} rays/s",
        rays as f64 / seconds
    );
    let reference = data.join(format!("bounces-{}.exr", arguments.bounces));
    if reference.exists() {
        let reference = HostImage::read(reference)?;
        if let Some(small) = shrink(&host, reference.width)? {
            println!("rmse {:.5}", small.rmse(&reference, false)?);
            println!("rmse_clipped {:.5}", small.rmse(&reference, true)?);
            println!("mean_ratio {:.5}", small.mean_ratio(&reference));
        }
    }
    Ok(())
}

/// Averages a square image over blocks to a smaller width. The result is `None` if that does not divide its width.
fn shrink(image: &HostImage, width: usize) -> Result<Option<HostImage>, Box<dyn Error>> {
    if !image.width.is_multiple_of(width) {
        return Ok(None);
    }
    let block = image.width / width;
    let mut pixels = vec![0.0; width * width * 3];
    for (i, value) in image.pixels.iter().enumerate() {
        let (y, x, c) = (
            i / 3 / image.width / block,
            i / 3 % image.width / block,
            i % 3,
        );
        pixels[(y * width + x) * 3 + c] += value / (block * block) as f32;
    }
    Ok(Some(HostImage::new(width, width, pixels)?))
}

/// Returns the scene with its short block rotated about the vertical axis through its center. The angle is in radians,
/// since the epsilon of Adam is large beside gradients by degrees.
fn turned(file: &SceneFile, angle: &Tensor<1>) -> softray::Result<Scene> {
    file.scene.clone().map_object("short", |object| {
        object.map_mesh(|mesh| {
            let center = mesh.vertices.clone().mean_dim(0).reshape([3]);
            let turn = Transform::new()
                .with_axis_angle([0.0, 1.0, 0.0], angle.clone() * 1f64.to_degrees())
                .with_translation(center.clone());
            mesh.translated(center.neg()).transformed(&turn)
        })
    })
}

/// Calls a function with 0 and 1 on two threads.
fn both<T: Send>(f: impl Fn(usize) -> softray::Result<T> + Sync) -> softray::Result<[T; 2]> {
    let (a, b) = rayon::join(|| f(0), || f(1));
    Ok([a?, b?])
}

fn fit(arguments: &Arguments, file: &SceneFile, device: &Device) -> Result<f64, Box<dyn Error>> {
    const SIZE: usize = 48;
    let options = RenderOptions::new(SIZE, SIZE)
        .with_bounces(1)
        .with_blur(arguments.fit_angle);
    let sharp = RenderOptions::new(128, 128)
        .with_bounces(1)
        .with_blur(arguments.angle)
        .with_samples(64);
    let show = |degrees: f64, options: &RenderOptions| -> Result<HostImage, Box<dyn Error>> {
        let angle = Tensor::<1>::from_floats([degrees.to_radians() as f32], device);
        let image = render(&turned(file, &angle)?, &file.camera, options)?;
        Ok(HostImage::from_tensor(&image.radiance)?)
    };
    let start = Instant::now();
    let target_image = show(
        0.0,
        &options.clone().with_samples(2048).with_seed(1_000_000),
    )?;
    let target = target_image.clone().into_tensor(device).clamp(0.0, 1.0);

    let initial = [arguments.degrees.to_radians() as f32];
    let mut angle = Param::from_tensor(Tensor::<1>::from_floats(
        initial,
        &device.clone().autodiff(),
    ));
    let mut adam = AdamConfig::new().with_beta_2(0.99).init();
    let bar = common::bar(arguments.steps as u64, "fitting");
    for step in 0..arguments.steps {
        // Every step has new seeds, so that noise averages out over the steps. The loss is the product of two
        // independent images instead of a square, so that the variance of the noise does not enter it. The gradient
        // of a·b is a·∇b + b·∇a. Each image has its own thread and graph.
        let leaves = [0; 2].map(|_| angle.val().inner().autodiff().require_grad());
        let differences = both(|i| {
            let seed = arguments.seed + (2 * step + i) as u64;
            let noisy = options.clone().with_samples(8).with_seed(seed);
            let image = render(&turned(file, &leaves[i])?, &file.camera, &noisy)?;
            Ok(image.radiance.clamp(0.0, 1.0) - target.clone())
        })?;
        let gradients = both(|i| {
            let other = differences[1 - i].clone().inner();
            let gradients = (differences[i].clone() * other).mean().backward();
            Ok(leaves[i]
                .grad(&gradients)
                .expect("the angle is in the graph"))
        })?;
        let [a, b] = gradients;
        let mut gradients = GradientsParams::new();
        gradients.register(angle.id, a + b);
        let done = step as f64 / arguments.steps as f64;
        let rate = 0.01 * (1.0 + (std::f64::consts::PI * done).cos());
        angle = adam.step(rate, angle, gradients);
        bar.inc(1);
    }
    bar.finish_and_clear();
    let found = f64::from(angle.val().inner().into_scalar::<f32>()).to_degrees();
    println!(
        "angle: {:.2}° at the start, {:.2}° after {} steps, {:.1} s",
        arguments.degrees,
        found,
        arguments.steps,
        start.elapsed().as_secs_f64()
    );
    // The pictures are larger and sharp; the fit used blurred ones.
    let before = show(arguments.degrees, &sharp)?;
    let after = show(found, &sharp)?;
    let target_image = show(0.0, &sharp)?;
    let path = arguments.out.join("cornell_box_fit.png");
    HostImage::side_by_side(&[&before, &after, &target_image]).write(&path)?;
    println!("wrote {} (before, after, target)", path.display());
    Ok(found)
}
