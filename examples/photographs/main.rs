//! From photographs with cameras and masks to a mesh with textures, and the light: `photographs FOLDER`.
//!
//! Levels go from coarse to fine. All but the last move the mesh, which is made even and sound again before each; the last
//! has textures as fine as the photographs, with a normal map. See docs/PHOTOGRAPHS.md.

pub(crate) mod results;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::Parser;
use serde::{Deserialize, Serialize};
use softray::Result;
use softray::meshing::{HullOptions, SmoothOptions, TriangleMesh, renew, smooth};
use softray::modules::{AssetLevel, AssetParams};
use softray::optim::Comparison;
use softray::photographs::{Dialect, ObjectPhotographs, PhotographOptions};
use softray::prelude::*;

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
    pub folder: PathBuf,
    pub size: usize,
    pub hold_out: usize,
    /// The time that has been used.
    pub seconds: f64,
    /// Whether the light stands in the world.
    pub world: Option<bool>,
    /// Bounces of light, from the second level on.
    pub bounces: Option<u32>,
    /// Steps of the levels.
    pub steps: Vec<usize>,
}

pub(crate) type Outcome<T> = std::result::Result<T, Box<dyn std::error::Error>>;

fn main() -> Outcome<()> {
    env_logger::Builder::from_env(env_logger::Env::default().default_filter_or("error")).init();
    run(Arguments::parse())
}

pub(crate) fn run(mut arguments: Arguments) -> Outcome<()> {
    if arguments.quick {
        arguments.size = 64;
    }
    let size = arguments.size;
    let minutes = arguments.minutes.unwrap_or(match (arguments.quick, size) {
        (true, _) => 0.6,
        (_, ..=128) => 2.0,
        (_, ..=256) => 10.0,
        _ => 30.0,
    });
    let device = softray::device::named(arguments.device.as_deref())?;
    let mut plan = Plan::open(&arguments)?;
    let used = Duration::from_secs_f64(plan.seconds);
    let now = Instant::now();
    let clock = now.checked_sub(used).unwrap_or(now);
    let mut log = results::Log::new(&arguments.out, clock);
    let options = PhotographOptions::new().with_longest_side(size);
    let set = ObjectPhotographs::open(&arguments.folder, arguments.hold_out, options)?;
    let hull = set.visual_hull(&HullOptions::default().with_resolution(96))?;
    let mut mesh = smooth(&hull, &SmoothOptions::default())?;
    set.notes.iter().try_for_each(|note| log.line(note))?;
    let [train, held] = [set.train.len(), set.held_out.len()];
    log.line(&format!("{train} photographs, {held} held out"))?;

    // Sizes that double from about 32 pixels on, and the whole size again.
    let halved = (0..).map(|k| size >> k).take_while(|&s| s >= size.min(32));
    let sizes: Vec<usize> = std::iter::once(size).chain(halved).collect();
    let mut asset: Option<AssetParams> = None;
    for (index, &pixels) in sizes.iter().rev().enumerate() {
        let bounces = plan.bounces.filter(|_| index > 0).unwrap_or(0);
        let level = AssetLevel::new(&set.train, pixels)?
            .with_still_mesh(index + 1 == sizes.len())
            .with_bounces(bounces);
        mesh = renew(&mesh, level.edge())?;
        let mut start = match asset {
            None => begin(&level, &mesh, &mut plan, &device)?,
            Some(asset) => level.refine(asset, &mesh)?,
        };
        // Structure from motion finds poses only nearly.
        if set.dialect == Dialect::Colmap && start.viewpoints.is_none() && 2 * pixels >= size {
            start = start.with_viewpoints(&level.photographs)?;
        }
        if plan.steps.len() <= index {
            // Finer levels have more of the time that is left.
            let left = 58.0 * minutes - clock.elapsed().as_secs_f64();
            let weights = sizes[..sizes.len() - index].iter().map(|s| s + 32);
            let share = (pixels + 32) as f64 / weights.sum::<usize>() as f64;
            let time = Duration::from_secs_f64((share * left).max(0.0));
            plan.steps.push(level.steps_within(time, &start)?);
            plan.seconds = clock.elapsed().as_secs_f64();
            plan.write(&arguments.out)?;
        }
        let checkpoints = arguments.out.join("steps").join(index.to_string());
        let fitted = level.fit(start, plan.steps[index], Some(&checkpoints))?;
        mesh = fitted.object.triangle_mesh()?;
        let held = set.held_out.iter().map(|p| p.shrunk(pixels));
        log.level(&fitted, &held.collect::<Result<Vec<_>>>()?, bounces)?;
        if plan.bounces.is_none() {
            let brightness = |bounces| -> Result<f64> {
                let images = compare_few(&level, &fitted, bounces)?.images;
                Ok(images.iter().flat_map(HostImage::mean).sum())
            };
            let brighter = brightness(1)? / brightness(0)? - 1.0;
            log.line(&format!("a bounce of light adds {:.1} %", 100.0 * brighter))?;
            plan.bounces = Some(u32::from(brighter > 0.01));
            plan.write(&arguments.out)?;
        }
        asset = Some(fitted);
    }
    let asset = asset.ok_or("no level")?;
    results::write(&asset, &set, &arguments.out)?;
    log.finish(&mesh, asset.light_stands)
}

/// The options of renders that are compared with photographs.
pub(crate) fn measuring(bounces: u32) -> RenderOptions {
    let options = RenderOptions::new(1, 1).with_samples(64);
    options.with_bounces(bounces)
}

/// Compares renders with about eight of the photographs of a level.
fn compare_few(level: &AssetLevel, asset: &AssetParams, bounces: u32) -> Result<Comparison> {
    let all = &level.photographs;
    let few: Vec<_> = all.iter().step_by(all.len().div_ceil(8)).cloned().collect();
    asset.compare(&few, &measuring(bounces), false)
}

/// The start of the first level: the better one of short fits with a light that stands in the world, and that turns with the
/// camera.
fn begin(
    level: &AssetLevel,
    mesh: &TriangleMesh,
    plan: &mut Plan,
    device: &Device,
) -> Result<AssetParams> {
    let attempt = |stands| level.fit(level.begin(mesh, stands, device)?, 50, None);
    if let Some(stands) = plan.world {
        return attempt(stands);
    }
    let (standing, turning) = (attempt(true)?, attempt(false)?);
    let [still, turned] = [&standing, &turning].map(|asset| compare_few(level, asset, 0));
    let stands = still?.psnr_srgb >= turned?.psnr_srgb;
    plan.world = Some(stands);
    Ok(if stands { standing } else { turning })
}

impl Plan {
    /// Takes up a stopped run, or begins a new one.
    fn open(arguments: &Arguments) -> Outcome<Self> {
        let file = arguments.out.join("plan.json");
        let new = Self {
            folder: arguments.folder.clone(),
            size: arguments.size,
            hold_out: arguments.hold_out,
            ..Self::default()
        };
        if arguments.resume && file.exists() {
            let made: Self = serde_json::from_slice(&fs::read(&file)?)?;
            let settings = |plan: &Self| (plan.folder.clone(), plan.size, plan.hold_out);
            let (path, run) = (file.display(), settings(&made));
            let other = format!("{path}: a run of other (folder, size, n): {run:?}");
            let same = settings(&made) == settings(&new);
            return same.then_some(made).ok_or(other.into());
        }
        fs::create_dir_all(&arguments.out)?;
        if arguments.out.join("steps").exists() {
            fs::remove_dir_all(arguments.out.join("steps"))?;
        }
        fs::write(arguments.out.join("log.txt"), "")?;
        new.write(&arguments.out)?;
        Ok(new)
    }

    /// Replaces the file in one go.
    fn write(&self, out: &Path) -> Outcome<()> {
        let [new, file] = ["plan.json.new", "plan.json"].map(|name| out.join(name));
        fs::write(&new, serde_json::to_vec(self)?)?;
        Ok(fs::rename(new, file)?)
    }
}
