//! From photographs with cameras and masks to a mesh with textures, and the light: `photographs FOLDER`.
//!
//! Levels go from coarse to fine. All but the last move the mesh, which is made even and sound again before each; the last
//! has textures as fine as the photographs, with a normal map. See docs/PHOTOGRAPHS.md.

pub(crate) mod asset;
pub(crate) mod results;
pub(crate) mod stage;

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Parser;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use softray::Result;
use softray::meshing::{HullOptions, SmoothOptions, TriangleMesh, smooth, visual_hull};
use softray::photographs::{Photograph, PhotographOptions, Photographs, Region, Split};
use softray::prelude::*;

use asset::{Asset, Level};
use stage::Stage;

/// Fits a mesh, its textures and the light to photographs.
#[derive(Parser, Clone, Debug)]
pub(crate) struct Arguments {
    /// Folder with transforms.json, sparse/0 of COLMAP, poses_bounds.npy or cameras_sphere.npz, and the photographs.
    folder: PathBuf,
    /// Longest side in pixels to which photographs are shrunk.
    #[arg(long, default_value_t = 256)]
    size: usize,
    /// Time for the fit, about. Default: 2 for 128 pixels, 10 for 256, 30 for 512.
    #[arg(long)]
    minutes: Option<f64>,
    /// A result within a minute: 64 pixels.
    #[arg(long)]
    quick: bool,
    /// Goes on where a stopped run with the same settings was.
    #[arg(long)]
    resume: bool,
    /// Every n-th view is held out to measure with, if the set does not say which.
    #[arg(long, default_value_t = 8)]
    hold_out: usize,
    /// Device: flex, ndarray, wgpu, vulkan, metal, cuda or rocm. Default: the value of BURN_DEVICE, or flex.
    #[arg(long)]
    device: Option<String>,
    /// Folder of the result.
    #[arg(long, default_value = "out/photographs")]
    out: PathBuf,
}

/// The share of light by which a bounce has to brighten views to be worth its time.
const INDIRECT: f64 = 0.01;

/// What a run has decided by measuring, so that a resumed run does the same.
#[derive(Serialize, Deserialize, Default)]
pub(crate) struct Plan {
    pub size: usize,
    /// Whether the light stands in the world.
    pub world: Option<bool>,
    /// Bounces of light, from the second level on.
    pub bounces: Option<u32>,
    /// Steps of the levels.
    pub steps: Vec<usize>,
}

impl Plan {
    /// Takes up a stopped run, or begins a new one.
    fn open(arguments: &Arguments, steps: &Path, plan: &Path) -> Outcome<Self> {
        if !arguments.resume && steps.exists() {
            std::fs::remove_dir_all(steps)?;
        }
        std::fs::create_dir_all(steps)?;
        let size = arguments.size;
        if !arguments.resume || !plan.exists() {
            return Ok(Self {
                size,
                ..Self::default()
            });
        }
        let made: Self = serde_json::from_slice(&std::fs::read(plan)?)?;
        if made.size != size {
            return Err(format!("{} is of a run with --size {}", plan.display(), made.size).into());
        }
        Ok(made)
    }
}

/// Photographs in the frame in which the object's region is the unit ball.
pub(crate) struct Set {
    train: Vec<Photograph>,
    held: Vec<Photograph>,
    region: Region,
    /// The mean distance of cameras, and of photographs at full size the mean focal length in longest sides.
    distance: f64,
    focal: f64,
    /// The mean of the photographs' colors on the object.
    brightness: [f64; 3],
}

pub(crate) type Failure = Box<dyn std::error::Error>;
pub(crate) type Outcome<T> = std::result::Result<T, Failure>;

fn main() -> Outcome<()> {
    env_logger::Builder::from_env(env_logger::Env::default().default_filter_or("error")).init();
    run(Arguments::parse())
}

pub(crate) fn run(mut arguments: Arguments) -> Outcome<()> {
    if arguments.quick {
        arguments.size = 64;
    }
    let device = softray::device::named(arguments.device.as_deref())?;
    let steps = arguments.out.join("steps");
    let plan = arguments.out.join("plan.json");
    let mut made = Plan::open(&arguments, &steps, &plan)?;
    let write = |made: &Plan| std::fs::write(&plan, serde_json::to_vec(made).expect("numbers"));
    let clock = Instant::now();
    let set = load(&arguments)?;
    let mut mesh = hull(&set)?;
    let levels = (arguments.size / 32).max(1).ilog2() as usize + 1;
    let by_size = if arguments.size > 256 {
        30.0
    } else if arguments.size > 128 {
        10.0
    } else {
        2.0
    };
    let default = if arguments.quick { 0.6 } else { by_size };
    let minutes = arguments.minutes.unwrap_or(default);
    let mut log = results::Log::new(&arguments.out, clock);
    log.line(&format!(
        "{} photographs, {} held out; hull of genus {}",
        set.train.len(),
        set.held.len(),
        mesh.statistics()?
            .genus
            .map_or("unknown".into(), |g| g.to_string()),
    ))?;
    let mut asset: Option<(Asset, Level)> = None;
    for index in 0..levels {
        let last = index + 1 == levels;
        let bounces = if index == 0 {
            0
        } else {
            made.bounces.unwrap_or(0)
        };
        let stage = Stage::new(&set, arguments.size >> (levels - 1 - index), last, bounces)?;
        if made.world.is_none() {
            made.world = Some(light_stands(&stage, &set, &mesh, &device)?);
            write(&made)?;
        }
        let world = made.world == Some(true);
        let (start, level) = stage.start(&set, &mut mesh, asset.take(), world, &device)?;
        if made.steps.len() <= index {
            // A level has a share of the time that is left.
            let left = minutes * 60.0 - clock.elapsed().as_secs_f64();
            let share = if last { 0.9 } else { 0.25 };
            made.steps
                .push(stage.steps_in(share * left, &start, &level, &device)?);
            write(&made)?;
        }
        let fitted = stage.fit(start, &level, made.steps[index], Some(&steps), &device)?;
        mesh.positions = positions(&fitted)?;
        let held: Vec<_> = set
            .held
            .iter()
            .map(|p| p.shrunk(stage.size))
            .collect::<Result<_>>()?;
        log.level(results::measure(
            &fitted,
            &level,
            &held,
            bounces,
            &device,
            Some(&arguments.out),
        )?)?;
        if made.bounces.is_none() {
            let few = few(&stage.views);
            let brighter = results::indirect(&fitted, &level, &few, &device)?;
            log.line(&format!("a bounce of light adds {:.1} %", 100.0 * brighter))?;
            made.bounces = Some(u32::from(brighter > INDIRECT));
            write(&made)?;
        }
        asset = Some((fitted, level));
    }
    let (asset, level) = asset.ok_or("no level")?;
    results::write(&asset, &level, &set, &arguments.out, &device)?;
    log.finish(&mesh, made.world == Some(true))
}

/// Loads photographs, and moves the world so that the object is in the unit ball.
fn load(arguments: &Arguments) -> Outcome<Set> {
    let mut set = Photographs::open(&arguments.folder)?;
    if set.of_split(Split::Test).is_empty() {
        set.split_every(arguments.hold_out)?;
    }
    let options = PhotographOptions::new()
        .with_longest_side(arguments.size)
        .with_black_backdrop(true);
    let mut notes = set.notes.clone();
    let mut load = |split| -> Outcome<Vec<Photograph>> {
        let loaded = set.load(&set.of_split(split), &options)?;
        notes.extend(loaded.notes);
        Ok(loaded.photographs)
    };
    let (mut train, mut held) = (load(Split::Train)?, load(Split::Test)?);
    notes.iter().for_each(|note| eprintln!("note: {note}"));
    if let Some(view) = train.iter().chain(&held).find(|p| !p.masked) {
        return Err(format!("{} has no mask: see docs/PHOTOGRAPHS.md", view.name).into());
    }
    let region = Region::of_masks(&train)?;
    for photograph in train.iter_mut().chain(&mut held) {
        let rows = photograph.camera.to_world.iter_mut().zip(region.center);
        rows.for_each(|(row, center)| row[3] = (row[3] - center) / region.radius);
    }
    let mean =
        |value: fn(&Photograph) -> f64| train.iter().map(value).sum::<f64>() / train.len() as f64;
    let distance = mean(|p| DVec3::from(p.camera.position()).length());
    let focal = mean(|p| p.camera.focal[0] / p.camera.size[0].max(p.camera.size[1]) as f64);
    let mut brightness = [0.0; 3];
    for p in &train {
        let shown = p.mask.iter().map(|&m| f64::from(m)).sum::<f64>() * train.len() as f64;
        for (sum, color) in brightness.iter_mut().zip(p.color.mean()) {
            *sum += color * p.mask.len() as f64 / shown;
        }
    }
    Ok(Set {
        train,
        held,
        region,
        distance,
        focal,
        brightness,
    })
}

/// The visual hull of the masks. If one of them cuts off a part of it, it is that of the others: a point may then be outside
/// of one mask.
fn hull(set: &Set) -> Result<TriangleMesh> {
    let masks: Vec<_> = set.train.iter().map(Photograph::silhouette).collect();
    let carve = |outside: usize| {
        let options = HullOptions::default().with_resolution(96);
        let options = options.with_tolerance(outside);
        visual_hull(&masks, Region::sphere([0.0; 3], 1.0), &options)
    };
    let tolerant = carve(1)?;
    let hull = match carve(0) {
        Ok(exact) if exact.volume() > 0.93 * tolerant.volume() => exact,
        _ => tolerant,
    };
    smooth(&hull, &SmoothOptions::default())
}

/// Whether the light stands in the world, and does not turn with the camera: which of both explains the photographs better
/// after a few steps.
fn light_stands(stage: &Stage, set: &Set, mesh: &TriangleMesh, device: &Device) -> Outcome<bool> {
    let mut errors = [0.0; 2];
    for (error, world) in errors.iter_mut().zip([false, true]) {
        let (asset, level) = stage.start(set, &mut mesh.clone(), None, world, device)?;
        let fitted = stage.fit(asset, &level, 50, None, device)?;
        let few = few(&stage.views);
        let numbers = results::measure(&fitted, &level, &few, 0, device, None)?;
        *error = -numbers["psnr_linear"].as_f64().ok_or("no number")?;
    }
    Ok(errors[1] <= errors[0])
}

/// About eight photographs.
fn few(views: &[Photograph]) -> Vec<Photograph> {
    let step = views.len().div_ceil(8);
    views.iter().step_by(step).cloned().collect()
}

/// The vertices of a mesh.
fn positions(asset: &Asset) -> Result<Vec<[f64; 3]>> {
    Mesh::new(asset.vertices.val().inner(), Vec::new()).host_vertices()
}
