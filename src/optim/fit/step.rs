//! What goes into a step of a fit and what comes out of it, and of the whole.

use burn::tensor::Tensor;

use super::History;
use crate::error::Result;
use crate::io::HostImage;
use crate::render::RenderOptions;

/// What a step of a fit is to be evaluated with.
#[derive(Clone, Debug)]
pub struct Step {
    /// Counted from 0.
    pub index: usize,
    /// The blur, if the fit has a schedule for it: see [`RenderOptions::blur`].
    pub blur: Option<f64>,
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

/// What a step found: a loss in the graph of the module's parameters, and what is to be recorded.
#[derive(Clone)]
pub struct Evaluation {
    pub(super) loss: Tensor<1>,
    pub(super) values: Vec<(String, f64)>,
    pub(super) images: Vec<(String, Tensor<3>)>,
}

impl Evaluation {
    /// From a scalar loss `[1]`.
    pub fn new(loss: Tensor<1>) -> Self {
        Self {
            loss,
            values: Vec::new(),
            images: Vec::new(),
        }
    }

    /// With a number for the history: a parameter, an error, a part of the loss. Every step is to name
    /// the same numbers in the same order.
    pub fn value(mut self, name: impl Into<String>, value: f64) -> Self {
        self.values.push((name.into(), value));
        self
    }

    /// With an image `[H, W, 3]` for the callback of [`Fit::on_step`](super::Fit::on_step).
    pub fn image(mut self, name: impl Into<String>, image: Tensor<3>) -> Self {
        self.images.push((name.into(), image));
        self
    }
}

/// What a callback sees after a step.
pub struct Report<'a, M> {
    /// The module before the step, which the loss is of.
    pub module: &'a M,
    /// The step.
    pub step: &'a Step,
    /// The history up to it.
    pub history: &'a History,
    pub(super) images: &'a [(String, Tensor<3>)],
}

impl<M> Report<'_, M> {
    /// The images of the step's evaluation, by name.
    ///
    /// # Errors
    /// If one can't be read back from its device.
    pub fn images(&self) -> Result<Vec<(String, HostImage)>> {
        let host = |(name, image): &(String, Tensor<3>)| {
            Ok((
                name.clone(),
                HostImage::from_tensor(&image.clone().inner())?,
            ))
        };
        self.images.iter().map(host).collect()
    }
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
    /// The step of the checkpoint that it went on from.
    pub resumed: Option<usize>,
    /// Steps at which the loss had not fallen for a while though the blur was constant.
    pub plateaus: Vec<usize>,
}
