//! How far from its target a fit may start: `cargo bench --bench basins`. Prints the tables of
//! `docs/BASINS.md` and draws its plot.
#![allow(dead_code, clippy::duplicate_mod)] // examples are programs of their own

use std::path::PathBuf;

use burn::module::Module;
use burn::optim::AdamConfig;
use clap::Parser;
use softray::optim::{BlurSchedule, Fit, Rate, Step};
use softray::prelude::*;

#[path = "../examples/camera_pose.rs"]
mod camera_pose;
#[path = "../examples/fig2_shadow.rs"]
mod fig2_shadow;
#[path = "../examples/fig3_indirect.rs"]
mod fig3_indirect;
#[path = "../examples/mirror.rs"]
mod mirror;

type Failure = Box<dyn std::error::Error>;

/// Fits from further and further away, with constant and with falling blur.
#[derive(Parser)]
struct Arguments {
    /// Seeds; a start counts if all of them arrive.
    #[arg(long, default_value_t = 2)]
    seeds: u64,
    /// Steps of a fit.
    #[arg(long, default_value_t = 150)]
    steps: usize,
    /// Rows and columns of the images.
    #[arg(long, default_value_t = 32)]
    size: usize,
    /// Folder for the plot.
    #[arg(long, default_value = "out")]
    out: PathBuf,
    /// Passed by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

/// Half-angles of cones at the start and at the end, in pixels.
const SCHEDULES: [(f64, f64); 4] = [(0.5, 0.5), (6.0, 0.5), (12.0, 0.5), (24.0, 0.5)];

/// What arrives ends with an error of less than this share of the first start's.
const ARRIVED: f64 = 0.1;

/// A line of the table: for each schedule and start the largest error of all seeds.
struct Sweep {
    name: &'static str,
    unit: &'static str,
    starts: Vec<f64>,
    errors: Vec<Vec<f64>>,
}

macro_rules! sweep {
    ($example:ident, $problem:expr, $name:literal, $unit:literal, $first:expr, $arguments:expr, $rate:expr) => {{
        use $example::common::study::Problem;
        let problem = $problem;
        let pixel = problem.pixel()?;
        let starts: Vec<f64> = [1.0, 1.5, 2.0, 2.5, 3.0, 4.0]
            .iter()
            .map(|share| share * $first)
            .collect();
        let mut errors = Vec::new();
        for (wide, narrow) in SCHEDULES {
            let steps = $arguments.steps * 2 / 3;
            let schedule = BlurSchedule::decay(wide * pixel, narrow * pixel, steps)?;
            let mut of_schedule = Vec::new();
            for &start in &starts {
                let mut largest = 0.0f64;
                for seed in 0..$arguments.seeds {
                    let fit = Fit::new(problem.start(start), adam(), $arguments.steps)
                        .with_rate(Rate::exponential($rate, 0.1 * $rate))
                        .with_blur(schedule.clone())
                        .with_seed(seed)
                        .with_progress(false);
                    let error = end(fit, |m, s| problem.evaluate(m, s), |m| problem.error(m));
                    largest = largest.max(error);
                }
                eprintln!("{} from {start:.2}: {largest:.3}", $name);
                of_schedule.push(largest);
            }
            errors.push(of_schedule);
        }
        Sweep {
            name: $name,
            unit: $unit,
            starts,
            errors,
        }
    }};
}

fn adam() -> burn::optim::ModuleOptimizer {
    AdamConfig::new().with_beta_2(0.99).init()
}

/// The error at the end of a fit; infinite if it leaves what can be rendered.
fn end<M: Module>(
    fit: Fit<M>,
    evaluate: impl FnMut(&M, &Step) -> softray::Result<softray::optim::Evaluation>,
    error: impl Fn(&M) -> f64,
) -> f64 {
    fit.run(evaluate)
        .map_or(f64::INFINITY, |f| error(&f.module))
}

fn main() -> Result<(), Failure> {
    let a = Arguments::parse();
    let device = Device::flex();
    let shadow = fig2_shadow::Shadow::new(a.size, &device)?;
    let posed = camera_pose::Posed::new(a.size, &device)?;
    let indirect = fig3_indirect::Indirect::new(a.size, &device)?;
    let reflected = mirror::Mirror::new(a.size, &device)?;
    let sweeps = [
        sweep!(fig2_shadow, shadow, "shadow", "scene units", 0.6, a, 0.06),
        sweep!(camera_pose, posed, "pose", "scene units", 0.6, a, 0.03),
        sweep!(fig3_indirect, indirect, "indirect", "°", 10.0, a, 0.02),
        sweep!(mirror, reflected, "mirror", "scene units", 0.5, a, 0.03),
    ];
    for sweep in &sweeps {
        println!("\n### {}, {}\n", sweep.name, sweep.unit);
        let starts: Vec<String> = sweep.starts.iter().map(|s| format!("{s:.2}")).collect();
        println!(
            "| cones, pixels | from {} | arrives from |",
            starts.join(" | ")
        );
        println!("|---|{}---|", "---|".repeat(starts.len()));
        for ((wide, narrow), errors) in SCHEDULES.iter().zip(&sweep.errors) {
            let blur = if wide == narrow {
                format!("{wide}")
            } else {
                format!("{wide} → {narrow}")
            };
            let cells: Vec<String> = errors.iter().map(|e| format!("{e:.3}")).collect();
            let reached = reach(sweep, errors);
            let reached = reached.map_or("—".into(), |s| format!("{s:.2}"));
            println!("| {blur} | {} | {reached} |", cells.join(" | "));
        }
    }
    draw(&a, &sweeps)
}

/// The largest start from which this one and all nearer ones arrive.
fn reach(sweep: &Sweep, errors: &[f64]) -> Option<f64> {
    let goal = ARRIVED * sweep.starts[0];
    let arrived = errors.iter().take_while(|&&e| e < goal).count();
    arrived.checked_sub(1).map(|last| sweep.starts[last])
}

fn draw(arguments: &Arguments, sweeps: &[Sweep]) -> Result<(), Failure> {
    use softray::figure::{Figure, Plot};
    let mut figure = Figure::new("Error at the end over the distance at the start");
    for sweep in sweeps {
        let mut plot = Plot::new(sweep.name, sweep.unit, "").with_log_scale();
        for ((wide, narrow), errors) in SCHEDULES.iter().zip(&sweep.errors) {
            let points = sweep.starts.iter().copied().zip(errors.iter().copied());
            plot = plot.with_curve(format!("{wide} → {narrow} px"), points);
        }
        figure = figure.with_plot(plot.with_line("arrived", ARRIVED * sweep.starts[0]));
    }
    std::fs::create_dir_all(&arguments.out)?;
    let path = arguments.out.join("basins.png");
    figure.write(&path)?;
    println!("\nwrote {}", path.display());
    Ok(())
}
