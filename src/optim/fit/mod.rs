//! A loop that fits the parameters of a module to images: noisy renders with new random numbers at every step,
//! blur that falls, progress, a history, pictures, and checkpoints that survive a kill at any moment.

mod average;
mod check;
mod checkpoint;
mod devices;
mod history;
mod least_squares;
mod pictures;
mod progress;
mod rate;
mod run;
mod settings;
mod step;

use std::path::{Path, PathBuf};

use burn::lr_scheduler::module_lr_scheduler::{ModuleLearningRate, ModuleLrScheduler};
use burn::module::{Module, ParamGroup};
use burn::optim::ModuleOptimizer;

use super::schedule::Blur;
use crate::error::Result;
use average::Average;
pub use devices::Part;
pub use history::{History, Row};
pub use least_squares::{LeastSquares, Residual};
use pictures::Pictures;
pub use rate::Rate;
pub use step::{Evaluation, Fitted, Report, Step, Stop, Warning};

type Callback<M> = Box<dyn FnMut(&Report<M>) -> Result<bool>>;

/// Fits a module's parameters by gradient descent.
///
/// For scenes with polished surfaces, [`RenderOptions::with_path_regularization`] with 0.3 is recommended: otherwise a rare
/// path of a caustic may have most of a step's gradient.
///
/// [`RenderOptions::with_path_regularization`]: crate::render::RenderOptions::with_path_regularization
///
/// ```
/// use burn::module::{Module, Param};
/// use burn::optim::AdamConfig;
/// use softray::optim::{BlurSchedule, Evaluation, Fit, Rate, Report, Step, Stop, loss};
/// use softray::prelude::*;
///
/// #[derive(Module, Debug)]
/// struct Offset {
///     x: Param<Tensor<1>>,
/// }
///
/// let device = Device::flex();
/// let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0]).with_fov_y(40.0);
/// let options = RenderOptions::new(16, 16).with_samples(4).with_bounces(0);
/// let scene = |x: Tensor<1>| {
///     let zero = x.zeros_like();
///     let offset = Tensor::cat(vec![x, zero.clone(), zero], 0);
///     Scene::new()
///         .with_object(Object::new(shapes::icosahedron(&device).translated(offset)))
///         .with_environment([1.0, 1.0, 1.0])
/// };
/// let still = scene(Tensor::zeros([1], &device));
/// let target = render(&still, &camera, &options.clone().with_samples(64))?.radiance;
/// let start = Tensor::from_floats([0.3], &device.clone().autodiff());
/// let fitted = Fit::new(Offset { x: Param::from_tensor(start) }, AdamConfig::new().init(), 40)
///     .with_rate(Rate::cosine(0.05))
///     .with_blur(BlurSchedule::decay(5.0, 0.05, 30)?)
///     .on_step(10, |report: &Report<Offset>| {
///         let row = report.history.rows.last().expect("this step");
///         println!("{}: {}", row.step, row.loss);
///         Ok(true)
///     })
///     .run(|module: &Offset, step: &Step| {
///         let see = |k| render(&scene(module.x.val()), &camera, &step.options(&options, k));
///         let (a, b) = (see(0)?.radiance, see(1)?.radiance);
///         Ok(Evaluation::new(loss::mse_unbiased(a, b, target.clone())?))
///     })?;
/// assert!(fitted.module.x.val().into_scalar::<f32>().abs() < 0.05);
/// assert_eq!((fitted.stop, fitted.history.rows.len()), (Stop::Steps, 40));
/// for warning in &fitted.warnings {
///     println!("{warning}");
/// }
/// # Ok::<(), softray::Error>(())
/// ```
pub struct Fit<M> {
    module: M,
    optimizer: ModuleOptimizer,
    steps: usize,
    seed: u64,
    rate: Rate,
    rates: Vec<(ParamGroup, Rate)>,
    blur: Option<Blur>,
    clip: Option<f64>,
    average: Option<Average<M>>,
    patience: Option<usize>,
    folder: Option<PathBuf>,
    every: usize,
    restart: bool,
    progress: bool,
    pictures: Option<Pictures>,
    callback: Option<(usize, Callback<M>)>,
}

impl<M: Module> Fit<M> {
    /// Creates a fit of a module on a device with autodiff, with an optimizer, in `steps` steps. By default the
    /// learning rate is 0.01, the seed is 0, and there is no blur schedule, clipping, early stop or folder.
    pub fn new(module: M, optimizer: impl Into<ModuleOptimizer>, steps: usize) -> Self {
        Self {
            module,
            optimizer: optimizer.into(),
            steps,
            seed: 0,
            rate: Rate::constant(0.01),
            rates: Vec::new(),
            blur: None,
            clip: None,
            average: None,
            patience: None,
            folder: None,
            every: 25,
            restart: false,
            progress: true,
            pictures: None,
            callback: None,
        }
    }

    /// Sets the learning rate over the steps; 0.01 by default.
    pub fn with_rate(mut self, rate: impl Into<Rate>) -> Self {
        self.rate = rate.into();
        self
    }

    /// Sets the learning rate of a group of parameters, which replaces [`Fit::with_rate`] for these. If a parameter is in
    /// several groups, the last one counts. A group without parameters is a warning ([`Warning::EmptyGroup`]).
    /// [`History`] records the rate of [`Fit::with_rate`].
    ///
    /// Groups can have their own optimizers, too: see burn's `ModuleOptimizer::with_group`. This fit moves vertices by
    /// [`LargeSteps`](super::LargeSteps) and colors by Adam:
    ///
    /// ```
    /// use burn::module::{Module, Param, ParamGroup};
    /// use burn::optim::{AdamConfig, ModuleOptimizer};
    /// use softray::optim::{LargeSteps, LargeStepsConfig};
    /// use softray::prelude::*;
    /// #[derive(Module, Debug)]
    /// struct Ball {
    ///     vertices: Param<Tensor<2>>,
    ///     color: Param<Tensor<1>>,
    /// }
    /// let device = Device::flex().autodiff();
    /// let mesh = shapes::icosphere(1, &device);
    /// let steps = LargeSteps::from_mesh(&mesh, &LargeStepsConfig::default())?;
    /// let vertices = ParamGroup::from_path("vertices");
    /// let optimizer = AdamConfig::new().init().with_group(vertices.clone(), steps, None);
    /// let color = Param::from_tensor(Tensor::from_floats([0.5, 0.5, 0.5], &device));
    /// let ball = Ball { vertices: Param::from_tensor(mesh.vertices), color };
    /// let fitted = Fit::new(ball, optimizer, 3)
    ///     .with_rate(0.02)
    ///     .with_rate_of(vertices, Rate::cosine(0.1))
    ///     .run(|ball: &Ball, _: &_| {
    ///         let far = (ball.vertices.val() - 1.0).powf_scalar(2.0).mean();
    ///         Ok(Evaluation::new(far + ball.color.val().powf_scalar(2.0).mean()))
    ///     })?;
    /// assert!(fitted.module.color.val().max().into_scalar::<f32>() < 0.5);
    /// # Ok::<(), softray::Error>(())
    /// ```
    pub fn with_rate_of(mut self, group: ParamGroup, rate: impl Into<Rate>) -> Self {
        self.rates.push((group, rate.into()));
        self
    }

    /// Returns the learning rates of a step.
    fn rates_at(&self, step: usize) -> ModuleLearningRate {
        let mut rates = ModuleLrScheduler::new(self.rate.at(step, self.steps));
        for (group, rate) in &self.rates {
            rates = rates.with_group(group.clone(), rate.at(step, self.steps));
        }
        rates.step()
    }

    /// Sets the seed of all random numbers, less than 2²⁴; 0 by default.
    pub fn with_seed(mut self, seed: u64) -> Self {
        self.seed = seed;
        self
    }

    /// Sets the blur over the steps, which [`Step::options`] passes to
    /// [`RenderOptions::with_blur`](crate::render::RenderOptions::with_blur). If the first step calls neither
    /// [`Step::options`] nor [`Step::blur`], there is a warning ([`Warning::UnusedBlur`]).
    pub fn with_blur(mut self, blur: impl Into<Blur>) -> Self {
        self.blur = Some(blur.into());
        self
    }

    /// Limits the Euclidean norm of the gradient over all parameters: a longer gradient is scaled down to
    /// `norm`.
    pub fn with_clip(mut self, norm: f64) -> Self {
        self.clip = Some(norm);
        self
    }

    /// Also keeps a moving average a of the parameters p (Polyak & Juditsky 1992): after n steps
    /// a ← d a + (1 − d) p with d = min(decay, n / (n + 9)). [`Fitted::average`] is the module with these. Where the
    /// learning rate stays high, it is less noisy than the parameters themselves; a rate that falls to 0 has about the
    /// same effect.
    pub fn with_average(mut self, decay: f64) -> Self {
        let module = self.module.clone();
        self.average = Some(Average { decay, module });
        self
    }

    /// Ends the fit when the loss has stopped falling: when its mean over the last `patience` steps is at most
    /// 2 % below its mean over the `patience` steps before, with the same blur at all of these steps.
    pub fn with_early_stop(mut self, patience: usize) -> Self {
        self.patience = Some(patience);
        self
    }

    /// Writes `history.csv`, `history.png` and checkpoints to a folder, and resumes from the newest complete
    /// checkpoint in it. [`Fit::run`] returns an error if the checkpoint has other settings, another process is
    /// fitting in the folder, or all checkpoints are damaged. Settings of optimizers, also those of groups, are
    /// compared by a few steps that they take with each parameter that is not frozen.
    ///
    /// With a larger number of steps, a finished fit continues where it ended. A [`Rate`] depends on the share of the
    /// steps that are done, so a falling rate rises again first. A blur schedule must be the same.
    pub fn with_folder(mut self, folder: impl AsRef<Path>) -> Self {
        self.folder = Some(folder.as_ref().into());
        self
    }

    /// Sets the number of steps between checkpoints; 25 by default.
    pub fn with_checkpoint_every(mut self, steps: usize) -> Self {
        self.every = steps;
        self
    }

    /// Sets whether the fit removes the checkpoints of the folder instead of resuming from them; false by
    /// default.
    pub fn with_restart(mut self, restart: bool) -> Self {
        self.restart = restart;
        self
    }

    /// Sets whether the fit shows its progress on the standard error; true by default.
    ///
    /// A terminal shows a bar. Otherwise the fit writes lines: one at the first step, at most one every ten
    /// seconds, and one at the last step. A line is
    /// `fit: step 40/200, loss 1.200e-3, blur 2.0e-2, PSNR 27.1, 12 s, about 48 s left`; the evaluations' values are means
    /// over ten steps.
    /// Warnings appear there too, with or without progress, if no logger is installed
    /// ([`show_warnings`](crate::show_warnings)). To show the state of a fit differently, use `with_progress(false)` and
    /// [`Fit::on_step`].
    pub fn with_progress(mut self, shown: bool) -> Self {
        self.progress = shown;
        self
    }

    /// Writes the images of evaluations to a folder, as `step-000040.png`: at the first step, every `every`
    /// steps and at the last step. A resumed fit also writes its first step.
    ///
    /// Each image of [`Evaluation::with_image`] is a row. If it has a target ([`Evaluation::with_target`]), the row also
    /// shows the target and their difference. The colors of a difference have the same scale at every step: the
    /// darkest colors represent the 99th percentile of the target. Pixels above 1 do not count, because the
    /// picture clips them.
    ///
    /// Images that are only for pictures need to be rendered only if [`Step::pictured`] is true.
    ///
    /// ```no_run
    /// # use burn::module::{Module, Param};
    /// # use burn::optim::AdamConfig;
    /// # use softray::optim::{Evaluation, Fit, Step};
    /// # use softray::prelude::*;
    /// # #[derive(Module, Debug)]
    /// # struct Color { albedo: Param<Tensor<1>> }
    /// # fn see(_: &Color, _: &Step) -> softray::Result<Tensor<3>> { unimplemented!() }
    /// # fn main() -> softray::Result<()> {
    /// # let device = Device::flex();
    /// # let module = Color { albedo: Param::from_tensor(Tensor::zeros([3], &device.clone().autodiff())) };
    /// let target: Tensor<3> = HostImage::read("photo.png")?.into_tensor(&device);
    /// let fitted = Fit::new(module, AdamConfig::new().init(), 200)
    ///     .with_pictures("out/pictures", 20)
    ///     .run(|module: &Color, step: &_| {
    ///         let image = see(module, step)?;
    ///         let loss = softray::loss::l1(image.clone(), target.clone())?;
    ///         Ok(Evaluation::new(loss)
    ///             .with_image("render", image)
    ///             .with_target("render", target.clone()))
    ///     })?;
    /// # Ok(())
    /// # }
    /// ```
    pub fn with_pictures(mut self, folder: impl AsRef<Path>, every: usize) -> Self {
        let folder = folder.as_ref().into();
        self.pictures = Some(Pictures { folder, every });
        self
    }

    /// Calls a function at step 0, every `every` steps and at the last step, before the parameters change. If
    /// it returns false, the fit ends after that step.
    pub fn on_step(
        mut self,
        every: usize,
        f: impl FnMut(&Report<M>) -> Result<bool> + 'static,
    ) -> Self {
        self.callback = Some((every.max(1), Box::new(f)));
        self
    }
}
