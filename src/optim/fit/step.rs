//! The input and the result of a step, the report to callbacks, and the result of the whole fit.

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use burn::optim::GradientsParams;
use burn::tensor::Tensor;

use super::History;
use crate::debug;
use crate::error::{Error, Result};
use crate::render::RenderOptions;

/// The step of a fit that is being evaluated.
///
/// [`Fit`](super::Fit) has an example.
#[derive(Clone, Debug)]
pub struct Step {
    /// The step number, counted from 0.
    pub index: usize,
    /// Whether [`Fit::with_pictures`](super::Fit::with_pictures) writes a picture of this step. The loss must not depend
    /// on this field.
    pub pictured: bool,
    pub(super) seed: u64,
    pub(super) blur: Option<f64>,
    /// Whether the blur was read.
    pub(super) blurred: Arc<AtomicBool>,
}

impl Step {
    /// Returns the blur of this step, if the fit has a schedule for it: in degrees for cones
    /// ([`RenderOptions::with_blur`]), σ for the softmax. Only renders that do not use [`Step::options`] need it.
    pub fn blur(&self) -> Option<f64> {
        self.blurred.store(true, Ordering::Relaxed);
        self.blur
    }

    /// Returns the seed of the `render`-th render of this step. Different steps never share a seed, and neither
    /// do the first 1024 renders of a step.
    pub fn seed(&self, render: u64) -> u64 {
        (self.seed << 40) ^ ((self.index as u64) << 10) ^ render
    }

    /// Returns options with the blur of this step and the seed of its `render`-th render.
    pub fn options(&self, options: &RenderOptions, render: u64) -> RenderOptions {
        let options = options.clone().with_seed(self.seed(render));
        match self.blur() {
            Some(blur) => options.with_blur(blur),
            None => options,
        }
    }
}

/// The result of a step: a loss in the graph of the module's parameters, and values and images to record.
///
/// [`Fit`](super::Fit) has an example.
#[derive(Clone)]
pub struct Evaluation {
    pub(super) loss: Tensor<1>,
    pub(super) values: Vec<(String, f64)>,
    pub(super) images: Vec<(String, Tensor<3>)>,
    pub(super) targets: Vec<(String, Tensor<3>)>,
}

impl Evaluation {
    /// Creates an evaluation from a scalar loss `[1]`.
    pub fn new(loss: Tensor<1>) -> Self {
        Self {
            loss,
            values: Vec::new(),
            images: Vec::new(),
            targets: Vec::new(),
        }
    }

    /// Adds a value for the history, for example a parameter, an error or a part of the loss. Every step must
    /// add the same names in the same order. A name must not be empty or contain quotes, commas or line breaks.
    pub fn with_value(mut self, name: impl Into<String>, value: f64) -> Self {
        self.values.push((name.into(), value));
        self
    }

    /// Adds an image `[H, W, 3]` of linear radiance for [`Fit::with_pictures`](super::Fit::with_pictures) and the
    /// callback of [`Fit::on_step`](super::Fit::on_step). Names are unique, and a name must refer to the same
    /// view at every step.
    pub fn with_image(mut self, name: impl Into<String>, image: Tensor<3>) -> Self {
        self.images.push((name.into(), image));
        self
    }

    /// Adds the target `[H, W, 3]` of the image with the same name and size, to be shown beside it.
    pub fn with_target(mut self, name: impl Into<String>, target: Tensor<3>) -> Self {
        self.targets.push((name.into(), target));
        self
    }

    /// Checks that names are unique, and that each target has the name and the size of an image.
    pub(super) fn check(&self) -> Result<()> {
        for all in [&self.images, &self.targets] {
            for (i, (name, _)) in all.iter().enumerate() {
                let once = all[..i].iter().all(|other| other.0 != *name);
                let field = format!("image or target {name:?}");
                Error::unless(once, "fit", &field, "named twice", "one of each name")?;
            }
        }
        for (name, target) in &self.targets {
            let Some((_, image)) = self.images.iter().find(|i| i.0 == *name) else {
                let names: Vec<&String> = self.images.iter().map(|i| &i.0).collect();
                let expected = format!("the name of an image, of which there are {names:?}");
                let found = format!("{name:?}");
                return Err(Error::invalid("fit", "name of a target", found, expected));
            };
            let (found, expected) = (target.dims(), image.dims());
            Error::unless(
                found == expected,
                "fit",
                &format!("shape of the target {name:?}"),
                format!("{found:?}"),
                &format!("{expected:?} like its image"),
            )?;
        }
        Ok(())
    }
}

/// An evaluation with its loss and the gradients of the module's parameters.
pub(super) struct Evaluated {
    pub evaluation: Evaluation,
    pub loss: f64,
    pub gradients: GradientsParams,
}

impl fmt::Debug for Evaluation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let shown = |(name, image): &(String, _)| (name.clone(), debug::tensor(image));
        let images: Vec<_> = self.images.iter().map(shown).collect();
        f.debug_struct("Evaluation")
            .field("loss", &debug::tensor(&self.loss))
            .field("values", &self.values)
            .field("images", &images)
            .finish()
    }
}

/// The state of a fit at a step, for callbacks: after the loss is evaluated, before the parameters change.
///
/// [`Fit`](super::Fit) has an example.
pub struct Report<'a, M> {
    /// The module before the step, from which the loss was computed.
    pub module: &'a M,
    /// The step.
    pub step: &'a Step,
    /// The number of steps of the whole fit.
    pub steps: usize,
    /// The history, including this step.
    pub history: &'a History,
    pub(super) evaluation: &'a Evaluation,
}

/// The reason for the end of a fit.
///
/// [`Fit`](super::Fit) has an example.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// All steps were taken.
    Steps,
    /// The loss had stopped falling ([`Fit::with_early_stop`](super::Fit::with_early_stop)).
    Early,
    /// A callback ended the fit ([`Fit::on_step`](super::Fit::on_step)).
    Callback,
}

/// The result of a fit.
///
/// [`Fit`](super::Fit) has an example.
#[derive(Clone, Debug)]
pub struct Fitted<M> {
    /// The module after the last step.
    pub module: M,
    /// The module with averaged parameters, if there is [`Fit::with_average`](super::Fit::with_average).
    pub average: Option<M>,
    /// All steps, including the steps before a resumption.
    pub history: History,
    /// The reason for the end of the fit.
    pub stop: Stop,
    /// The number of steps in the checkpoint from which the fit resumed, if it did.
    pub resumed: Option<usize>,
    /// Steps at which the loss had stopped falling although the blur was constant.
    pub plateaus: Vec<usize>,
    /// Warnings in order, without the warnings of a run before a resumption.
    pub warnings: Vec<Warning>,
}

/// A likely mistake in a fit that does not stop it.
///
/// Its text describes the problem and a possible remedy.
///
/// [`Fit`](super::Fit) has an example.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Warning {
    /// The loss does not depend on these parameters (their paths in the module), which stay unchanged.
    Unused(Vec<String>),
    /// The fit has a schedule for the blur ([`Fit::with_blur`](super::Fit::with_blur)), but its first step did not use
    /// it.
    UnusedBlur,
    /// The loss has not fallen over many steps although the blur was constant.
    Plateau {
        /// The last step of the plateau.
        step: usize,
        /// The number of steps whose mean loss was compared with the mean over as many steps before.
        window: usize,
    },
    /// A group of [`Fit::with_rate_of`](super::Fit::with_rate_of) contains no parameter of the module, so its rate has
    /// no effect.
    EmptyGroup {
        /// The group.
        group: String,
        /// The paths of the module's parameters.
        parameters: Vec<String>,
    },
    /// A checkpoint could not be read, and the one before it was used.
    DamagedCheckpoint(String),
    /// The file system does not support locks, so another process could fit in the same folder.
    NoLock(PathBuf),
}

impl Warning {
    /// A word for the kind of the warning.
    pub(super) fn kind(&self) -> &'static str {
        match self {
            Self::Unused(_) => "unused",
            Self::UnusedBlur => "unused blur",
            Self::Plateau { .. } => "plateau",
            Self::EmptyGroup { .. } => "empty group",
            Self::DamagedCheckpoint(_) => "damaged checkpoint",
            Self::NoLock(_) => "no lock",
        }
    }
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unused(parameters) => write!(
                f,
                "no gradient reaches {}, which stay as they are: does the loss use them, and are they on \
                 a device with autodiff?",
                parameters.join(", ")
            ),
            Self::UnusedBlur => write!(
                f,
                "Fit::with_blur has no effect, since the first step did not use the blur: render with \
                 step.options(&options, 0) in place of the options"
            ),
            Self::Plateau { step, window } => write!(
                f,
                "at step {step} the loss has not fallen for {window} steps; it may have converged, or \
                 be in a local minimum that a wider blur would leave"
            ),
            Self::EmptyGroup { group, parameters } => write!(
                f,
                "the rate of {group} has no effect, since none of the module's parameters is in this group: {}",
                parameters.join(", ")
            ),
            Self::DamagedCheckpoint(error) => write!(
                f,
                "a checkpoint is damaged, taking the one before it: {error}"
            ),
            Self::NoLock(path) => write!(f, "{} can't be locked here", path.display()),
        }
    }
}
