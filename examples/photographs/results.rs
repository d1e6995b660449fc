//! What a run writes: numbers, pictures, and the asset.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use burn::module::Module;
use serde_json::{Value, json};
use softray::Result;
use softray::figure::Relighting;
use softray::meshing::TriangleMesh;
use softray::modules::{AssetLevel, AssetParams};
use softray::photographs::{ObjectPhotographs, Photograph};

use super::{Outcome, measuring};

/// The log, and the numbers of all levels.
pub struct Log {
    out: PathBuf,
    clock: Instant,
    levels: Vec<Value>,
}

impl Log {
    pub fn new(out: &Path, clock: Instant) -> Self {
        let (out, levels) = (out.into(), Vec::new());
        Self { out, clock, levels }
    }

    pub fn line(&self, text: &str) -> Outcome<()> {
        let line = format!("{:6.1} s  {text}\n", self.clock.elapsed().as_secs_f64());
        eprint!("{line}");
        let mut log = fs::OpenOptions::new();
        let log = log.append(true).create(true).open(self.out.join("log.txt"));
        Ok(log?.write_all(line.as_bytes())?)
    }

    /// Measures held-out views at the end of a level, and draws them.
    pub fn level(&mut self, asset: &AssetParams, held: &[Photograph], bounces: u32) -> Outcome<()> {
        let found = asset.compare(held, &measuring(bounces), false)?;
        found.figure(held, 6)?.write(self.out.join("views.png"))?;
        let mut numbers = json!(found);
        let last = asset.object.normal_map.is_some();
        if let Some(viewpoints) = asset.viewpoints.as_ref().filter(|_| last) {
            // The poses of held-out photographs are as inexact.
            let level = AssetLevel::new(held, held[0].camera.size.into_iter().max().unwrap_or(0))?;
            let found = level.with_bounces(bounces).register(asset, 40)?;
            let found = found.compare(held, &measuring(bounces), true)?;
            numbers["poses_refined"] = json!(found);
            numbers["poses_moved_degrees"] = viewpoints.median_move()?.into();
        }
        numbers["pixels"] = json!(held.first().map(|p| p.camera.size));
        numbers["faces"] = asset.object.mesh.mesh().faces.len().into();
        self.line(&format!("{numbers}"))?;
        self.levels.push(numbers);
        Ok(())
    }

    /// Writes `metrics.json`.
    pub fn finish(self, mesh: &TriangleMesh, stands: bool) -> Outcome<()> {
        let numbers = json!({
            "levels": self.levels,
            "light": if stands { "stands in the world" } else { "turns with the camera" },
            "seconds": self.clock.elapsed().as_secs_f64(),
            "peak_memory_bytes": peak_memory(),
            "mesh": mesh.statistics()?,
        });
        fs::write(self.out.join("metrics.json"), format!("{numbers:#}"))?;
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
pub fn write(asset: &AssetParams, set: &ObjectPhotographs, out: &Path) -> Result<()> {
    asset.write(out, &set.region)?;
    let side = set.train[0].camera.size[0].clamp(128, 320);
    let relighting = Relighting::new(&asset.valid().object.object()?, set.up())?;
    relighting.figure(side)?.write(out.join("relit.png"))?;
    relighting.turntable(side)?.write(out.join("turntable.gif"))
}
