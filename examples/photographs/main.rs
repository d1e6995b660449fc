//! From photographs with cameras and masks to a mesh with textures, and the light: `photographs FOLDER`.
//!
//! Levels go from coarse to fine. All but the last move the mesh, which is made even and sound again before each; the last
//! has textures as fine as the photographs, with a normal map. See docs/PHOTOGRAPHS.md.

pub(crate) mod fit;
pub(crate) mod results;

use std::path::PathBuf;
use std::time::Instant;

use clap::Parser;
use serde::{Deserialize, Serialize};
use softray::Result;
use softray::meshing::{HullOptions, SmoothOptions, TriangleMesh, renew, smooth, visual_hull};
use softray::photographs::{Photograph, PhotographOptions, Photographs, Region, Split};
use softray::prelude::*;

use fit::{Asset, Stage};

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

/// Photographs in the frame in which the object's region is the unit ball.
pub(crate) struct Set {
    train: Vec<Photograph>,
    held: Vec<Photograph>,
    region: Region,
}

/// A bounce of light has to brighten views by this share to be worth its time.
const INDIRECT: f64 = 0.01;

pub(crate) type Outcome<T> = std::result::Result<T, Box<dyn std::error::Error>>;

fn main() -> Outcome<()> {
    env_logger::Builder::from_env(env_logger::Env::default().default_filter_or("error")).init();
    run(Arguments::parse())
}

pub(crate) fn run(mut arguments: Arguments) -> Outcome<()> {
    if arguments.quick {
        arguments.size = 64;
    }
    let (size, clock) = (arguments.size, Instant::now());
    let minutes = arguments.minutes.unwrap_or(match (arguments.quick, size) {
        (true, _) => 0.6,
        (_, ..=128) => 2.0,
        (_, ..=256) => 10.0,
        _ => 30.0,
    });
    let device = softray::device::named(arguments.device.as_deref())?;
    let mut plan = Plan::open(&arguments)?;
    let mut log = results::Log::new(&arguments.out, clock);
    let set = load(&arguments)?;
    let mut mesh = hull(&set)?;
    log.line(&format!(
        "{} photographs, {} held out",
        set.train.len(),
        set.held.len()
    ))?;

    // Sizes that double from about 32 pixels on, and the whole size again.
    let halved = (0..).map(|k| size >> k).take_while(|&s| s >= size.min(32));
    let sizes: Vec<usize> = std::iter::once(size).chain(halved).collect();
    let sizes: Vec<usize> = sizes.into_iter().rev().collect();
    let mut asset: Option<Asset> = None;
    for (index, &size) in sizes.iter().enumerate() {
        let bounces = plan.bounces.filter(|_| index > 0).unwrap_or(0);
        let stage = Stage::new(&set.train, size, index + 1 == sizes.len(), bounces)?;
        mesh = renew(&mesh, stage.edge())?;
        let start = match asset {
            None => begin(&stage, &mesh, &mut plan, &device)?,
            Some(asset) => stage.refine(asset, &mesh)?,
        };
        if plan.steps.len() <= index {
            // Finer levels have more of the time that is left.
            let left = 58.0 * minutes - clock.elapsed().as_secs_f64();
            let weights = sizes[index..].iter().map(|s| s + 32);
            let share = (size + 32) as f64 / weights.sum::<usize>() as f64;
            plan.steps.push(stage.steps_in(share * left, &start)?);
            plan.write(&arguments)?;
        }
        let checkpoints = arguments.out.join("steps").join(index.to_string());
        let fitted = stage.fit(start, plan.steps[index], Some(checkpoints))?;
        mesh = fitted.object.triangle_mesh()?;
        let held = set.held.iter().map(|p| p.shrunk(size));
        log.level(&fitted, &held.collect::<Result<Vec<_>>>()?, bounces)?;
        if plan.bounces.is_none() {
            let brightness = |bounces| -> Result<f64> {
                let images = fitted.compare(&stage.few(), bounces)?.images;
                Ok(images.iter().flat_map(HostImage::mean).sum())
            };
            let brighter = brightness(1)? / brightness(0)? - 1.0;
            log.line(&format!("a bounce of light adds {:.1} %", 100.0 * brighter))?;
            plan.bounces = Some(u32::from(brighter > INDIRECT));
            plan.write(&arguments)?;
        }
        asset = Some(fitted);
    }
    let asset = asset.ok_or("no level")?;
    results::write(&asset, &set, &arguments.out)?;
    log.finish(&mesh, asset.world)
}

/// The start of the first level: the better one of short fits with a light that stands in the world, and that turns with the
/// camera.
fn begin(stage: &Stage, mesh: &TriangleMesh, plan: &mut Plan, device: &Device) -> Result<Asset> {
    let attempt = |world: bool| -> Result<(f64, Asset)> {
        let asset = stage.fit(stage.begin(mesh, world, device)?, 50, None)?;
        Ok((asset.compare(&stage.few(), 0)?.psnr_srgb, asset))
    };
    if let Some(world) = plan.world {
        return Ok(attempt(world)?.1);
    }
    let (standing, turning) = (attempt(true)?, attempt(false)?);
    let (_, asset) = if turning.0 > standing.0 {
        turning
    } else {
        standing
    };
    plan.world = Some(asset.world);
    Ok(asset)
}

impl Plan {
    /// Takes up a stopped run, or begins a new one.
    fn open(arguments: &Arguments) -> Outcome<Self> {
        let (size, out) = (arguments.size, &arguments.out);
        let (steps, plan) = (out.join("steps"), out.join("plan.json"));
        if !arguments.resume && steps.exists() {
            std::fs::remove_dir_all(&steps)?;
        }
        std::fs::create_dir_all(steps)?;
        if !arguments.resume || !plan.exists() {
            return Ok(Self {
                size,
                ..Self::default()
            });
        }
        let made: Self = serde_json::from_slice(&std::fs::read(&plan)?)?;
        if made.size != size {
            return Err(format!("{} is of a run with --size {}", plan.display(), made.size).into());
        }
        Ok(made)
    }

    fn write(&self, arguments: &Arguments) -> Outcome<()> {
        Ok(std::fs::write(
            arguments.out.join("plan.json"),
            serde_json::to_vec(self)?,
        )?)
    }
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
    let train = set.load(&set.of_split(Split::Train), &options)?;
    let held = set.load(&set.of_split(Split::Test), &options)?;
    let notes = set.notes.iter().chain(&train.notes).chain(&held.notes);
    notes.for_each(|note| eprintln!("note: {note}"));
    let (mut train, mut held) = (train.photographs, held.photographs);
    if let Some(view) = train.iter().chain(&held).find(|p| !p.masked) {
        return Err(format!("{} has no mask: see docs/PHOTOGRAPHS.md", view.name).into());
    }
    let region = Region::of_masks(&train)?;
    region.make_unit(train.iter_mut().chain(&mut held));
    Ok(Set {
        train,
        held,
        region,
    })
}

/// The visual hull of the masks. If one of them cuts off a part of it, it is that of the others: a point may then be outside
/// of one mask.
fn hull(set: &Set) -> Result<TriangleMesh> {
    let masks: Vec<_> = set.train.iter().map(Photograph::silhouette).collect();
    let carve = |outside: usize| {
        let options = HullOptions::default()
            .with_resolution(96)
            .with_tolerance(outside);
        visual_hull(&masks, Region::sphere([0.0; 3], 1.0), &options)
    };
    let (tolerant, exact) = (carve(1)?, carve(0));
    let whole = |exact: &TriangleMesh| exact.volume() > 0.93 * tolerant.volume();
    let hull = exact.ok().filter(whole).unwrap_or(tolerant);
    smooth(&hull, &SmoothOptions::default())
}
