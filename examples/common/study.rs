//! Code shared by the examples with a fit: arguments, snapshots, a figure at the end.

use std::cell::RefCell;
use std::error::Error;
use std::path::PathBuf;
use std::rc::Rc;
use std::time::Instant;

use burn::module::Module;
use burn::optim::ModuleOptimizer;
use clap::Parser;
use softray::figure::{Figure, Panel, Plot};
use softray::io::Animation;
use softray::optim::{Evaluation, Fit, Fitted, LeastSquares, Report, Step, loss, pixel_angle};
use softray::prelude::*;

pub type Failure = Box<dyn Error>;

/// The arguments of an example with a fit.
#[derive(Parser, Clone, Debug)]
pub struct Arguments {
    /// Run a shorter fit of smaller images.
    #[arg(long)]
    pub quick: bool,
    /// Number of steps of the fit.
    #[arg(long)]
    pub steps: Option<usize>,
    /// Fit by least squares, in few steps with derivative images, in place of gradient descent. Some examples have it.
    #[arg(long)]
    pub least_squares: bool,
    /// Random seed of the renders.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Resume a stopped run from its newest checkpoint.
    #[arg(long)]
    pub resume: bool,
    /// Write about 20 pictures of the fit next to their targets, and an animation of them.
    #[arg(long)]
    pub pictures: bool,
    /// Device, by its name in `softray::device::named`: flex, ndarray, wgpu, vulkan, metal, cuda or rocm. Default: the value of BURN_DEVICE, or flex.
    #[arg(long)]
    pub device: Option<String>,
    /// Folder for figures, histories and checkpoints.
    #[arg(long, default_value = "out")]
    pub out: PathBuf,
}

impl Arguments {
    /// Returns the arguments that the tests use.
    pub fn for_tests(out: PathBuf) -> Self {
        Self {
            quick: true,
            steps: None,
            least_squares: false,
            seed: 1,
            resume: false,
            pictures: false,
            device: Some("flex".into()),
            out,
        }
    }

    /// Returns `quick` with `--quick`, otherwise `full`.
    pub fn either<T>(&self, quick: T, full: T) -> T {
        if self.quick { quick } else { full }
    }

    pub fn device(&self) -> softray::Result<Device> {
        softray::device::named(self.device.as_deref())
    }
}

/// The target scene of a fit, and its image.
pub struct Goal {
    pub scene: Scene,
    pub camera: Camera,
    pub size: usize,
    pub options: RenderOptions,
    /// Options with many samples.
    pub sharp: RenderOptions,
    pub image: Tensor<3>,
}

impl Goal {
    pub fn new(
        scene: Scene,
        camera: Camera,
        (size, bounces): (usize, u32),
        samples: u32,
    ) -> softray::Result<Self> {
        let options = RenderOptions::new(size, size).with_bounces(bounces);
        let sharp = options.clone().with_samples(samples).with_seed(1 << 50);
        let image = render(&scene, &camera, &sharp)?.radiance;
        Ok(Self {
            scene,
            camera,
            size,
            options,
            sharp,
            image,
        })
    }

    /// Returns the angle of a pixel in degrees.
    pub fn pixel(&self) -> softray::Result<f64> {
        pixel_angle(&self.camera, self.size)
    }

    /// Renders another scene with the camera and many samples.
    pub fn picture(&self, scene: &Scene) -> softray::Result<HostImage> {
        picture(scene, &self.camera, &self.sharp)
    }

    /// Returns the loss of two noisy renders of a scene with the blur of a step, and the first render. `visibility`
    /// replaces the blur of the step.
    pub fn compare(
        &self,
        scene: &Scene,
        step: &Step,
        visibility: Option<Visibility>,
        samples: u32,
    ) -> softray::Result<Evaluation> {
        let few = self.options.clone().with_samples(samples);
        let see = |k| {
            let mut options = step.options(&few, k);
            if let Some(visibility) = visibility {
                options = options.with_visibility(visibility);
                options.blur = None;
            }
            render(scene, &self.camera, &options)
        };
        let (a, b) = (see(0)?.radiance, see(1)?.radiance);
        let loss = loss::mse_unbiased(a.clone(), b, self.image.clone())?;
        Ok(Evaluation::new(loss)
            .with_image("render", a)
            .with_target("render", self.image.clone()))
    }
}

/// A fit that can start at any distance from its target. The basins benchmark uses it too.
pub trait Problem {
    type Module: Module;

    /// Returns parameters at a distance from the target's, in the direction of the example.
    fn start(&self, distance: f64) -> Self::Module;

    /// Returns the distance of parameters from the target's.
    fn error(&self, module: &Self::Module) -> f64;

    /// Returns the angle of a pixel in degrees.
    fn pixel(&self) -> softray::Result<f64>;

    /// Returns the loss of a step.
    fn evaluate(&self, module: &Self::Module, step: &Step) -> softray::Result<Evaluation>;
}

/// The result of a fit: the distance of the parameters from the target's.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The distances at the start and at the end.
    pub errors: [f64; 2],
    /// The name of the distance, with its unit.
    pub of: String,
    /// Other numbers to report.
    pub others: Vec<(String, f64)>,
}

impl Outcome {
    pub fn ratio(&self) -> f64 {
        self.errors[0] / self.errors[1]
    }
}

/// The number of steps of a fit by least squares.
const LEAST_SQUARES_STEPS: usize = 10;

type Images = Rc<RefCell<Vec<(usize, HostImage)>>>;

/// An example's fit and its figure.
pub struct Study<'a> {
    name: &'static str,
    title: &'static str,
    arguments: &'a Arguments,
    steps: usize,
    snapshots: Images,
    start: Instant,
}

/// Applies the settings of a study to a fit of either kind.
macro_rules! settings_of {
    ($study:ident, $fit:expr) => {{
        let fit = $fit
            .with_seed($study.arguments.seed)
            .with_folder($study.folder())
            .with_restart(!$study.arguments.resume)
            .on_step($study.steps.div_ceil(4).max(1), $study.keep());
        match $study.pictures() {
            Some((folder, every)) => fit.with_pictures(folder, every),
            None => fit,
        }
    }};
}

impl<'a> Study<'a> {
    pub fn new(
        name: &'static str,
        title: &'static str,
        arguments: &'a Arguments,
        steps: usize,
    ) -> Self {
        let steps = match arguments.least_squares {
            true => LEAST_SQUARES_STEPS,
            false => steps,
        };
        Self {
            name,
            title,
            arguments,
            steps: arguments.steps.unwrap_or(steps),
            snapshots: Images::default(),
            start: Instant::now(),
        }
    }

    pub fn steps(&self) -> usize {
        self.steps
    }

    pub fn by_least_squares(&self) -> bool {
        self.arguments.least_squares
    }

    /// Creates a fit that writes its history to the example's folder and keeps the first image of four steps.
    pub fn fit<M: Module + 'static>(
        &self,
        module: M,
        optimizer: impl Into<ModuleOptimizer>,
    ) -> Fit<M> {
        if self.arguments.least_squares {
            let message = "this example has no --least-squares\n";
            clap::Error::raw(clap::error::ErrorKind::UnknownArgument, message).exit();
        }
        settings_of!(self, Fit::new(module, optimizer, self.steps))
    }

    /// Creates the same fit by least squares.
    pub fn least_squares<M: Module + 'static>(&self, module: M) -> LeastSquares<M> {
        settings_of!(self, LeastSquares::new(module, self.steps))
    }

    fn folder(&self) -> PathBuf {
        self.arguments.out.join(self.name)
    }

    /// Returns the folder and the interval of pictures, if they are wanted.
    fn pictures(&self) -> Option<(PathBuf, usize)> {
        let every = self.steps.div_ceil(20).max(1);
        let wanted = self.arguments.pictures;
        wanted.then(|| (self.folder().join("pictures"), every))
    }

    /// Returns a callback that keeps the first image of a step.
    fn keep<M>(&self) -> impl FnMut(&Report<M>) -> softray::Result<bool> + 'static {
        let snapshots = self.snapshots.clone();
        move |report| {
            if let Some((_, image)) = report.images()?.into_iter().next() {
                snapshots.borrow_mut().push((report.step.index, image));
            }
            Ok(true)
        }
    }

    /// Returns an animation of the fit's pictures, in the order of their names.
    fn animation(&self) -> Result<Animation, Failure> {
        let folder = self.folder().join("pictures");
        let mut files: Vec<PathBuf> = std::fs::read_dir(folder)?
            .map(|entry| entry.map(|e| e.path()))
            .collect::<Result<_, _>>()?;
        files.sort();
        // Every second picture is enough and keeps the file small.
        let frames = files.iter().step_by(2).map(HostImage::read);
        Ok(Animation::new(frames.collect::<Result<_, _>>()?)?)
    }

    /// Writes the figure, prints errors, and returns them.
    pub fn finish<M>(
        &self,
        fitted: &Fitted<M>,
        images: [(&str, HostImage); 3],
        plots: Vec<Plot>,
        outcome: Outcome,
    ) -> Result<Outcome, Failure> {
        let [initial, target, last] = &images;
        let difference = Panel::difference("final − target", &last.1, &target.1)?;
        let row = [initial, target, last].map(|(caption, image)| Panel::new(*caption, image));
        let snapshots = self.snapshots.borrow();
        let steps = snapshots.iter();
        let steps = steps.map(|(step, image)| Panel::new(format!("step {step}"), image));
        let mut figure = Figure::new(self.title)
            .with_row(row.into_iter().chain([difference]))
            .with_row(steps)
            .with_plot(fitted.history.loss_plot());
        for plot in plots {
            figure = figure.with_plot(plot);
        }
        let path = self.arguments.out.join(format!("{}.png", self.name));
        figure.write(&path)?;
        let [before, after] = outcome.errors;
        println!(
            "{}: {before:.4} at the start, {after:.5} after {} steps, {:.1} s",
            outcome.of,
            fitted.history.rows.len(),
            self.start.elapsed().as_secs_f64()
        );
        for (name, value) in &outcome.others {
            println!("{name}: {value:.5}");
        }
        println!("wrote {}", path.display());
        if self.arguments.pictures {
            let path = path.with_extension("gif");
            self.animation()?.with_frames_per_second(3.0).write(&path)?;
            println!("wrote {}", path.display());
        }
        Ok(outcome)
    }
}

/// Returns cameras on a circle of the radius 3.4 about the origin, at three heights in turn.
pub fn cameras_around(count: usize, heights: [f64; 3], fov_y: f64) -> Vec<Camera> {
    let view = |i: usize| {
        let angle = std::f64::consts::TAU * (i as f64 + 0.5) / count as f64;
        let eye = [3.4 * angle.sin(), heights[i % 3], 3.4 * angle.cos()];
        Camera::look_at(eye, [0.0; 3]).with_fov_y(fov_y)
    };
    (0..count).map(view).collect()
}

/// Renders a scene and reads the image back.
pub fn picture(
    scene: &Scene,
    camera: &Camera,
    options: &RenderOptions,
) -> softray::Result<HostImage> {
    HostImage::from_tensor(&render(scene, camera, options)?.radiance)
}

/// Reads the values of a small tensor back.
pub fn numbers<const D: usize>(tensor: &Tensor<D>) -> Vec<f64> {
    tensor.clone().inner().into_data().iter::<f64>().collect()
}

/// Returns the distance of two points.
pub fn distance(a: &[f64], b: &[f64]) -> f64 {
    let square = |(x, y): (&f64, &f64)| (x - y) * (x - y);
    a.iter().zip(b).map(square).sum::<f64>().sqrt()
}
