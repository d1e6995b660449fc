//! What a run writes: numbers, pictures, and the asset.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use burn::module::Module;
use serde_json::{Value, json};
use softray::Result;
use softray::figure::Figure;
use softray::io::Animation;
use softray::meshing::TriangleMesh;
use softray::photographs::Photograph;
use softray::prelude::*;

use super::fit::Asset;
use super::{Outcome, Set};

/// The log, and the numbers of all levels.
pub struct Log {
    out: PathBuf,
    clock: Instant,
    text: String,
    levels: Vec<Value>,
}

impl Log {
    pub fn new(out: &Path, clock: Instant) -> Self {
        let (text, levels) = (String::new(), Vec::new());
        Self {
            out: out.into(),
            clock,
            text,
            levels,
        }
    }

    pub fn line(&mut self, text: &str) -> Outcome<()> {
        let line = format!("{:6.1} s  {text}\n", self.clock.elapsed().as_secs_f64());
        eprint!("{line}");
        self.text += &line;
        Ok(fs::write(self.out.join("log.txt"), &self.text)?)
    }

    /// Measures held-out views at the end of a level, and draws them.
    pub fn level(&mut self, asset: &Asset, held: &[Photograph], bounces: u32) -> Outcome<()> {
        let found = asset.compare(held, bounces)?;
        found.figure(held, 6)?.write(self.out.join("views.png"))?;
        let numbers = json!({
            "pixels": held.first().map(|p| p.camera.size),
            "faces": asset.object.mesh.mesh().faces.len(),
            "psnr_srgb": found.psnr_srgb,
            "psnr_linear": found.psnr_linear,
            "ssim": found.ssim,
            "iou": found.iou,
        });
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

/// Writes the asset, its light, and pictures of it in other lights.
pub fn write(asset: &Asset, set: &Set, out: &Path) -> Result<()> {
    let asset = asset.valid();
    let object = asset.object.object()?.with_name("asset");
    let device = object.mesh.vertices.device();
    let mut own = object.clone();
    own.mesh = own
        .mesh
        .scaled(set.region.radius)
        .translated(set.region.center);
    Scene::new().with_object(own).write(out.join("asset.glb"))?;
    HostImage::from_tensor(&asset.sky.texels())?.write(out.join("light.exr"))?;

    // Pictures keep the photographs' idea of what is up.
    let first = &set.train[0].camera;
    let eye = glam::DVec3::from(first.position()).normalize() * 4.2;
    let camera = Camera::look_at(eye.to_array(), [0.0; 3])
        .with_up(first.to_world.map(|row| row[1]))
        .with_fov_y(30.0);
    let lit = |above: [f32; 3], below: [f32; 3]| {
        let texels = [above.repeat(6 * 32), below.repeat(10 * 32)].concat();
        let texels = Tensor::<1>::from_floats(texels.as_slice(), &device).reshape([16, 32, 3]);
        let scene = Scene::new().with_object(object.clone());
        scene.with_environment(Environment::map(texels))
    };
    let side = first.size[0].clamp(128, 320);
    let options = RenderOptions::new(side, side)
        .with_samples(64)
        .with_bounces(2);
    let cool = lit([1.3, 1.6, 2.0], [0.25, 0.22, 0.2]);
    let warm = lit([0.15, 0.15, 0.2], [1.5, 1.0, 0.6]);
    let around = |frames: usize| -> Result<Vec<Camera>> {
        (0..frames)
            .map(|k| camera.turned(360.0 * k as f64 / frames as f64))
            .collect()
    };
    let mut figure = Figure::new("In two other lights");
    for (name, scene) in [("cool sky", &cool), ("warm floor", &warm)] {
        let images = Animation::render(scene, around(4)?, &options)?;
        figure = figure.with_row(images.frames().iter().map(|image| (name, image)));
    }
    figure.write(out.join("relit.png"))?;
    let options = options.with_samples(16).with_bounces(1);
    Animation::render(&cool, around(36)?, &options)?
        .with_frames_per_second(12.0)
        .write(out.join("turntable.gif"))
}
