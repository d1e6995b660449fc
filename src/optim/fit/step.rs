//! The input and the result of a step of a fit, the report after it, and the result of the whole fit.

use std::fmt;
use std::path::PathBuf;

use burn::tensor::Tensor;

use super::History;
use crate::debug;
use crate::error::{Error, Result};
use crate::render::RenderOptions;

/// The step of a fit that is to be evaluated.
#[derive(Clone, Debug)]
pub struct Step {
    /// Counted from 0.
    pub index: usize,
    /// The blur, if the fit has a schedule for it: see [`RenderOptions::blur`].
    pub blur: Option<f64>,
    /// Whether [`Fit::pictures`](super::Fit::pictures) writes a picture of this step. The loss must not
    /// depend on it.
    pub pictured: bool,
    pub(super) seed: u64,
}

impl Step {
    /// The seed of the `render`-th render of this step: no two steps share one, nor two of the first
    /// 1024 renders of a step.
    pub fn seed(&self, render: u64) -> u64 {
        (self.seed << 40) ^ ((self.index as u64) << 10) ^ render
    }

    /// Options with the blur of this step and the seed of its `render`-th render.
    pub fn options(&self, options: &RenderOptions, render: u64) -> RenderOptions {
        let options = options.clone().seed(self.seed(render));
        match self.blur {
            Some(blur) => options.blur(blur),
            None => options,
        }
    }
}

/// The result of a step: a loss in the graph of the module's parameters, with numbers and images to record.
#[derive(Clone)]
pub struct Evaluation {
    pub(super) loss: Tensor<1>,
    pub(super) values: Vec<(String, f64)>,
    pub(super) images: Vec<(String, Tensor<3>)>,
    pub(super) targets: Vec<(String, Tensor<3>)>,
}

impl Evaluation {
    /// An evaluation from a scalar loss `[1]`.
    pub fn new(loss: Tensor<1>) -> Self {
        Self {
            loss,
            values: Vec::new(),
            images: Vec::new(),
            targets: Vec::new(),
        }
    }

    /// Adds a number for the history: a parameter, an error, a part of the loss. Every step must name
    /// the same numbers in the same order.
    pub fn value(mut self, name: impl Into<String>, value: f64) -> Self {
        self.values.push((name.into(), value));
        self
    }

    /// Adds an image `[H, W, 3]` of linear radiance for [`Fit::pictures`](super::Fit::pictures) and the
    /// callback of [`Fit::on_step`](super::Fit::on_step). A name must mean the same view at every
    /// step.
    pub fn image(mut self, name: impl Into<String>, image: Tensor<3>) -> Self {
        self.images.push((name.into(), image));
        self
    }

    /// Adds the target `[H, W, 3]` of the image of a name, which is shown beside it.
    pub fn target(mut self, name: impl Into<String>, target: Tensor<3>) -> Self {
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

/// The state of a fit after a step, for callbacks.
pub struct Report<'a, M> {
    /// The module before the step, which the loss is of.
    pub module: &'a M,
    /// The step.
    pub step: &'a Step,
    /// The steps of the whole fit.
    pub steps: usize,
    /// The history up to the step.
    pub history: &'a History,
    pub(super) evaluation: &'a Evaluation,
}

/// Why a fit ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// All steps were taken.
    Steps,
    /// The loss had stopped falling ([`Fit::early_stop`](super::Fit::early_stop)).
    Early,
    /// A callback asked for it.
    Callback,
}

/// A fit's end.
#[derive(Clone, Debug)]
pub struct Fitted<M> {
    /// The module after the last step.
    pub module: M,
    /// All steps, those before a resumption too.
    pub history: History,
    /// Why it ended.
    pub stop: Stop,
    /// The step of the checkpoint that it resumed from, if it did.
    pub resumed: Option<usize>,
    /// Steps at which the loss had not fallen for a while though the blur was constant.
    pub plateaus: Vec<usize>,
    /// Warnings in the order in which they arose, without those of a run before a
    /// resumption.
    pub warnings: Vec<Warning>,
}

/// Something about a fit that is likely not meant, though the fit goes on.
///
/// Its text says what was found and what may help.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Warning {
    /// The loss doesn't depend on these parameters, named by their paths in the module; they stay as
    /// they are.
    Unused(Vec<String>),
    /// The loss has not fallen for a while though the blur was constant.
    Plateau {
        /// The last step of the plateau.
        step: usize,
        /// The steps over which the loss was compared with as many before.
        window: usize,
    },
    /// A checkpoint could not be read, and the one before it was taken.
    DamagedCheckpoint(String),
    /// The file system has no locks, so that another process could fit in the same folder.
    NoLock(PathBuf),
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unused(parameters) => write!(
                f,
                "the loss does not depend on {}, which stay as they are: is what they are made from \
                 on a device with autodiff?",
                parameters.join(", ")
            ),
            Self::Plateau { step, window } => write!(
                f,
                "at step {step} the loss has not fallen for {window} steps; it may have converged, or \
                 be in a local minimum that a wider blur would leave"
            ),
            Self::DamagedCheckpoint(error) => write!(
                f,
                "a checkpoint is damaged, taking the one before it: {error}"
            ),
            Self::NoLock(path) => write!(f, "{} can't be locked here", path.display()),
        }
    }
}
