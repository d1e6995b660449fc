//! The figures of docs/BLUR.md: what σ and γ do to images, gradients, losses and fits.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

use burn::module::Param;
use burn::optim::{AdamConfig, GradientsParams};
use clap::{Parser, Subcommand};
use rayon::prelude::*;
use softray::loss;
use softray::optim::pixel_footprint;
use softray::prelude::*;
use softray::scene::Flattened;

#[path = "../benches/font/mod.rs"]
mod font;

type Failure = Box<dyn Error>;

/// Measures what the blurs σ and γ do; prints Markdown tables and writes plots.
#[derive(Parser)]
struct Arguments {
    #[command(subcommand)]
    study: Study,
    /// Folder for plots.
    #[arg(long, default_value = "docs/blur", global = true)]
    out: PathBuf,
}

#[derive(Subcommand)]
enum Study {
    /// The image against unblurred references, over σ and over γ.
    Bias {
        /// Paths a pixel of each of two renders; an eighth of them from √σ = 1 pixel on.
        #[arg(long, default_value_t = 1024)]
        samples: u32,
    },
    /// A gradient's noise and bias, over σ and over γ.
    Gradient {
        /// Paths a pixel of one gradient.
        #[arg(long, default_value_t = 16)]
        samples: u32,
        /// Independent gradients.
        #[arg(long, default_value_t = 64)]
        seeds: u64,
    },
    /// The loss over a translation and the basin around its least value, over σ.
    Landscape {
        /// Paths a pixel of one gradient; twice as many in an image for the loss, and eight times
        /// up to √σ = 1 pixel.
        #[arg(long, default_value_t = 4)]
        samples: u32,
        /// Independent losses a place.
        #[arg(long, default_value_t = 6)]
        seeds: u64,
        /// shadow, sphere, lens or cornell.
        #[arg(long, value_delimiter = ',', default_values = ["shadow", "sphere"])]
        scene: Vec<String>,
    },
    /// Fits of a translation with a constant and with a decaying σ.
    Fit {
        /// shadow, sphere, lens or cornell.
        #[arg(long, default_value = "shadow")]
        scene: String,
        /// Where the object starts.
        #[arg(long, value_delimiter = ',', default_values_t = [0.8, 1.2])]
        from: Vec<f64>,
        /// Paths a pixel of one step.
        #[arg(long, default_value_t = 8)]
        samples: u32,
        /// Steps of a fit.
        #[arg(long, default_value_t = 80)]
        steps: usize,
        /// Independent fits.
        #[arg(long, default_value_t = 4)]
        seeds: u64,
    },
}

fn main() -> Result<(), Failure> {
    let arguments = Arguments::parse();
    font::register();
    std::fs::create_dir_all(&arguments.out)?;
    let out = &arguments.out;
    let start = Instant::now();
    match &arguments.study {
        Study::Bias { samples } => bias(out, *samples)?,
        Study::Gradient { samples, seeds } => gradient(out, *samples, *seeds)?,
        Study::Landscape {
            samples,
            seeds,
            scene,
        } => landscape(out, scene, *samples, *seeds)?,
        Study::Fit {
            scene,
            from,
            samples,
            steps,
            seeds,
        } => fit(out, scene, from, *samples, *steps, *seeds)?,
    }
    eprintln!("{:.0} s", start.elapsed().as_secs_f64());
    Ok(())
}

/// Rows and columns of the images of gradients, losses and fits.
const SIZE: usize = 32;

/// A reference scene, one object of which moves along x.
struct Case {
    object: &'static str,
    bounces: u32,
    file: SceneFile,
    /// Those of the scene as it is: the same wherever the object is.
    bounds: Bounds,
    /// The mean edge of the object.
    edge: f64,
}

impl Case {
    fn load(name: &str) -> Result<Self, Failure> {
        let (object, bounces) = match name {
            "shadow" => ("occluder", 0),
            "cornell" => ("short", 1),
            "lens" => ("ball1", 0),
            _ => ("sphere", 0),
        };
        let file = SceneFile::load(data(&format!("{name}/scene.json")), &Device::flex())?;
        let bounds = Flattened::new(&file.scene, &file.camera, None)?.bounds;
        let mesh = &file.scene.object(object).ok_or("no such object")?.mesh;
        let vertices = mesh.host_vertices()?;
        let edges = mesh.faces.iter().flat_map(|f| {
            let [a, b, c] = f.map(|i| glam::DVec3::from(vertices[i as usize]));
            [a.distance(b), b.distance(c), c.distance(a)]
        });
        let edge = edges.sum::<f64>() / (3 * mesh.faces.len()) as f64;
        Ok(Self {
            object,
            bounces,
            file,
            bounds,
            edge,
        })
    }

    /// The side of a pixel in images of so many rows.
    fn footprint(&self, height: usize) -> softray::Result<f64> {
        pixel_footprint(&self.file.scene, &self.file.camera, height)
    }

    fn sharp(&self, height: usize) -> softray::Result<f64> {
        BlurSchedule::sharp_sigma(&self.file.scene, &self.file.camera, height)
    }

    fn options(&self, size: usize, sigma: f64, samples: u32, seed: u64) -> RenderOptions {
        RenderOptions::new(size, size)
            .bounces(self.bounces)
            .bounds(self.bounds)
            .sigma(sigma)
            .samples(samples)
            .seed(seed)
    }

    fn moved(&self, x: &Tensor<1>) -> Scene {
        let axis = Tensor::<1>::from_floats([1.0, 0.0, 0.0], &Device::flex());
        let scene = self.file.scene.clone();
        scene.map_object(self.object, |o| {
            o.map_mesh(|m| m.translated(x.clone() * axis.clone()))
        })
    }

    /// The image `[H, W, 3]` with the object at `x`.
    fn image(&self, x: f64, options: &RenderOptions) -> softray::Result<Tensor<3>> {
        let x = Tensor::<1>::from_floats([x as f32], &Device::flex());
        Ok(render(&self.moved(&x), &self.file.camera, options)?.radiance)
    }

    /// d mean(weights·image)/dx.
    fn derivative(
        &self,
        x: f64,
        weights: Tensor<3>,
        options: &RenderOptions,
    ) -> softray::Result<f64> {
        let x = Tensor::<1>::from_floats([x as f32], &Device::flex());
        let x = x.autodiff().require_grad();
        let options = options.clone().replay();
        let image = render(&self.moved(&x), &self.file.camera, &options)?.radiance;
        let gradients = (image * weights).mean().backward();
        let slope = x.grad(&gradients).map(|g| g.into_scalar::<f32>());
        Ok(f64::from(slope.unwrap_or(0.0)))
    }
}

fn data(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data")
        .join(path)
}

fn scalar(t: Tensor<1>) -> f64 {
    f64::from(t.into_scalar::<f32>())
}

/// Mean, standard deviation, standard error of the mean.
fn statistics(values: &[f64]) -> (f64, f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    (mean, variance.sqrt(), (variance / n).sqrt())
}

/// What images are off by, from two renders with independent seeds.
struct Bias {
    /// Mean over that of the reference.
    mean: f64,
    /// The RMSE of one, values clipped to [0, 1].
    rmse: f64,
    /// The same without the renders' noise: the root of the mean product of the errors of both.
    /// The reference's own noise is in it.
    noiseless: f64,
}

fn bias_of(
    case: &Case,
    reference: &HostImage,
    samples: u32,
    sigma: f64,
    visibility: Visibility,
) -> Result<Bias, Failure> {
    let render = |seed| -> Result<HostImage, Failure> {
        let options = case.options(reference.width, sigma, samples, seed);
        let image = case.image(0.0, &options.visibility(visibility))?;
        Ok(HostImage::from_tensor(&image)?)
    };
    let (a, b) = (render(0)?, render(1)?);
    let clipped = |v: f32| f64::from(v.clamp(0.0, 1.0));
    let pixels = a.pixels.iter().zip(&b.pixels).zip(&reference.pixels);
    let products = pixels.map(|((&a, &b), &r)| {
        let r = clipped(r);
        (clipped(a) - r) * (clipped(b) - r)
    });
    let product = products.sum::<f64>() / reference.pixels.len() as f64;
    Ok(Bias {
        mean: 0.5 * (a.mean_ratio(reference) + b.mean_ratio(reference)),
        rmse: a.rmse(reference, true)?,
        noiseless: product.max(0.0).sqrt(),
    })
}

fn bias(out: &Path, samples: u32) -> Result<(), Failure> {
    const WIDTHS: [f64; 9] = [4.0, 2.0, 1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.005];
    const GAMMAS: [f64; 5] = [1e-1, 1e-2, 1e-3, 1e-4, 1e-5];
    const SIGMA: f64 = 1e-4;
    let mut cases = Vec::new();
    for name in ["shadow", "sphere", "cornell"] {
        let case = Case::load(name)?;
        let reference = HostImage::read(data(&format!("{name}/bounces-{}.exr", case.bounces)))?;
        cases.push((name, case, reference));
    }
    println!("| scene | √σ / footprint | σ | √σ / edge | mean | RMSE | RMSE without noise |");
    println!("|---|---|---|---|---|---|---|");
    let mut lines = Vec::new();
    for (name, case, reference) in &cases {
        let footprint = case.footprint(reference.height)?;
        let mut points = Vec::new();
        for width in WIDTHS {
            let sigma = (width * footprint).powi(2);
            // Where much is off, and many surfaces share a ray, fewer paths tell.
            let samples = if width < 1.0 { samples } else { samples / 8 }.max(1);
            let found = bias_of(case, reference, samples, sigma, Visibility::Layered)?;
            println!(
                "| {name} | {width} | {sigma:.1e} | {:.3} | {:.4} | {:.5} | {:.5} |",
                sigma.sqrt() / case.edge,
                found.mean,
                found.rmse,
                found.noiseless,
            );
            points.push((width, found.noiseless));
        }
        lines.push((name.to_string(), points));
    }
    let sigma_chart = Chart {
        x: Axis::log("√σ / pixel footprint", 4e-3, 5.0),
        y: Axis::log("clipped RMSE without noise", 5e-5, 0.3),
        ..Chart::new("layered")
    };
    let sigma_panel = (sigma_chart, lines);

    println!("\n| scene | σ | form | γ | mean | RMSE without noise |");
    println!("|---|---|---|---|---|---|");
    let mut lines = Vec::new();
    for (name, case, reference) in &cases {
        for form in [Visibility::softmax, |gamma| Visibility::LayeredSoft {
            gamma,
        }] {
            let mut points = Vec::new();
            let mut label = String::new();
            for gamma in GAMMAS {
                let visibility = form(gamma);
                let samples = (samples / 8).max(1);
                let found = bias_of(case, reference, samples, SIGMA, visibility)?;
                let form = name_of(visibility);
                println!(
                    "| {name} | {SIGMA:.0e} | {form} | {gamma:.0e} | {:.4} | {:.5} |",
                    found.mean, found.noiseless,
                );
                points.push((gamma, found.noiseless));
                label = format!("{name}, {form}");
            }
            lines.push((label, points));
        }
    }
    let gamma_chart = Chart {
        x: Axis::log("γ, shares of the scene's depth", 8e-6, 0.125),
        y: Axis::log("clipped RMSE without noise", 5e-5, 0.3),
        ..Chart::new("σ = 1e-4")
    };
    plot(&out.join("bias.svg"), &[sigma_panel, (gamma_chart, lines)])
}

fn name_of(visibility: Visibility) -> &'static str {
    match visibility {
        Visibility::Softmax { .. } => "softmax",
        Visibility::Layered => "layered",
        Visibility::LayeredSoft { .. } => "layered-soft",
    }
}

/// Where gradients are taken: off the target, so that there is one.
const AWAY: f64 = 0.3;

fn gradient(out: &Path, samples: u32, seeds: u64) -> Result<(), Failure> {
    const WIDTHS: [f64; 8] = [4.0, 2.0, 1.0, 0.5, 0.2, 0.1, 0.05, 0.02];
    const GAMMAS: [f64; 3] = [1e-1, 1e-2, 1e-3];
    println!(
        "| scene | form | √σ / footprint | σ | √σ / edge | surfaces a ray | gradient / unblurred | \
         deviation of one / mean | right sign |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    let (mut noise, mut slope) = (Vec::new(), Vec::new());
    for name in ["shadow", "sphere"] {
        let case = Case::load(name)?;
        let footprint = case.footprint(SIZE)?;
        let sharp = case.sharp(SIZE)?;
        let unblurred = |x, samples, seed| case.image(x, &case.options(SIZE, sharp, samples, seed));
        // What the gradient of the loss multiplies the derivative image by, without noise.
        let target = unblurred(0.0, 2048, 1_000_000)?;
        let weights = (unblurred(AWAY, 2048, 1_000_001)? - target) * 2.0;
        let step = 0.05;
        let differences = (0..32)
            .into_par_iter()
            .map(|seed| {
                let at = |x| Ok((unblurred(x, 128, 2_000_000 + seed)? * weights.clone()).mean());
                let difference = at(AWAY + step)? - at(AWAY - step)?;
                Ok(scalar(difference) / (2.0 * step))
            })
            .collect::<softray::Result<Vec<f64>>>()?;
        let (reference, _, error) = statistics(&differences);
        println!(
            "| {name} | central differences | | {sharp:.1e} | {:.4} | | 1 ± {:.3} | | |",
            sharp.sqrt() / case.edge,
            error / reference.abs(),
        );
        let measure = |width: f64, visibility: Visibility| -> Result<(f64, f64), Failure> {
            let sigma = (width * footprint).powi(2);
            // Wide blur is dear and quiet.
            let seeds = if width < 2.0 {
                seeds
            } else {
                (seeds / 4).max(2)
            };
            let options = |seed| {
                let options = case.options(SIZE, sigma, samples, seed);
                options.visibility(visibility)
            };
            let all = (0..seeds)
                .into_par_iter()
                .map(|seed| case.derivative(AWAY, weights.clone(), &options(seed)))
                .collect::<softray::Result<Vec<f64>>>()?;
            let (mean, deviation, error) = statistics(&all);
            let right = all.iter().filter(|&&g| g * reference > 0.0).count();
            let statistics = render(&case.file.scene, &case.file.camera, &options(0))?.statistics;
            let gamma = match visibility {
                Visibility::Layered => String::new(),
                Visibility::Softmax { gamma, .. } | Visibility::LayeredSoft { gamma } => {
                    format!(" γ {gamma:.0e}")
                }
            };
            println!(
                "| {name} | {}{gamma} | {width} | {sigma:.1e} | {:.3} | {:.1} | {:.3} ± {:.3} | {:.2} | {right} of {seeds} |",
                name_of(visibility),
                sigma.sqrt() / case.edge,
                statistics.surfaces[0],
                mean / reference,
                error / reference.abs(),
                deviation / mean.abs(),
            );
            Ok((mean / reference, deviation / mean.abs()))
        };
        let mut points = [Vec::new(), Vec::new()];
        for width in WIDTHS {
            let (ratio, relative) = measure(width, Visibility::Layered)?;
            points[0].push((width, relative));
            points[1].push((width, ratio));
        }
        let [a, b] = points;
        noise.push((name.to_string(), a));
        slope.push((name.to_string(), b));
        for form in [Visibility::softmax, |gamma| Visibility::LayeredSoft {
            gamma,
        }] {
            for gamma in GAMMAS {
                measure(0.5, form(gamma))?;
            }
        }
    }
    let x = || Axis::log("√σ / pixel footprint", 1.6e-2, 5.0);
    let noise_chart = Chart {
        x: x(),
        y: Axis::log("deviation of one gradient / mean", 0.01, 10.0),
        ..Chart::new("noise")
    };
    let slope_chart = Chart {
        x: x(),
        y: Axis::linear("gradient / unblurred", 0.0, 1.6),
        ..Chart::new("bias")
    };
    plot(
        &out.join("gradient.svg"),
        &[(noise_chart, noise), (slope_chart, slope)],
    )
}

/// The interval around its least value in which a loss falls towards it, and the place of that
/// value.
struct Basin {
    low: f64,
    high: f64,
    least: f64,
}

/// From the loss of each seed at equidistant places. The slope between two neighbours counts where
/// it is twice its standard error; the same seeds everywhere keep that small. `None` where no
/// slope down is followed by one up.
fn basin(places: &[f64], losses: &[Vec<f64>]) -> Option<Basin> {
    let slopes: Vec<f64> = losses
        .windows(2)
        .map(|pair| {
            let differences: Vec<f64> = pair[1].iter().zip(&pair[0]).map(|(b, a)| b - a).collect();
            let (mean, _, error) = statistics(&differences);
            if mean.abs() > 2.0 * error { mean } else { 0.0 }
        })
        .collect();
    let clear: Vec<usize> = (0..slopes.len()).filter(|&i| slopes[i] != 0.0).collect();
    let middle = |i: usize| 0.5 * (places[i] + places[i + 1]);
    let (left, right, least) = clear
        .windows(2)
        .filter(|w| slopes[w[0]] < 0.0 && slopes[w[1]] > 0.0)
        .map(|w| {
            let (a, b) = (w[0], w[1]);
            let share = slopes[a] / (slopes[a] - slopes[b]);
            (a, b, middle(a) + share * (middle(b) - middle(a)))
        })
        .min_by(|a, b| a.2.abs().total_cmp(&b.2.abs()))?;
    let low = (0..=left).rev().take_while(|&i| slopes[i] < 0.0).last();
    let high = (right..slopes.len())
        .take_while(|&i| slopes[i] > 0.0)
        .last();
    Some(Basin {
        low: places[low.unwrap_or(left)],
        high: places[high.unwrap_or(right) + 1],
        least,
    })
}

fn landscape(out: &Path, scenes: &[String], samples: u32, seeds: u64) -> Result<(), Failure> {
    const REACH: f64 = 2.0;
    const POINTS: usize = 25;
    const WIDTHS: [f64; 6] = [0.02, 0.5, 1.0, 2.0, 4.0, 8.0];
    const GRADIENTS: u64 = 2;
    let places: Vec<f64> = (0..POINTS)
        .map(|i| REACH * (2.0 * i as f64 / (POINTS - 1) as f64 - 1.0))
        .collect();
    println!(
        "| scene | √σ / footprint | σ | √σ | √σ / edge | target | basin | width | least at | \
         single gradients that point there |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    for name in scenes {
        let case = Case::load(name)?;
        let footprint = case.footprint(SIZE)?;
        let sharp = case.options(SIZE, case.sharp(SIZE)?, 2048, 1_000_000);
        let unblurred = case.image(0.0, &sharp)?;
        let mut panels = [
            ("target blurred alike", Vec::new()),
            ("unblurred target", Vec::new()),
        ];
        for width in WIDTHS {
            let sigma = (width * footprint).powi(2);
            let root = sigma.sqrt();
            // Wide blur is dear and quiet.
            let forward = if width > 1.0 {
                2 * samples
            } else {
                8 * samples
            };
            let blurred = case.image(0.0, &case.options(SIZE, sigma, 64 * samples, 1_000_000))?;
            let targets = [blurred, unblurred.clone()];
            let at = |x: f64, seed: u64, samples: u32| {
                case.image(x, &case.options(SIZE, sigma, samples, seed))
            };
            // By place, then target, then seed.
            let losses = places
                .par_iter()
                .map(|&x| {
                    let mut losses = [Vec::new(), Vec::new()];
                    for seed in 0..seeds {
                        let [a, b] = [0, 1].map(|i| at(x, 2 * seed + i, forward));
                        let (a, b) = (a?, b?);
                        for (losses, t) in losses.iter_mut().zip(&targets) {
                            losses.push(scalar(loss::mse_unbiased(
                                a.clone(),
                                b.clone(),
                                t.clone(),
                            )));
                        }
                    }
                    Ok(losses)
                })
                .collect::<softray::Result<Vec<_>>>()?;
            for (k, (title, lines)) in panels.iter_mut().enumerate() {
                let losses: Vec<Vec<f64>> = losses.iter().map(|l| l[k].clone()).collect();
                let found = basin(&places, &losses);
                let (range, wide, least) = found.as_ref().map_or_else(
                    || ("none".into(), String::new(), String::new()),
                    |b| {
                        let range = format!("{:.2} … {:.2}", b.low, b.high);
                        (
                            range,
                            format!("{:.2}", b.high - b.low),
                            format!("{:.2}", b.least),
                        )
                    },
                );
                let right = match &found {
                    Some(b) if k == 1 => {
                        let inside = |x: f64| x > b.low && x < b.high && (x - b.least).abs() > 0.2;
                        let signs = places
                            .par_iter()
                            .filter(|&&x| inside(x))
                            .flat_map_iter(|&x| (0..GRADIENTS).map(move |seed| (x, seed)))
                            .map(|(x, seed)| {
                                let other = at(x, 2 * seed + 1, samples)?;
                                let weights = other - targets[k].clone();
                                let options = case.options(SIZE, sigma, samples, 2 * seed);
                                let slope = case.derivative(x, weights, &options)?;
                                Ok(slope * (x - b.least) > 0.0)
                            })
                            .collect::<softray::Result<Vec<bool>>>()?;
                        let right = signs.iter().filter(|&&s| s).count();
                        format!("{right} of {}", signs.len())
                    }
                    _ => String::new(),
                };
                println!(
                    "| {name} | {width} | {sigma:.1e} | {root:.3} | {:.3} | {title} | {range} | {wide} | {least} | {right} |",
                    root / case.edge,
                );
                let means: Vec<f64> = losses.iter().map(|l| statistics(l).0).collect();
                let most = means.iter().fold(0f64, |a, &b| a.max(b));
                let line = places.iter().zip(means).map(|(&x, l)| (x, l / most));
                lines.push((format!("√σ = {width} px"), line.collect()));
            }
        }
        let charts = panels.map(|(title, lines)| {
            let chart = Chart {
                x: Axis::linear("x of the object, scene units", -REACH, REACH),
                y: Axis::linear("loss / largest loss", -0.02, 1.02),
                ..Chart::new(&format!("{name}, {title}"))
            };
            (chart, lines)
        });
        plot(&out.join(format!("landscape-{name}.svg")), &charts)?;
    }
    Ok(())
}

fn fit(
    out: &Path,
    name: &str,
    places: &[f64],
    samples: u32,
    steps: usize,
    seeds: u64,
) -> Result<(), Failure> {
    let case = Case::load(name)?;
    let footprint = case.footprint(SIZE)?;
    let sharp = case.options(SIZE, case.sharp(SIZE)?, 2048, 1_000_000);
    let target = case.image(0.0, &sharp)?;
    let auto = BlurSchedule::auto(&case.file.scene, &case.file.camera, SIZE, steps)?;
    let wide = auto.at(0).sqrt() / footprint;
    // √σ at the start and at the end in pixel footprints, and the quarters of the steps between.
    let mut schedules = vec![
        (0.02, 0.02, 4),
        (0.5, 0.5, 4),
        (2.0, 2.0, 4),
        (4.0, 4.0, 4),
        (2.0, 0.2, 3),
        (wide, 0.5, 3),
    ];
    schedules.extend((1..=4).map(|quarters| (4.0, 0.5, quarters)));
    println!(
        "| from | √σ / footprint | over steps | σ | mean error | largest error | mean error < 0.05 after |"
    );
    println!("|---|---|---|---|---|---|---|");
    let mut panels = Vec::new();
    for &from in places {
        let mut lines = Vec::new();
        for &(start, end, quarters) in &schedules {
            let [large, small] = [start, end].map(|w| (w * footprint).powi(2));
            let over = steps * quarters / 4;
            let schedule = BlurSchedule::decay(large, small, over)?;
            let traces = (0..seeds)
                .into_par_iter()
                .map(|seed| descend(&case, &schedule, &target, from, samples, steps, seed))
                .collect::<softray::Result<Vec<_>>>()?;
            let mean_at = |i: usize| traces.iter().map(|t| t[i].abs()).sum::<f64>() / seeds as f64;
            let largest = traces.iter().map(|t| t[steps].abs()).fold(0.0, f64::max);
            let settled = (0..=steps).rev().take_while(|&i| mean_at(i) < 0.05).last();
            let (width, over, sigma) = if start == end {
                (start.to_string(), String::new(), format!("{large:.1e}"))
            } else {
                let sigma = format!("{large:.1e} → {small:.1e}");
                (format!("{start:.1} → {end}"), over.to_string(), sigma)
            };
            println!(
                "| {from} | {width} | {over} | {sigma} | {:.4} | {largest:.4} | {} |",
                mean_at(steps),
                settled.map_or("—".into(), |i| i.to_string()),
            );
            let line = (0..=steps).map(|i| (i as f64, mean_at(i)));
            let over = if over.is_empty() {
                over
            } else {
                format!(" over {over}")
            };
            lines.push((format!("{width} px{over}"), line.collect()));
        }
        let chart = Chart {
            x: Axis::linear("step", 0.0, steps as f64),
            y: Axis::log("mean distance to the target", 1e-3, 4.0),
            ..Chart::new(&format!("{name} from {from}"))
        };
        panels.push((chart, lines));
    }
    plot(&out.join(format!("fit-{name}.svg")), &panels)
}

/// The translation at every step of a fit by Adam.
fn descend(
    case: &Case,
    schedule: &BlurSchedule,
    target: &Tensor<3>,
    from: f64,
    samples: u32,
    steps: usize,
    seed: u64,
) -> softray::Result<Vec<f64>> {
    let device = Device::flex().autodiff();
    let mut x = Param::from_tensor(Tensor::<1>::from_floats([from as f32], &device));
    let mut adam = AdamConfig::new().with_beta_2(0.99).init();
    let mut trace = vec![from];
    for step in 0..steps {
        let at = trace[step];
        let seed = (seed * steps as u64 + step as u64) * 2;
        let sigma = schedule.at(step);
        let other = case.image(at, &case.options(SIZE, sigma, samples, seed + 1))?;
        let weights = (other - target.clone()) * 2.0;
        let options = case.options(SIZE, sigma, samples, seed);
        let slope = case.derivative(at, weights, &options)?;
        let mut gradients = GradientsParams::new();
        gradients.register(
            x.id,
            Tensor::<1>::from_floats([slope as f32], &Device::flex()),
        );
        let done = step as f64 / steps as f64;
        let rate = 0.06 * 0.5 * (1.0 + (std::f64::consts::PI * done).cos());
        x = adam.step(rate, x, gradients);
        trace.push(scalar(x.val().inner()));
    }
    Ok(trace)
}

/// An axis of a plot; a logarithmic one holds decimal logarithms.
struct Axis {
    name: String,
    log: bool,
    from: f64,
    to: f64,
}

impl Axis {
    fn linear(name: &str, from: f64, to: f64) -> Self {
        let name = name.to_string();
        Self {
            name,
            log: false,
            from,
            to,
        }
    }

    fn log(name: &str, from: f64, to: f64) -> Self {
        Self {
            log: true,
            ..Self::linear(name, from.log10(), to.log10())
        }
    }

    fn place(&self, v: f64) -> f64 {
        let v = if self.log { v.log10() } else { v };
        v.clamp(self.from, self.to)
    }

    fn label(&self, v: f64) -> String {
        if self.log {
            format!(
                "{}",
                format!("{:.0e}", 10f64.powf(v))
                    .parse::<f64>()
                    .unwrap_or(0.0)
            )
        } else {
            format!("{}", (v * 100.0).round() / 100.0)
        }
    }
}

struct Chart {
    title: String,
    x: Axis,
    y: Axis,
}

impl Chart {
    fn new(title: &str) -> Self {
        Self {
            title: title.to_string(),
            x: Axis::linear("", 0.0, 1.0),
            y: Axis::linear("", 0.0, 1.0),
        }
    }
}

type Lines = Vec<(String, Vec<(f64, f64)>)>;

/// Charts side by side, each with its legend to the right.
fn plot(path: &Path, charts: &[(Chart, Lines)]) -> Result<(), Failure> {
    use plotters::prelude::*;
    const COLOURS: [RGBColor; 10] = [
        RGBColor(31, 119, 180),
        RGBColor(255, 127, 14),
        RGBColor(44, 160, 44),
        RGBColor(214, 39, 40),
        RGBColor(148, 103, 189),
        RGBColor(140, 86, 75),
        RGBColor(227, 119, 194),
        RGBColor(127, 127, 127),
        RGBColor(188, 189, 34),
        RGBColor(23, 190, 207),
    ];
    const WIDTH: u32 = 430;
    const LEGEND: u32 = 150;
    let size = ((WIDTH + LEGEND) * charts.len() as u32, 380);
    let root = SVGBackend::new(path, size).into_drawing_area();
    root.fill(&WHITE)?;
    for (area, (chart, lines)) in root.split_evenly((1, charts.len())).iter().zip(charts) {
        let (area, legend) = area.split_horizontally(WIDTH);
        let (x, y) = (&chart.x, &chart.y);
        let mut drawn = ChartBuilder::on(&area)
            .caption(&chart.title, ("sans-serif", 16))
            .margin(10)
            .x_label_area_size(40)
            .y_label_area_size(60)
            .build_cartesian_2d(x.from..x.to, y.from..y.to)?;
        drawn
            .configure_mesh()
            .max_light_lines(0)
            .x_desc(&x.name)
            .y_desc(&y.name)
            .x_labels(8)
            .y_labels(8)
            .x_label_formatter(&|v| x.label(*v))
            .y_label_formatter(&|v| y.label(*v))
            .draw()?;
        for (i, (name, points)) in lines.iter().enumerate() {
            let style = COLOURS[i % COLOURS.len()].stroke_width(2);
            let points = points.iter().map(|&(a, b)| (x.place(a), y.place(b)));
            drawn.draw_series(LineSeries::new(points, style))?;
            let row = 50 + 18 * i as i32;
            legend.draw(&PathElement::new([(0, row), (16, row)], style))?;
            let font = ("sans-serif", 12).into_font();
            legend.draw(&Text::new(name.as_str(), (22, row - 6), font))?;
        }
    }
    root.present()?;
    println!("\n![]({})", path.display());
    Ok(())
}
