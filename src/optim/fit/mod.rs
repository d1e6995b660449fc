//! A loop that fits the parameters of a module to images: noisy renders with fresh random numbers at
//! every step, blur that falls, a progress bar, a history, and checkpoints that survive a kill at any
//! moment.

mod checkpoint;
mod debug;
mod gradients;
mod history;
mod rate;
mod step;

use std::path::{Path, PathBuf};
use std::time::Instant;

use burn::module::{Module, Param};
use burn::optim::{GradientsParams, ModuleOptimizer};
use burn::tensor::{Device, Tensor};
use indicatif::{ProgressBar, ProgressStyle};

use super::schedule::Blur;
use crate::error::{Error, Result};
use crate::geometry::host_values;
use checkpoint::Checkpoints;
pub use history::{History, Row};
pub use rate::Rate;
pub use step::{Evaluation, Fitted, Report, Step, Stop};

type Callback<M> = Box<dyn FnMut(&Report<M>) -> Result<bool>>;

/// Fits a module's parameters by gradient descent.
///
/// ```
/// use burn::module::{Module, Param};
/// use burn::optim::AdamConfig;
/// use softray::optim::{BlurSchedule, Evaluation, Fit, Rate, loss};
/// use softray::prelude::*;
///
/// #[derive(Module, Debug)]
/// struct Offset {
///     x: Param<Tensor<1>>,
/// }
///
/// let device = Device::flex();
/// let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0]).fov_y(40.0);
/// let options = RenderOptions::new(16, 16).samples(4).bounces(0);
/// let scene = |x: Tensor<1>| {
///     let zero = x.zeros_like();
///     let offset = Tensor::cat(vec![x, zero.clone(), zero], 0);
///     Scene::new()
///         .with(Object::new(shapes::icosahedron(&device).translated(offset)))
///         .environment([1.0, 1.0, 1.0])
/// };
/// let still = scene(Tensor::zeros([1], &device));
/// let target = render(&still, &camera, &options.clone().samples(64))?.radiance;
/// let start = Tensor::from_floats([0.3], &device.clone().autodiff());
/// let fitted = Fit::new(Offset { x: Param::from_tensor(start) }, AdamConfig::new().init(), 40)
///     .rate(Rate::cosine(0.05))
///     .blur(BlurSchedule::decay(0.1, 1e-3, 30)?)
///     .run(|module: &Offset, step: &_| {
///         let see = |k| render(&scene(module.x.val()), &camera, &step.options(&options, k));
///         let (a, b) = (see(0)?.radiance, see(1)?.radiance);
///         Ok(Evaluation::new(loss::mse_unbiased(a, b, target.clone())))
///     })?;
/// assert!(fitted.module.x.val().into_scalar::<f32>().abs() < 0.05);
/// # Ok::<(), softray::Error>(())
/// ```
pub struct Fit<M> {
    module: M,
    optimizer: ModuleOptimizer,
    steps: usize,
    seed: u64,
    rate: Rate,
    blur: Option<Blur>,
    clip: Option<f64>,
    patience: Option<usize>,
    folder: Option<PathBuf>,
    every: usize,
    restart: bool,
    progress: bool,
    callback: Option<(usize, Callback<M>)>,
}

impl<M: Module> Fit<M> {
    /// Of a module on a device with autodiff, by an optimiser, in so many steps. The rate is 0.01
    /// unless one is given.
    pub fn new(module: M, optimizer: impl Into<ModuleOptimizer>, steps: usize) -> Self {
        Self {
            module,
            optimizer: optimizer.into(),
            steps,
            seed: 0,
            rate: Rate::constant(0.01),
            blur: None,
            clip: None,
            patience: None,
            folder: None,
            every: 25,
            restart: false,
            progress: true,
            callback: None,
        }
    }

    /// The learning rate over the steps.
    pub fn rate(mut self, rate: impl Into<Rate>) -> Self {
        self.rate = rate.into();
        self
    }

    /// The seed of all random numbers; below 2²⁴.
    pub fn seed(mut self, seed: u64) -> Self {
        self.seed = seed;
        self
    }

    /// The blur over the steps, for [`Step::options`]: what
    /// [`RenderOptions::blur`](crate::render::RenderOptions::blur) takes.
    pub fn blur(mut self, blur: impl Into<Blur>) -> Self {
        self.blur = Some(blur.into());
        self
    }

    /// Scales gradients down to this Euclidean norm over all parameters, where they are longer.
    pub fn clip(mut self, norm: f64) -> Self {
        self.clip = Some(norm);
        self
    }

    /// Ends the fit when the loss has stopped falling: when its mean over the last `patience` steps is
    /// not 2 % less than over as many before, all with the same blur.
    pub fn early_stop(mut self, patience: usize) -> Self {
        self.patience = Some(patience);
        self
    }

    /// Keeps `history.csv`, `loss.svg` and checkpoints in a folder, and goes on from the newest
    /// checkpoint found there that is whole. A checkpoint of a fit with other settings, a process that
    /// is fitting there already, and a folder whose checkpoints are all damaged are errors.
    pub fn folder(mut self, folder: impl AsRef<Path>) -> Self {
        self.folder = Some(folder.as_ref().into());
        self
    }

    /// Steps between checkpoints, 25 unless said otherwise.
    pub fn checkpoint_every(mut self, steps: usize) -> Self {
        self.every = steps;
        self
    }

    /// Whether to begin anew, and remove the checkpoints that the folder has.
    pub fn restart(mut self, restart: bool) -> Self {
        self.restart = restart;
        self
    }

    /// Whether to show a progress bar where there is a terminal; it does unless told otherwise.
    pub fn progress(mut self, shown: bool) -> Self {
        self.progress = shown;
        self
    }

    /// Calls a function at step 0, every so many steps and at the last one, before the parameters move;
    /// the fit ends when it returns false.
    pub fn on_step(
        mut self,
        every: usize,
        f: impl FnMut(&Report<M>) -> Result<bool> + 'static,
    ) -> Self {
        self.callback = Some((every.max(1), Box::new(f)));
        self
    }

    fn check(&self) -> Result<()> {
        let positive = |field: &str, ok: bool, value: String, expected: &str| {
            if ok {
                Ok(())
            } else {
                Err(Error::invalid("fit", field, value, expected))
            }
        };
        positive(
            "seed",
            self.seed < 1 << 24,
            self.seed.to_string(),
            "below 2²⁴",
        )?;
        positive(
            "steps",
            self.steps > 0,
            self.steps.to_string(),
            "at least 1",
        )?;
        positive(
            "checkpoint_every",
            self.every > 0,
            self.every.to_string(),
            "at least 1",
        )?;
        let clip = self.clip.unwrap_or(1.0);
        let expected = "a finite number > 0";
        positive(
            "clip",
            clip.is_finite() && clip > 0.0,
            clip.to_string(),
            expected,
        )?;
        positive(
            "early_stop",
            self.patience != Some(0),
            "0".into(),
            "at least 1 step",
        )?;
        self.rate.check()
    }

    /// What has to be the same for a checkpoint to be gone on from.
    fn settings(&self) -> String {
        let Self {
            seed,
            rate,
            blur,
            clip,
            steps,
            optimizer,
            ..
        } = self;
        let optimizer = fingerprint(optimizer);
        format!(
            "seed {seed}\nsteps {steps}\nrate {rate:?}\nblur {blur:?}\nclip {clip:?}\n\
             optimizer {optimizer}\n"
        )
    }

    /// Takes the steps. The function is given the module and what the step is evaluated with, and
    /// returns the loss. It has to be a function of these alone: then a fit that is killed and
    /// resumed ends with the same parameters as one that is not.
    ///
    /// # Errors
    /// What the function or a callback returns; if a setting is out of its range; if loss or
    /// gradient are not finite or no parameter is in the loss's graph; if a file can't be read or
    /// written, or a checkpoint is of a fit with other settings or of another module.
    pub fn run(mut self, mut f: impl FnMut(&M, &Step) -> Result<Evaluation>) -> Result<Fitted<M>> {
        self.check()?;
        // Only checkpoints ask for them.
        let settings = match &self.folder {
            Some(_) => self.settings(),
            None => String::new(),
        };
        let restart = self.restart;
        let open = |folder: &Path| Checkpoints::open(folder, restart);
        let checkpoints = self.folder.as_deref().map(open).transpose()?;
        let mut history = History::default();
        let mut resumed = None;
        let newest = checkpoints.as_ref().map(|c| c.newest(&settings));
        if let Some(newest) = newest.transpose()?.flatten() {
            self.module = newest.module(self.module)?;
            self.optimizer = newest.optimizer(self.optimizer)?;
            history = newest.history;
            resumed = Some(history.rows.len());
        }
        // Blur that follows the loss is a function of the losses so far.
        for row in &history.rows {
            observe(&mut self.blur, row.loss);
        }
        let bar = self.bar();
        bar.set_position(history.rows.len() as u64);
        let window = self.patience.unwrap_or((self.steps / 5).max(20));
        let mut plateaus = history.plateaus(window);
        let mut stop = Stop::Steps;
        // A fit that had ended early stays so.
        let steps = match plateaus.last() {
            Some(&last) if self.patience.is_some() && last + 1 == history.rows.len() => {
                stop = Stop::Early;
                0
            }
            _ => self.steps,
        };
        let before = history.rows.last().map_or(0.0, |r| r.seconds);
        let start = Instant::now();
        let mut saved = history.rows.len();
        while history.rows.len() < steps {
            let index = history.rows.len();
            let step = Step {
                index,
                blur: self.blur.as_ref().map(|b| b.value(index)),
                seed: self.seed,
            };
            let evaluation = f(&self.module, &step)?;
            let loss = scalar(&evaluation.loss)?;
            if !loss.is_finite() {
                return Err(not_finite("the loss", loss, index));
            }
            let mut gradients =
                GradientsParams::from_grads(evaluation.loss.backward(), &self.module);
            let found = gradients::clip(&self.module, &mut gradients, self.clip)?;
            if !found.missing.is_empty() && (index == 0 || resumed == Some(index)) {
                log::warn!(
                    "fit: the loss does not depend on {}, which stay as they are: is what they are \
                     made from on a device with autodiff?",
                    found.missing.join(", ")
                );
            }
            let Some(norm) = found.norm else {
                return Err(Error::invalid(
                    "fit",
                    "gradient",
                    "absent",
                    "a parameter of the module in the graph of the loss",
                ));
            };
            if !norm.is_finite() {
                return Err(not_finite("the gradient", norm, index));
            }
            let rate = self.rate.at(index, self.steps);
            history.push(
                evaluation.values,
                Row {
                    step: index,
                    loss,
                    gradient_norm: norm,
                    rate,
                    blur: step.blur,
                    seconds: before + start.elapsed().as_secs_f64(),
                    values: Vec::new(),
                },
            )?;
            let mut wanted = true;
            if let Some((every, callback)) = &mut self.callback
                && (index.is_multiple_of(*every) || index + 1 == self.steps)
            {
                wanted = callback(&Report {
                    module: &self.module,
                    step: &step,
                    history: &history,
                    images: &evaluation.images,
                })?;
            }
            self.module = self.optimizer.step(rate, self.module, gradients);
            observe(&mut self.blur, loss);
            let message = match step.blur {
                Some(blur) => format!("loss {loss:.3e}, blur {blur:.1e}"),
                None => format!("loss {loss:.3e}"),
            };
            bar.set_message(message);
            bar.inc(1);
            let last = plateaus.last().copied();
            let still = history.is_flat(window, last);
            if still {
                plateaus.push(index);
                log::warn!(
                    "fit: at step {index} the loss has not fallen for {window} steps; it may have \
                     converged, or be in a local minimum that a wider blur would leave"
                );
            }
            let early = still && self.patience.is_some();
            if early || !wanted {
                stop = if early { Stop::Early } else { Stop::Callback };
                break;
            }
            if let Some(checkpoints) = &checkpoints
                && (index + 1).is_multiple_of(self.every)
            {
                saved = index + 1;
                checkpoints.write(&self.module, &self.optimizer, &history, &settings)?;
            }
        }
        bar.finish_and_clear();
        if let Some(checkpoints) = &checkpoints {
            if saved < history.rows.len() {
                checkpoints.write(&self.module, &self.optimizer, &history, &settings)?;
            }
            checkpoints.finish(&history)?;
        }
        Ok(Fitted {
            module: self.module,
            history,
            stop,
            resumed,
            plateaus,
        })
    }

    fn bar(&self) -> ProgressBar {
        if !self.progress {
            return ProgressBar::hidden();
        }
        let template = "fitting {bar:40} {pos}/{len} [{elapsed} < {eta}] {msg}";
        let style = ProgressStyle::with_template(template);
        let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
        ProgressBar::new(self.steps as u64).with_style(style)
    }
}

/// What an optimiser makes of a parameter of its own in three steps: it has no name that could be asked.
fn fingerprint(optimizer: &ModuleOptimizer) -> String {
    #[derive(Module, Debug)]
    struct Probe {
        x: Param<Tensor<2>>,
    }
    let device = Device::default();
    let mut optimizer = optimizer.clone();
    let start = Tensor::<2>::from_floats([[0.3, -2.0], [1.0, 0.1]], &device.clone().autodiff());
    let mut probe = Probe {
        x: Param::from_tensor(start),
    };
    for slope in [
        [[0.5f32, -1.0], [2.0, 0.1]],
        [[-0.2, 3.0], [0.1, 0.4]],
        [[0.7; 2]; 2],
    ] {
        let mut gradients = GradientsParams::new();
        gradients.register(probe.x.id, Tensor::<2>::from_floats(slope, &device));
        probe = optimizer.step(0.1, probe, gradients);
    }
    let values = host_values(&probe.x.val()).unwrap_or_default();
    let values: Vec<String> = values.iter().map(|v| format!("{v:.4}")).collect();
    values.join(" ")
}

fn observe(blur: &mut Option<Blur>, loss: f64) {
    if let Some(blur) = blur {
        blur.observe(loss);
    }
}

fn scalar(loss: &Tensor<1>) -> Result<f64> {
    let values = host_values(loss)?;
    match values[..] {
        [value] => Ok(value),
        _ => Err(Error::invalid(
            "fit",
            "loss",
            format!("of {} numbers", values.len()),
            "one number",
        )),
    }
}

fn not_finite(what: &str, value: f64, step: usize) -> Error {
    Error::invalid(
        "fit",
        format!("{what} of step {step}"),
        value,
        "a finite number",
    )
}
