//! Times and errors of one point, and what they are errors against.

use std::process::Command;
use std::time::Instant;

use burn::tensor::{DType, Device};
use softray::prelude::*;

use crate::Outcome;
use crate::scenes::{PARAMETERS, Subject, World};
use crate::settings::{Backward, Float, Form, Sampler, Setting, name};
use crate::table::{Column, Values};

pub type Gradient = [f64; PARAMETERS];

/// Seeds of the converged renders begin here, so that they are independent of those measured.
const CONVERGED: u64 = 1 << 40;
/// And those of the renders without blur here.
const UNBLURRED: u64 = 1 << 41;
/// σ of a render "without blur", in units of the scene's squared radius: edges are blurred over
/// √σ = 1e-5 radii, a thousandth of a pixel and less.
const UNBLURRED_SIGMA: f64 = 1e-10;
/// Nothing that matters is left out of what others are compared with.
const CONVERGED_CUTOFF: f64 = 1e-8;

/// How much is done.
#[derive(Clone, Copy)]
pub struct Effort {
    /// Independent seeds of a point: errors are root mean squares over them.
    pub seeds: u32,
    /// Seconds after which half of them are enough.
    pub patience: f64,
    /// The most runs that the time of a forward pass is the best of.
    pub runs: u32,
    /// Samples a pixel of each render that is compared with, and how many of them are averaged.
    pub reference_samples: u32,
    pub reference_seeds: u32,
    pub reference_sampling: Sampler,
}

/// What a render is compared with.
pub struct Reference {
    image: Vec<f64>,
    gradient: Gradient,
    /// Standard errors over seeds: of the image, root mean square over values in [0, 1]; of the
    /// gradient, relative to its length.
    image_noise: f64,
    gradient_noise: f64,
}

/// The objective of all gradients: the mean of the radiance, all channels alike, under weights
/// 0.5 + x + y/2 that rise across the image (x, y from 0 to 1), so that no symmetry cancels. It is
/// that of `gradcheck`.
fn objective(radiance: Tensor<3>) -> Tensor<1> {
    let [h, w, _] = radiance.dims();
    let weights = weights(w, h);
    let device = radiance.device().inner();
    let data = burn::tensor::TensorData::new(weights, [h, w, 1]);
    let weights = Tensor::<3>::from_data(data, (&device, radiance.dtype()));
    (radiance * weights).mean()
}

fn weights(w: usize, h: usize) -> Vec<f64> {
    let at = |i: usize| {
        let (x, y) = ((i % w) as f64 + 0.5, (i / w) as f64 + 0.5);
        0.5 + x / w as f64 + 0.5 * y / h as f64
    };
    (0..w * h).map(at).collect()
}

fn numbers<const D: usize>(t: &Tensor<D>) -> Vec<f64> {
    t.clone().inner().into_data().iter::<f64>().collect()
}

/// Seconds and values of a render of the scene as it is, without gradient.
fn forward(world: &World, options: &RenderOptions) -> Outcome<(f64, Vec<f64>)> {
    let start = Instant::now();
    let image = render(&world.scene, &world.camera, options)?;
    let image = numbers(&image.radiance);
    Ok((start.elapsed().as_secs_f64(), image))
}

/// Seconds, values and gradient, forward and backward.
fn backward(world: &World, options: &RenderOptions) -> Outcome<(f64, Vec<f64>, Gradient)> {
    let start = Instant::now();
    let theta = world.parameters([0.0; PARAMETERS]);
    let theta = theta.autodiff().require_grad();
    let image = render(&world.at(&theta), &world.camera, options)?.radiance;
    let values = numbers(&image);
    let gradients = objective(image).backward();
    let gradient = theta.grad(&gradients).ok_or("no gradient")?;
    let gradient = numbers(&gradient);
    let seconds = start.elapsed().as_secs_f64();
    Ok((seconds, values, std::array::from_fn(|i| gradient[i])))
}

fn options(world: &World, setting: &Setting, samples: u32, seed: u64) -> RenderOptions {
    setting
        .options(world.width, world.height)
        .samples(samples)
        .bounces(world.bounces)
        .bounds(world.bounds)
        .seed(seed)
}

/// The way in which everything that others are compared with is rendered.
fn converged(sigma: f64, form: Form, effort: &Effort) -> Setting {
    Setting {
        sigma,
        form,
        sampling: effort.reference_sampling,
        cutoff: CONVERGED_CUTOFF,
        dtype: Float::F64,
        device: "flex".to_owned(),
        backward: Backward::Replay,
    }
}

/// Means over seeds of images and gradients, with their standard errors.
struct Means {
    images: (Vec<f64>, Vec<f64>),
    gradients: Vec<Gradient>,
}

impl Means {
    fn new() -> Self {
        Self {
            images: (Vec::new(), Vec::new()),
            gradients: Vec::new(),
        }
    }

    fn image(&mut self, image: &[f64]) {
        self.images.0.resize(image.len(), 0.0);
        self.images.1.resize(image.len(), 0.0);
        for ((sum, squares), v) in self.images.0.iter_mut().zip(&mut self.images.1).zip(image) {
            *sum += v;
            *squares += v * v;
        }
    }

    /// With the number of images that were added, or with an image that has no error.
    fn reference(self, exact: Option<Vec<f64>>) -> Reference {
        let n = self.gradients.len() as f64;
        let error =
            |sum: f64, squares: f64| ((squares - sum * sum / n).max(0.0) / (n * (n - 1.0))).sqrt();
        let component = |i: usize| {
            let of = |f: fn(f64) -> f64| self.gradients.iter().map(|g| f(g[i])).sum::<f64>();
            (of(|v| v), of(|v| v * v))
        };
        let gradient: Gradient = std::array::from_fn(|i| component(i).0 / n);
        let errors: Gradient = std::array::from_fn(|i| {
            let (sum, squares) = component(i);
            error(sum, squares)
        });
        let (image, image_noise) = match exact {
            Some(image) => (image, 0.0),
            None => {
                let pairs = self.images.0.iter().zip(&self.images.1);
                let shown: Vec<f64> = pairs
                    .filter(|(sum, _)| (0.0..=n).contains(*sum))
                    .map(|(sum, squares)| error(*sum, *squares))
                    .collect();
                let image = self.images.0.iter().map(|sum| sum / n).collect();
                (image, length(&shown) / (shown.len() as f64).sqrt())
            }
        };
        Reference {
            image,
            gradient,
            image_noise,
            gradient_noise: length(&errors) / length(&gradient),
        }
    }
}

impl Reference {
    /// The blurred image and its gradient, converged: the same σ and form.
    pub fn blurred(
        subject: Subject,
        like: &Setting,
        effort: &Effort,
        mut each: impl FnMut(u64),
    ) -> Outcome<Self> {
        let world = subject.build(&Device::flex(), DType::F64)?;
        let setting = converged(like.sigma, like.form, effort);
        let mut means = Means::new();
        for seed in 0..u64::from(effort.reference_seeds) {
            let options = options(&world, &setting, effort.reference_samples, CONVERGED + seed);
            let (_, image, gradient) = backward(&world, &options)?;
            means.image(&image);
            means.gradients.push(gradient);
            each(u64::from(effort.reference_samples));
        }
        Ok(means.reference(None))
    }

    /// The image without blur, of an independent renderer where there is one and else of softray
    /// with σ far below a pixel, and the gradient by central differences of renders of that kind:
    /// (f(θᵢ + 1) − f(θᵢ − 1))/2 on the same seeds, a step of 1 %.
    pub fn unblurred(
        subject: Subject,
        effort: &Effort,
        mut each: impl FnMut(u64),
    ) -> Outcome<Self> {
        let mut world = subject.build(&Device::flex(), DType::F64)?;
        let exact = subject.reference()?;
        let sigma = UNBLURRED_SIGMA * world.bounds.radius.powi(2);
        let setting = converged(sigma, Form::Layered, effort);
        let weights = weights(world.width, world.height);
        let as_is = world.scene.clone();
        let mut means = Means::new();
        for seed in 0..u64::from(effort.reference_seeds) {
            let samples = effort.reference_samples;
            let options = options(&world, &setting, samples, UNBLURRED + seed);
            if exact.is_none() {
                world.scene = as_is.clone();
                means.image(&forward(&world, &options)?.1);
                each(u64::from(samples));
            }
            let mut gradient = [0.0; PARAMETERS];
            for (i, g) in gradient.iter_mut().enumerate() {
                for sign in [-1.0, 1.0] {
                    let mut theta = [0.0; PARAMETERS];
                    theta[i] = sign;
                    world.scene = as_is.clone();
                    world.scene = world.at(&world.parameters(theta));
                    let image = forward(&world, &options)?.1;
                    let pixels = image.chunks_exact(3).zip(&weights);
                    let sum: f64 = pixels.map(|(p, w)| w * p.iter().sum::<f64>()).sum();
                    *g += 0.5 * sign * sum / image.len() as f64;
                    each(u64::from(samples));
                }
            }
            means.gradients.push(gradient);
        }
        let exact = exact.map(|i| i.pixels.iter().map(|&v| f64::from(v)).collect());
        Ok(means.reference(exact))
    }
}

/// Sums over seeds of the errors against one reference.
struct Errors<'a> {
    reference: &'a Reference,
    squares: f64,
    bias: f64,
    gradient: [f64; 2],
    cosine: [f64; 2],
}

/// All parameters, and the translation alone.
const PARTS: [std::ops::Range<usize>; 2] = [0..PARAMETERS, 0..3];

impl<'a> Errors<'a> {
    fn new(reference: &'a Reference) -> Self {
        Self {
            reference,
            squares: 0.0,
            bias: 0.0,
            gradient: [0.0; 2],
            cosine: [0.0; 2],
        }
    }

    fn add(&mut self, image: &[f64], gradient: &Gradient) {
        let n = image.len() as f64;
        let pairs = || image.iter().zip(&self.reference.image);
        let clipped = |v: &f64| v.clamp(0.0, 1.0);
        let squares: f64 = pairs()
            .map(|(a, b)| (clipped(a) - clipped(b)).powi(2))
            .sum();
        self.squares += squares / n;
        self.bias += pairs().map(|(a, b)| a - b).sum::<f64>() / n;
        for (k, part) in PARTS.into_iter().enumerate() {
            let (g, r) = (&gradient[part.clone()], &self.reference.gradient[part]);
            let difference: Vec<f64> = g.iter().zip(r).map(|(a, b)| a - b).collect();
            let dot: f64 = g.iter().zip(r).map(|(a, b)| a * b).sum();
            self.gradient[k] += (length(&difference) / length(r)).powi(2);
            // A gradient of 0 points nowhere.
            self.cosine[k] += dot / (length(g) * length(r)).max(f64::MIN_POSITIVE);
        }
    }

    /// RMSE, bias, then error and cosine of the gradient, then those of the translation.
    fn means(&self, seeds: u32) -> [f64; 6] {
        let n = f64::from(seeds);
        [
            (self.squares / n).sqrt(),
            self.bias / n,
            (self.gradient[0] / n).sqrt(),
            self.cosine[0] / n,
            (self.gradient[1] / n).sqrt(),
            self.cosine[1] / n,
        ]
    }
}

fn length(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Times and errors of a setting with so many samples, round by round: rounds of several settings
/// in turn see the same machine, whatever else it does.
pub struct Point<'a> {
    pub world: &'a World,
    pub setting: &'a Setting,
    pub samples: u32,
    /// How many seeds there were so far.
    pub seeds: u32,
    /// Seconds of the best forward pass and of the best forward and backward pass.
    best: [f64; 2],
    /// Seconds of all of them.
    spent: [f64; 2],
    errors: [Errors<'a>; 2],
    references: [&'a Reference; 2],
}

impl<'a> Point<'a> {
    pub fn new(
        world: &'a World,
        setting: &'a Setting,
        samples: u32,
        unblurred: &'a Reference,
        blurred: &'a Reference,
    ) -> Self {
        Self {
            world,
            setting,
            samples,
            seeds: 0,
            best: [f64::INFINITY; 2],
            spent: [0.0; 2],
            errors: [unblurred, blurred].map(Errors::new),
            references: [unblurred, blurred],
        }
    }

    /// One more run of each kind, unless there are enough.
    pub fn round(&mut self, number: u32, effort: &Effort) -> Outcome<()> {
        let options = options(self.world, self.setting, self.samples, u64::from(number));
        // The time of long ones is certain enough.
        if number < effort.runs && self.spent[0] < 2.0 {
            let (seconds, _) = forward(self.world, &options)?;
            self.took(0, seconds);
        }
        let enough = 2 * number >= effort.seeds && self.spent[1] > effort.patience;
        if number < effort.seeds && !enough {
            let (seconds, image, gradient) = backward(self.world, &options)?;
            self.took(1, seconds);
            self.seeds += 1;
            for e in &mut self.errors {
                e.add(&image, &gradient);
            }
        }
        Ok(())
    }

    fn took(&mut self, kind: usize, seconds: f64) {
        self.best[kind] = self.best[kind].min(seconds);
        self.spent[kind] += seconds;
    }

    pub fn values(&self) -> Values {
        let mut values = Values::default();
        values.set(Column::Forward, self.best[0]);
        values.set(Column::ForwardBackward, self.best[1]);
        for (errors, columns) in self.errors.iter().zip([Column::UNBLURRED, Column::BLURRED]) {
            for (column, value) in columns.into_iter().zip(errors.means(self.seeds)) {
                values.set(column, value);
            }
        }
        let [unblurred, blurred] = self.references;
        values.set(Column::ImageNoise, blurred.image_noise);
        values.set(Column::GradientNoise, blurred.gradient_noise);
        values.set(Column::DifferenceNoise, unblurred.gradient_noise);
        let mut limit = Errors::new(unblurred);
        limit.add(&blurred.image, &blurred.gradient);
        let [rmse, _, gradient, _, translation, _] = limit.means(1);
        values.set(Column::LimitRmse, rmse);
        values.set(Column::LimitGradient, gradient);
        values.set(Column::LimitTranslation, translation);
        values
    }
}

/// One forward and backward pass, for [`peak`] in a process of its own and to warm up.
pub fn once(world: &World, setting: &Setting, samples: u32) -> Outcome<()> {
    backward(world, &options(world, setting, samples, 0)).map(|_| ())
}

/// Resident memory at its highest so far in this process, MiB; nothing where the system has no
/// `/proc`.
pub fn peak() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    let kib: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib / 1024.0)
}

/// The peak of one forward and backward pass in a process of its own, MiB: all of the process,
/// with code, scene and threads.
pub fn peak_of(subject: Subject, setting: &Setting, samples: u32) -> Outcome<Option<f64>> {
    let output = Command::new(std::env::current_exe()?)
        .arg("--peak")
        .args(["--scene", &subject.name()])
        .args(["--samples", &samples.to_string()])
        .args(["--sigma", &format!("{:e}", setting.sigma)])
        .args(["--form", &setting.form.to_string()])
        .args(["--sampling", &name(&setting.sampling)])
        .args(["--cutoff", &format!("{:e}", setting.cutoff)])
        .args(["--dtype", &name(&setting.dtype)])
        .args(["--device", &setting.device])
        .args(["--backward", &name(&setting.backward)])
        .output()?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).into());
    }
    Ok(String::from_utf8_lossy(&output.stdout).trim().parse().ok())
}
