//! What a run writes: numbers, pictures, and the asset.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use burn::module::Module;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};
use softray::Result;
use softray::figure::{Figure, Panel};
use softray::io::Animation;
use softray::meshing::TriangleMesh;
use softray::optim::metrics;
use softray::photographs::Photograph;
use softray::prelude::*;

use super::asset::{Asset, Level, camera};
use super::{Outcome, Set};

pub fn bar(steps: usize, size: usize) -> ProgressBar {
    let style = "{prefix:>4} px {bar:40} {pos}/{len} {msg} [{elapsed} < {eta}]";
    let style =
        ProgressStyle::with_template(style).unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(steps as u64)
        .with_style(style)
        .with_prefix(size.to_string())
}

/// The log, and the numbers of all levels.
pub struct Log {
    out: PathBuf,
    clock: Instant,
    text: String,
    levels: Vec<Value>,
}

impl Log {
    pub fn new(out: &Path, clock: Instant) -> Self {
        Self {
            out: out.into(),
            clock,
            text: String::new(),
            levels: Vec::new(),
        }
    }

    pub fn line(&mut self, text: &str) -> Outcome<()> {
        let line = format!("{:6.1} s  {text}\n", self.clock.elapsed().as_secs_f64());
        eprint!("{line}");
        self.text += &line;
        Ok(fs::write(self.out.join("log.txt"), &self.text)?)
    }

    pub fn level(&mut self, numbers: Value) -> Outcome<()> {
        self.line(&format!("{numbers}"))?;
        self.levels.push(numbers);
        Ok(())
    }

    /// Writes `metrics.json`.
    pub fn finish(mut self, mesh: &TriangleMesh, world: bool) -> Outcome<()> {
        let found = mesh.statistics()?;
        let numbers = json!({
            "levels": self.levels,
            "light": if world { "stands in the world" } else { "turns with the camera" },
            "seconds": self.clock.elapsed().as_secs_f64(),
            "peak_memory_bytes": peak_memory(),
            "mesh": {
                "faces": mesh.faces.len(),
                "closed": found.is_solid(),
                "genus": found.genus,
                "components": found.components,
                "crossings": found.crossings,
                "folds": found.folds,
                "edges_within_half_and_twice_the_median": found.even_edges,
            },
        });
        fs::write(
            self.out.join("metrics.json"),
            serde_json::to_vec_pretty(&numbers)?,
        )?;
        self.line(&format!("wrote {}", self.out.display()))
    }
}

/// The most memory that the process had, where the system says so.
fn peak_memory() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    Some(1024 * line.split_whitespace().nth(1)?.parse::<u64>().ok()?)
}

/// A view of the asset alone, before black.
fn see(
    asset: &Asset,
    level: &Level,
    view: &Photograph,
    bounces: u32,
    device: &Device,
) -> Result<(HostImage, Tensor<2>)> {
    let [width, height] = view.camera.size;
    let options = RenderOptions::new(width, height)
        .with_samples(64)
        .with_bounces(bounces)
        .with_opacity();
    let object = asset.object(level, asset.surface(level)?);
    let batch = asset.batch(&object, level.world, &[view])?;
    let image = render_batch(&batch, &options)?;
    let opacity = image.opacity.expect("requested").squeeze_dim::<2>(0);
    let camera = camera(view, level.world)?;
    // What is seen beside the object: with another one that is too small to be seen.
    let [eye, target] = [camera.eye.values()?, camera.target.values()?];
    let dot = shapes::cube(device)
        .scaled(1e-6)
        .translated([0, 1, 2].map(|i| 2.0 * target[i] - eye[i]));
    let empty = Scene::new()
        .with_object(Object::new(dot))
        .with_environment(asset.sky.environment());
    let behind = render(&empty, &camera, &options)?.radiance;
    let image = image.radiance.squeeze_dim::<3>(0);
    let image = image - behind * (opacity.clone().neg() + 1.0).unsqueeze_dim(2);
    Ok((HostImage::from_tensor(&image)?, opacity))
}

/// Measures held-out views, whose colors are as before black, and writes `views.png`: photograph, render and difference.
pub fn measure(
    asset: &Asset,
    level: &Level,
    held: &[Photograph],
    bounces: u32,
    device: &Device,
    out: Option<&Path>,
) -> Result<Value> {
    let asset = &asset.valid();
    let (mut images, mut targets, mut masks, mut iou) = (vec![], vec![], vec![], 0.0);
    for view in held {
        let (image, opacity) = see(asset, level, view, bounces, device)?;
        let mask = Tensor::<1>::from_floats(view.mask.as_slice(), device);
        iou += loss::iou(&opacity, &mask.reshape(opacity.dims()), 0.5)? / held.len() as f64;
        images.push(image);
        targets.push(view.color.clone());
        masks.push(view.mask.iter().map(|&m| m > 0.5).collect::<Vec<_>>());
    }
    let views = images.iter().zip(&targets).zip(&masks);
    let views = views.map(|((image, target), mask)| metrics::View::new(image, target, mask));
    let views: Vec<_> = views.collect::<Result<_>>()?;
    if let Some(out) = out {
        let few = || (0..held.len()).step_by(held.len().div_ceil(6));
        let differences =
            few().map(|i| Panel::difference("render − photograph", &images[i], &targets[i]));
        Figure::new("Held-out views")
            .with_height(200)
            .with_row(few().map(|i| (held[i].name.as_str(), &targets[i])))
            .with_row(few().map(|i| ("render", &images[i])))
            .with_row(differences.collect::<Result<Vec<_>>>()?)
            .write(out.join("views.png"))?;
    }
    Ok(json!({
        "pixels": held.first().map(|p| p.camera.size),
        "faces": level.faces.len(),
        "psnr_srgb": metrics::psnr_srgb(&views)?,
        "psnr_linear": metrics::psnr_linear(&views)?,
        "ssim": metrics::ssim_srgb(&views, device)?,
        "iou": iou,
    }))
}

/// The share by which a bounce of light brightens photographs.
pub fn indirect(
    asset: &Asset,
    level: &Level,
    views: &[Photograph],
    device: &Device,
) -> Result<f64> {
    let asset = &asset.valid();
    let mut sums = [0.0; 2];
    for view in views {
        for (bounces, sum) in sums.iter_mut().enumerate() {
            let (image, _) = see(asset, level, view, bounces as u32, device)?;
            *sum += image.mean().iter().sum::<f64>();
        }
    }
    Ok(sums[1] / sums[0] - 1.0)
}

/// Writes the asset, its light, and pictures of it.
pub fn write(asset: &Asset, level: &Level, set: &Set, out: &Path, device: &Device) -> Result<()> {
    let asset = &asset.valid();
    let object = asset.object(level, asset.surface(level)?);
    let mut own = object.clone();
    own.mesh = own
        .mesh
        .scaled(set.region.radius)
        .translated(set.region.center);
    Scene::new().with_object(own).write(out.join("asset.glb"))?;
    HostImage::from_tensor(&asset.sky.texels())?.write(out.join("light.exr"))?;

    // Pictures keep the photographs' idea of what is up.
    let first = &set.train[0];
    let up = first.camera.to_world.map(|row| row[1]);
    let shot = |eye: [f64; 3]| Camera::look_at(eye, [0.0; 3]).with_up(up).with_fov_y(30.0);
    let eye = first.camera.position().map(|x| x * 4.2 / set.distance);
    let eyes = |count: usize| (0..count).map(move |k| turned(&eye, &up, k as f64 / count as f64));
    let studio = |above: [f32; 3], below: [f32; 3]| {
        let row = |k: usize| if k < 6 { above } else { below };
        let texels: Vec<f32> = (0..16)
            .flat_map(|k| (0..32).flat_map(move |_| row(k)))
            .collect();
        Environment::map(Tensor::<1>::from_floats(texels.as_slice(), device).reshape([16, 32, 3]))
    };
    let side = first.camera.size[0].clamp(128, 320);
    let lights = [
        ("cool sky", studio([1.3, 1.6, 2.0], [0.25, 0.22, 0.2])),
        ("warm floor", studio([0.15, 0.15, 0.2], [1.5, 1.0, 0.6])),
    ];
    let options = RenderOptions::new(side, side)
        .with_samples(64)
        .with_bounces(2);
    let mut figure = Figure::new("In two other lights");
    let own = |light: &Environment| {
        Scene::new()
            .with_object(object.clone())
            .with_environment(light.clone())
    };
    for (name, light) in &lights {
        let images =
            eyes(4).map(|eye| HostImage::take(render(&own(light), &shot(eye), &options)?.radiance));
        let images = images.collect::<Result<Vec<_>>>()?;
        figure = figure.with_row(images.iter().map(|image| (*name, image)));
    }
    figure.write(out.join("relit.png"))?;
    let options = RenderOptions::new(side, side)
        .with_samples(16)
        .with_bounces(1);
    Animation::render(&own(&lights[0].1), eyes(36).map(shot), &options)?
        .with_frames_per_second(12.0)
        .write(out.join("turntable.gif"))
}

/// Turns a point about an axis of unit length by a share of a full turn (Rodrigues).
fn turned(p: &[f64; 3], axis: &[f64; 3], share: f64) -> [f64; 3] {
    let (p, axis) = (glam::DVec3::from(*p), glam::DVec3::from(*axis));
    glam::DQuat::from_axis_angle(axis, share * std::f64::consts::TAU)
        .mul_vec3(p)
        .to_array()
}
