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
mod table;

#[allow(dead_code)] // the examples use all of it
#[path = "../../examples/common/mod.rs"]
mod common;
#[path = "../font/mod.rs"]
mod font;

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};

use clap::{Parser, Subcommand};
use indicatif::ProgressBar;

use measure::{Effort, Reference};
use scenes::Subject;
use settings::{Axis, Backward, Float, Form, Sampler, Setting};
use table::{Column, Row, SceneSize};

/// What all parts may fail with.
pub type Outcome<T> = Result<T, Box<dyn Error>>;

/// Measures run time against error. In every list of settings the first is the base; the others
/// are measured with everything else at the base.
#[derive(Parser)]
#[command(args_conflicts_with_subcommands = true)]
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

#[derive(clap::Args)]
struct Sweep {
    /// Scenes [default: all but cornell3 and motion].
    #[arg(long, value_delimiter = ',')]
    scene: Vec<Subject>,
    /// What to vary beside the samples [default: all].
    #[arg(long, value_delimiter = ',')]
    sweep: Option<Vec<Axis>>,
    /// Only the base is measured, over all samples.
    #[arg(long, conflicts_with = "sweep")]
    base_only: bool,
    /// Samples a pixel [default: 1,4,16,64,256].
    #[arg(long, value_delimiter = ',')]
    samples: Vec<u32>,
    /// σ, scene units squared.
    #[arg(long, value_delimiter = ',', default_value = "1e-4,1e-5,1e-3,1e-2")]
    sigma: Vec<f64>,
    /// Forms of visibility: layered, layered-soft:γ, softmax:γ.
    #[arg(
        long,
        value_delimiter = ',',
        default_value = "layered,layered-soft:1e-2,softmax:1e-3,softmax:1e-2"
    )]
    form: Vec<Form>,
    /// Ways to sample [default: all, `default` the base].
    #[arg(long, value_delimiter = ',')]
    sampling: Vec<Sampler>,
    /// Cutoffs.
    #[arg(
        long,
        value_delimiter = ',',
        default_value = "1e-4,1e-2,1e-3,1e-6,1e-8"
    )]
    cutoff: Vec<f64>,
    /// Float types.
    #[arg(long, value_delimiter = ',', default_value = "f32,f64")]
    dtype: Vec<Float>,
    /// Backends: flex, ndarray, and wgpu and vulkan where they are built in.
    #[arg(long, value_delimiter = ',', default_value = "flex,ndarray")]
    device: Vec<String>,
    /// How gradients are made: `tape` needs memory in proportion to the samples and one core,
    /// `replay` traces the paths twice on all.
    #[arg(long, value_delimiter = ',', default_value = "replay,tape")]
    backward: Vec<Backward>,
    /// Independent seeds a point; errors are root mean squares over them [default: 8].
    #[arg(long)]
    seeds: Option<u32>,
    /// Seconds of forward + backward passes of a point after which half of the seeds are enough;
    /// the table says how many there were.
    #[arg(long, default_value_t = 10.0)]
    patience: f64,
    /// The most runs that the time of a forward pass is the best of [default: 3]. That of forward +
    /// backward is the best of all seeds.
    #[arg(long)]
    runs: Option<u32>,
    /// Samples a pixel of each render that others are compared with [default: 512].
    #[arg(long)]
    reference_samples: Option<u32>,
    /// How many of them are averaged [default: 8].
    #[arg(long)]
    reference_seeds: Option<u32>,
    /// How they are sampled. That errors against them vanish for other samplings too is a test of
    /// both.
    #[arg(long, default_value = "default")]
    reference_sampling: Sampler,
    /// Peak memory is not measured, which takes a process of its own for each point.
    #[arg(long)]
    no_memory: bool,
    /// A minute or two: shadow and cornell, few samples, seeds and references; for what is named
    /// that counts.
    #[arg(long)]
    quick: bool,
    /// Goes on with the table in the folder: what it has is not measured again. With everything
    /// in it, plots and summary are made anew.
    #[arg(long)]
    keep: bool,
    /// Folder for table and plots [default: benches/error_vs_time/results].
    #[arg(long)]
    out: Option<PathBuf>,
    /// Prints the peak memory of one forward and backward pass of the base, MiB.
    #[arg(long, hide = true)]
    peak: bool,
}

fn main() -> Outcome<()> {
    let arguments = Arguments::parse();
    font::register();
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

fn or<T: Clone>(given: &[T], usual: &[T]) -> Vec<T> {
    if given.is_empty() { usual } else { given }.to_vec()
}

impl Sweep {
    fn scenes(&self) -> Vec<Subject> {
        let quick = [Subject::Shadow, Subject::Cornell];
        let usual: &[Subject] = if self.quick { &quick } else { &scenes::USUAL };
        or(&self.scene, usual)
    }

    fn samples(&self) -> Vec<u32> {
        let usual: &[u32] = if self.quick {
            &[1, 4, 16]
        } else {
            &[1, 4, 16, 64, 256]
        };
        or(&self.samples, usual)
    }

    fn effort(&self) -> Effort {
        let pick = |given: Option<u32>, usual, quick| {
            given
                .unwrap_or(if self.quick { quick } else { usual })
                .max(1)
        };
        Effort {
            seeds: pick(self.seeds, 8, 3),
            patience: self.patience,
            runs: pick(self.runs, 3, 2),
            reference_samples: pick(self.reference_samples, 512, 64),
            reference_seeds: pick(self.reference_seeds, 8, 2).max(2),
            reference_sampling: self.reference_sampling,
        }
    }

    fn samplings(&self) -> Vec<Sampler> {
        or(
            &self.sampling,
            &[
                Sampler::Default,
                Sampler::Plain,
                Sampler::PlainSequence,
                Sampler::PlainEmitters,
                Sampler::PlainSurfaces,
                Sampler::WithoutMis,
            ],
        )
    }

    /// The base and its variations.
    fn settings(&self) -> Outcome<Vec<Setting>> {
        let samplings = self.samplings();
        fn first<T: Clone>(list: &[T]) -> Outcome<T> {
            Ok(list.first().ok_or("an empty list of settings")?.clone())
        }
        let base = Setting {
            sigma: first(&self.sigma)?,
            form: first(&self.form)?,
            sampling: first(&samplings)?,
            cutoff: first(&self.cutoff)?,
            dtype: first(&self.dtype)?,
            device: first(&self.device)?,
            backward: first(&self.backward)?,
        };
        let mut all = vec![base.clone()];
        let mut vary = |axis: Axis, count: usize, change: &dyn Fn(&mut Setting, usize)| {
            let swept = self.sweep.as_ref().is_none_or(|s| s.contains(&axis));
            if self.base_only || !swept {
                return;
            }
            for i in 1..count {
                let mut setting = base.clone();
                change(&mut setting, i);
                all.push(setting);
            }
        };
        vary(Axis::Sampling, samplings.len(), &|s, i| {
            s.sampling = samplings[i];
        });
        vary(Axis::Sigma, self.sigma.len(), &|s, i| {
            s.sigma = self.sigma[i];
        });
        vary(Axis::Form, self.form.len(), &|s, i| s.form = self.form[i]);
        vary(Axis::Cutoff, self.cutoff.len(), &|s, i| {
            s.cutoff = self.cutoff[i];
        });
        vary(Axis::Dtype, self.dtype.len(), &|s, i| {
            s.dtype = self.dtype[i];
        });
        vary(Axis::Device, self.device.len(), &|s, i| {
            s.device = self.device[i].clone();
        });
        vary(Axis::Backward, self.backward.len(), &|s, i| {
            s.backward = self.backward[i];
        });
        for setting in &all {
            setting.device()?;
        }
        Ok(all)
    }

    fn print_peak(&self) -> Outcome<()> {
        let setting = &self.settings()?[0];
        let subject = self.scenes()[0];
        let world = subject.build(&setting.device()?, setting.dtype.dtype())?;
        measure::once(&world, setting, self.samples()[0])?;
        if let Some(peak) = measure::peak() {
            println!("{peak}");
        }
        Ok(())
    }

    fn run(&self) -> Outcome<()> {
        let folder = results(&self.out)?;
        let table = folder.join("points.csv");
        let settings = self.settings()?;
        let mut rows = if self.keep && table.exists() {
            table::read(&table)?
        } else {
            Vec::new()
        };
        let work = Work::new(self, &settings, &rows);
        let bar = common::bar(work.total(), "");
        for scene in &work.scenes {
            scene.measure(self, &mut rows, &table, &bar)?;
            plot::scene(&folder, &scene.subject.name(), &rows, &settings[0])?;
        }
        bar.finish_and_clear();
        println!("{}", summary::markdown(&rows, &settings[0]));
        eprintln!("{}", table.display());
        Ok(())
    }
}

/// What is still to be measured.
struct Work {
    scenes: Vec<SceneWork>,
}

struct SceneWork {
    subject: Subject,
    effort: Effort,
    /// Each with the samples that are missing.
    settings: Vec<(Setting, Vec<u32>)>,
}

impl Work {
    fn new(sweep: &Sweep, settings: &[Setting], rows: &[Row]) -> Self {
        let scene = |subject: Subject| {
            let name = subject.name();
            let missing = |s: &Setting| {
                let mut samples = sweep.samples();
                samples.retain(|&n| !rows.iter().any(|r| r.is(&name, s, n)));
                (s.clone(), samples)
            };
            let suited = settings.iter().filter(|s| subject.suits(s));
            SceneWork {
                subject,
                effort: sweep.effort(),
                settings: suited.map(missing).filter(|s| !s.1.is_empty()).collect(),
            }
        };
        Self {
            scenes: sweep.scenes().into_iter().map(scene).collect(),
        }
    }

    fn total(&self) -> u64 {
        self.scenes.iter().map(SceneWork::total).sum()
    }
}

/// A forward and backward pass takes about so many times a forward pass, for the progress bar.
const BACKWARD: u64 = 3;

impl SceneWork {
    /// Samples a pixel, weighted by what is done with them.
    fn total(&self) -> u64 {
        if self.settings.is_empty() {
            return 0;
        }
        let mut blurred: Vec<&Setting> = Vec::new();
        for (s, _) in &self.settings {
            if !blurred.iter().any(|b| b.same_limit(s)) {
                blurred.push(s);
            }
        }
        let points: u64 = self
            .settings
            .iter()
            .flat_map(|(_, samples)| samples)
            .map(|&n| self.weight(n))
            .sum();
        let images = 2 * scenes::PARAMETERS as u64 + u64::from(self.is_made());
        let references = BACKWARD * blurred.len() as u64 + images;
        let e = &self.effort;
        points + references * u64::from(e.reference_samples) * u64::from(e.reference_seeds)
    }

    fn is_made(&self) -> bool {
        matches!(self.subject.reference(), Ok(None))
    }

    fn weight(&self, samples: u32) -> u64 {
        u64::from(samples) * (BACKWARD * u64::from(self.effort.seeds) + u64::from(self.effort.runs))
    }

    /// Measures what is missing; the table is written after every setting.
    fn measure(
        &self,
        sweep: &Sweep,
        rows: &mut Vec<Row>,
        table: &Path,
        bar: &ProgressBar,
    ) -> Outcome<()> {
        if self.settings.is_empty() {
            return Ok(());
        }
        let (subject, effort) = (self.subject, &self.effort);
        bar.set_message(format!("{}: without blur", subject.name()));
        bar.tick();
        let unblurred = Reference::unblurred(subject, effort, |n| bar.inc(n))?;
        let mut converged: Vec<(&Setting, Reference)> = Vec::new();
        for (setting, samples) in &self.settings {
            let label = setting.label(&self.settings[0].0);
            let blurred = match converged.iter().position(|c| c.0.same_limit(setting)) {
                Some(i) => &converged[i].1,
                None => {
                    bar.set_message(format!("{}, {label}: converged", subject.name()));
                    let found =
                        Reference::blurred(subject, setting, effort, |n| bar.inc(BACKWARD * n))?;
                    converged.push((setting, found));
                    &converged.last().expect("it was just put there").1
                }
            };
            let world = subject.build(&setting.device()?, setting.dtype.dtype())?;
            // Threads, caches and pages of memory are there before anything is timed.
            measure::once(&world, setting, samples[0])?;
            for &samples in samples {
                bar.set_message(format!("{}, {label}, {samples}", subject.name()));
                let (seeds, mut values) =
                    measure::point(&world, setting, samples, effort, &unblurred, blurred)?;
                if !sweep.no_memory
                    && let Some(peak) = measure::peak_of(subject, setting, samples)?
                {
                    values.set(Column::Peak, peak);
                }
                rows.push(Row {
                    size: SceneSize {
                        scene: subject.name(),
                        bounces: world.bounces,
                        width: world.width,
                        height: world.height,
                        faces: world.faces,
                    },
                    setting: setting.clone(),
                    samples,
                    seeds,
                    threads: rayon::current_num_threads(),
                    values,
                });
                bar.inc(self.weight(samples));
            }
            table::write(table, rows)?;
        }
        Ok(())
    }
}
