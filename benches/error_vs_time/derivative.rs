//! The derivative of every pixel of the shadow scene, of each channel by a backward pass of its
//! own, against central differences of unblurred renders.

use std::path::{Path, PathBuf};

use plotters::prelude::*;
use rayon::prelude::*;
use softray::prelude::*;

use crate::settings::{Form, Sampler, name};
use crate::{Outcome, common, data, plot, results};

/// The image of d radiance / d x of the occluder's place against `gradient-occluder-x.exr`.
#[derive(clap::Args)]
pub struct Derivative {
    /// σ, the blur of edges, scene units squared.
    #[arg(long, value_delimiter = ',', default_value = "1e-3")]
    sigma: Vec<f64>,
    /// Forms of visibility: layered, layered-soft:γ, softmax:γ.
    #[arg(long, value_delimiter = ',', default_value = "layered,softmax:1e-2")]
    form: Vec<Form>,
    /// Paths of each pixel and channel.
    #[arg(long, default_value_t = 256)]
    samples: u32,
    /// How to sample.
    #[arg(long, value_delimiter = ',', default_value = "default")]
    sampling: Vec<Sampler>,
    /// The seed.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Folder for images [default: benches/error_vs_time/results].
    #[arg(long)]
    out: Option<PathBuf>,
}

pub fn run(arguments: &Derivative) -> Outcome<()> {
    let folder = results(&arguments.out)?;
    let reference = HostImage::read(data(Path::new("shadow/gradient-occluder-x.exr")))?;
    println!(
        "### d radiance / d x of the occluder of `shadow`, every pixel and channel, against central differences of unblurred renders\n"
    );
    println!(
        "| σ | form | sampling | samples | correlation | slope | relative L2 error | seconds |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for &sigma in &arguments.sigma {
        for &form in &arguments.form {
            for &sampling in &arguments.sampling {
                let start = std::time::Instant::now();
                let found = image(sigma, form, sampling, arguments)?;
                let fit = Fit::new(&found.pixels, &reference.pixels);
                println!(
                    "| {sigma:e} | {} | {} | {} | {:.4} | {:.4} | {:.4} | {:.1} |",
                    form.label(),
                    name(&sampling),
                    arguments.samples,
                    fit.correlation,
                    fit.slope,
                    fit.error,
                    start.elapsed().as_secs_f64(),
                );
                let file = format!(
                    "derivative-{sigma:e}-{}-{}.png",
                    form.to_string().replace(':', "-"),
                    name(&sampling)
                );
                let title = format!(
                    "shadow: d radiance / d x of the occluder; σ {sigma:e}, {}, {} samples a pixel",
                    form.label(),
                    arguments.samples
                );
                picture(&folder.join(file), &title, &found, &reference)?;
            }
        }
    }
    Ok(())
}

/// Pixel by pixel, with a graph of its own for each, so all cores build graphs.
fn image(sigma: f64, form: Form, sampling: Sampler, arguments: &Derivative) -> Outcome<HostImage> {
    let device = Device::flex();
    let file = SceneFile::load(data(Path::new("shadow/scene.json")), &device)?;
    let options = RenderOptions::new(file.width, file.height)
        .samples(arguments.samples)
        .bounces(0)
        .sigma(sigma)
        .visibility(form.visibility())
        .sampling(sampling.sampling())
        .seed(arguments.seed);
    let bar = common::bar((file.width * file.height) as u64, "pixels");
    let of_pixel = |pixel: u32| -> softray::Result<Vec<f32>> {
        let found = (0..3).map(|channel: usize| {
            let offset = Tensor::<1>::zeros([1], &device).autodiff().require_grad();
            let axis = Tensor::<1>::from_floats([1.0, 0.0, 0.0], &device);
            let scene = file.scene.clone().map_object("occluder", |o| {
                o.map_mesh(|m| m.translated(offset.clone() * axis.clone()))
            });
            let radiance = render_pixels(&scene, &file.camera, &options, &[pixel])?.radiance;
            let value = radiance.slice([0..1, 0..1, channel..channel + 1]);
            // A pixel whose paths all miss is a constant.
            if !value.is_tracked() {
                return Ok(0.0);
            }
            let gradients = value.sum().backward();
            let slope = offset.grad(&gradients);
            Ok(slope.map_or(0.0, |g| g.into_scalar::<f32>()))
        });
        let found = found.collect();
        bar.inc(1);
        found
    };
    let pixels: Vec<Vec<f32>> = (0..(file.width * file.height) as u32)
        .into_par_iter()
        .map(of_pixel)
        .collect::<Result<_, _>>()?;
    bar.finish_and_clear();
    Ok(HostImage::new(file.width, file.height, pixels.concat())?)
}

/// How a derivative image compares with its reference, over all pixels and channels.
struct Fit {
    /// Of both, each less its mean.
    correlation: f64,
    /// The factor of the reference that is nearest to what was found.
    slope: f64,
    /// |found − reference|/|reference|.
    error: f64,
}

impl Fit {
    fn new(found: &[f32], reference: &[f32]) -> Self {
        let n = found.len() as f64;
        let pairs = || {
            let pairs = found.iter().zip(reference);
            pairs.map(|(&a, &b)| (f64::from(a), f64::from(b)))
        };
        let sum = |f: fn(f64, f64) -> f64| pairs().map(|(a, b)| f(a, b)).sum::<f64>();
        let (a, b) = (sum(|a, _| a), sum(|_, b| b));
        let (aa, ab, bb) = (sum(|a, _| a * a), sum(|a, b| a * b), sum(|_, b| b * b));
        Self {
            correlation: (ab - a * b / n) / ((aa - a * a / n) * (bb - b * b / n)).sqrt(),
            slope: ab / bb,
            error: (sum(|a, b| (a - b).powi(2)) / bb).sqrt(),
        }
    }
}

/// What was found, the reference and the difference side by side, the mean of the channels: red
/// where the radiance grows with x, blue where it falls.
fn picture(path: &Path, title: &str, found: &HostImage, reference: &HostImage) -> Outcome<()> {
    /// Screen pixels for one of the image.
    const CELL: usize = 6;
    const HEAD: usize = 56;
    const SCALE: usize = 96;
    let grey = |image: &HostImage| -> Vec<f64> {
        let pixels = image.pixels.chunks_exact(3);
        pixels
            .map(|p| f64::from(p.iter().sum::<f32>()) / 3.0)
            .collect()
    };
    let (found, wanted) = (grey(found), grey(reference));
    let difference = found.iter().zip(&wanted).map(|(a, b)| a - b).collect();
    let most = wanted.iter().fold(1e-12f64, |m, v| m.max(v.abs()));
    let colour = |v: f64| {
        let share = (v / most).clamp(-1.0, 1.0);
        let rest = (255.0 * (1.0 - share.abs())) as u8;
        if share > 0.0 {
            RGBColor(255, rest, rest)
        } else {
            RGBColor(rest, rest, 255)
        }
    };
    let (w, h) = (reference.width, reference.height);
    let size = (3 * (CELL * w + 12) + SCALE, CELL * h + HEAD + 12);
    plot::png(path, (size.0 as u32, size.1 as u32), |area, scale| {
        let s = scale as i32;
        area.fill(&WHITE)?;
        let font = |size: u32| ("sans-serif", size * scale).into_font();
        area.draw(&Text::new(title.to_owned(), (12 * s, 8 * s), font(16)))?;
        let panels = [
            ("found", &found),
            ("reference", &wanted),
            ("found − reference", &difference),
        ];
        for (k, (name, values)) in panels.into_iter().enumerate() {
            let left = (12 + k * (CELL * w + 12)) as i32;
            area.draw(&Text::new(name, (left * s, 34 * s), font(14)))?;
            for (i, &v) in values.iter().enumerate() {
                let (x, y) = (
                    left + (CELL * (i % w)) as i32,
                    (HEAD + CELL * (i / w)) as i32,
                );
                let cell = CELL as i32;
                let corners = [(x * s, y * s), ((x + cell) * s, (y + cell) * s)];
                area.draw(&Rectangle::new(corners, colour(v).filled()))?;
            }
        }
        let left = (12 + 3 * (CELL * w + 12)) as i32;
        let (top, height) = (HEAD as i32, (CELL * h) as i32);
        for y in 0..height {
            let value = most * (1.0 - 2.0 * f64::from(y) / f64::from(height - 1));
            let corners = [
                (left * s, (top + y) * s),
                ((left + 18) * s, (top + y + 1) * s),
            ];
            area.draw(&Rectangle::new(corners, colour(value).filled()))?;
        }
        for share in [1.0, 0.5, 0.0, -0.5, -1.0] {
            let y = top + ((1.0 - share) / 2.0 * f64::from(height)) as i32 - 7;
            let text = format!("{:+.2}", share * most);
            area.draw(&Text::new(text, ((left + 24) * s, y * s), font(13)))?;
        }
        let unit = Text::new("1/scene unit", (left * s, 34 * s), font(13));
        area.draw(&unit)?;
        area.present()?;
        Ok(())
    })
}
