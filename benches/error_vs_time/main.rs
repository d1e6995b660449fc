//! Run time against error: `cargo bench --bench error_vs_time -- [OPTIONS]`; `--help` lists them.
//!
//! A base setting is measured over all numbers of samples, then the base with one thing changed:
//! σ, form of visibility, sampling, cutoff, float type, backend. Each point has its times, the
//! error of its image and of its gradient against the scene without blur and against what the
//! same blurred scene converges to, and its peak memory. Results are a CSV, plots, and a Markdown
//! summary on standard output.
//!
//! The gradient is that of the mean radiance under weights that rise across the image
//! (`measure::objective`) with respect to five parameters (`World::at`): the translation of one
//! object in per cent of the scene's radius, the emission of the light and the albedo of the
//! floor in per cent of themselves.

mod derivative;
mod measure;
mod plot;
mod scenes;
mod settings;
mod summary;
mod sweep;
mod table;

#[allow(dead_code)] // the examples use all of it
#[path = "../../examples/common/mod.rs"]
mod common;

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};

use clap::{Parser, Subcommand};

use sweep::Sweep;

/// What all parts may fail with.
pub type Outcome<T> = Result<T, Box<dyn Error>>;

/// Measures run time against error. In every list of settings the first is the base; the others
/// are measured with everything else at the base.
#[derive(Parser)]
#[command(name = "error_vs_time", args_conflicts_with_subcommands = true)]
struct Arguments {
    #[command(subcommand)]
    part: Option<Part>,
    #[command(flatten)]
    sweep: Sweep,
    /// What cargo passes.
    #[arg(long, hide = true, global = true)]
    bench: bool,
}

#[derive(Subcommand)]
enum Part {
    /// The derivative image of the shadow scene against differences of unblurred renders.
    Derivative(derivative::Derivative),
}

fn main() -> Outcome<()> {
    let arguments = Arguments::parse();
    common::figure::font::register();
    match &arguments.part {
        Some(Part::Derivative(d)) => derivative::run(d),
        None if arguments.sweep.peak => arguments.sweep.print_peak(),
        None => arguments.sweep.run(),
    }
}

/// A file of the tests.
pub fn data(path: &Path) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data")
        .join(path)
}

/// The folder of results, made if it is not there.
pub fn results(out: &Option<PathBuf>) -> Outcome<PathBuf> {
    let usual = || Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/error_vs_time/results");
    let folder = out.clone().unwrap_or_else(usual);
    fs::create_dir_all(&folder)?;
    Ok(folder)
}
