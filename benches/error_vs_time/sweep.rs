//! The command line of a measurement, and its course.

use std::path::{Path, PathBuf};

use indicatif::ProgressBar;

use crate::measure::{self, Effort, Point, Reference};
use crate::scenes::{self, Subject};
use crate::settings::{Axis, Backward, Float, Form, Sampler, Setting};
use crate::table::{self, Column, Row, SceneSize};
use crate::{Outcome, common, plot, results, summary};

#[derive(clap::Args)]
pub struct Sweep {
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
    /// The most runs that the time of a forward pass is the best of [default: 8]. That of forward +
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
    /// A minute or two: shadow and cornell, few samples, seeds and references. Other options
    /// override it.
    #[arg(long)]
    quick: bool,
    /// Goes on with the table in the folder: what it has is not measured again. With everything
    /// in it, plots and summary are made anew. Ratios
    /// of times are of one run only where whole scenes were missing.
    #[arg(long)]
    keep: bool,
    /// Folder for table and plots [default: benches/error_vs_time/results].
    #[arg(long)]
    out: Option<PathBuf>,
    /// Prints the peak memory of one forward and backward pass of the base, MiB.
    #[arg(long, hide = true)]
    pub peak: bool,
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
            runs: pick(self.runs, 8, 3),
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

    pub fn print_peak(&self) -> Outcome<()> {
        let setting = &self.settings()?[0];
        let subject = self.scenes()[0];
        let world = subject.build(&setting.device()?, setting.dtype.dtype())?;
        measure::once(&world, setting, self.samples()[0])?;
        if let Some(peak) = measure::peak() {
            println!("{peak}");
        }
        Ok(())
    }

    pub fn run(&self) -> Outcome<()> {
        let settings = self.settings()?;
        let folder = results(&self.out)?;
        let table = folder.join("points.csv");
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

    /// Measures what is missing; the table is written after every number of samples.
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
        let name = subject.name();
        let say = |what: String| {
            bar.set_message(format!("{name}: {what}"));
            bar.tick();
        };
        say("without blur".to_owned());
        let unblurred = Reference::unblurred(subject, effort, |n| bar.inc(n))?;
        let mut converged: Vec<(&Setting, Reference)> = Vec::new();
        let mut worlds = Vec::new();
        for (setting, samples) in &self.settings {
            if !converged.iter().any(|c| c.0.same_limit(setting)) {
                say(format!("σ {:e}, {}", setting.sigma, setting.form.label()));
                let each = |n| bar.inc(BACKWARD * n);
                let found = Reference::blurred(subject, setting, effort, each)?;
                converged.push((setting, found));
            }
            let world = subject.build(&setting.device()?, setting.dtype.dtype())?;
            // Threads, caches and pages of memory are there before anything is timed.
            measure::once(&world, setting, samples[0])?;
            worlds.push(world);
        }
        for n in sweep.samples() {
            let due = self.settings.iter().zip(&worlds);
            let mut points: Vec<Point> = due
                .filter(|((_, samples), _)| samples.contains(&n))
                .filter_map(|((setting, _), world)| {
                    let limit = converged.iter().find(|c| c.0.same_limit(setting))?;
                    Some(Point::new(world, setting, n, &unblurred, &limit.1))
                })
                .collect();
            let rounds = effort.seeds.max(effort.runs);
            for round in 0..rounds {
                say(format!("{n} samples, round {} of {rounds}", round + 1));
                for point in &mut points {
                    point.round(round, effort)?;
                    bar.inc(self.weight(n) / u64::from(rounds));
                }
            }
            say(format!("{n} samples, memory"));
            for point in points {
                let mut values = point.values();
                if !sweep.no_memory
                    && let Some(peak) = measure::peak_of(subject, point.setting, n)?
                {
                    values.set(Column::Peak, peak);
                }
                rows.push(Row {
                    size: SceneSize {
                        scene: name.clone(),
                        bounces: point.world.bounces,
                        width: point.world.width,
                        height: point.world.height,
                        faces: point.world.faces,
                    },
                    setting: point.setting.clone(),
                    samples: n,
                    seeds: point.seeds,
                    threads: rayon::current_num_threads(),
                    values,
                });
            }
            table::write(table, rows)?;
        }
        Ok(())
    }
}
