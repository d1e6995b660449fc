//! The input of a step of a fit, the report after it, and the result of the whole fit.

use super::pictures::{Images, read};
use super::{History, Warning};
use crate::error::Result;
use crate::figure::Figure;
use crate::io::HostImage;
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
    pub(super) images: &'a Images<'a>,
}

impl<M> Report<'_, M> {
    /// Reads back the images of the step's evaluation, with their names.
    ///
    /// # Errors
    /// If one can't be read back from its device.
    pub fn images(&self) -> Result<Vec<(String, HostImage)>> {
        let images = self.images.evaluation.images.iter();
        images.map(|(n, i)| Ok((n.clone(), read(i)?))).collect()
    }

    /// Draws the images beside their targets and differences, as [`Fit::pictures`](super::Fit::pictures)
    /// writes them.
    ///
    /// # Errors
    /// If one can't be read back from its device, or is not of three channels.
    pub fn figure(&self) -> Result<Figure> {
        match self.history.rows.last() {
            Some(row) => self.images.figure(row),
            None => Ok(Figure::new("")),
        }
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
    /// The step of the checkpoint that it resumed from, if it did.
    pub resumed: Option<usize>,
    /// Steps at which the loss had not fallen for a while though the blur was constant.
    pub plateaus: Vec<usize>,
    /// Warnings in the order in which they arose, without those of a run before a
    /// resumption.
    pub warnings: Vec<Warning>,
}
