use std::fmt;

use crate::error::{Error, Result};

/// A learning rate over the steps of a fit.
///
/// [`Fit`](super::Fit) has an example.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rate {
    start: f64,
    end: f64,
    cosine: bool,
    warm_up: usize,
}

impl Rate {
    /// A rate that is the same at every step.
    pub fn constant(rate: f64) -> Self {
        Self::exponential(rate, rate)
    }

    /// A rate that falls from `start` towards 0 along half a cosine: start·(1 + cos(π·step/steps))/2.
    pub fn cosine(start: f64) -> Self {
        Self {
            cosine: true,
            ..Self::constant(start)
        }
    }

    /// A rate that changes from `start` towards `end` by the same factor at every step:
    /// start·(end/start)^(step/steps).
    pub fn exponential(start: f64, end: f64) -> Self {
        Self {
            start,
            end,
            cosine: false,
            warm_up: 0,
        }
    }

    /// Multiplies the rate by (step + 1)/`steps` in the first `steps` steps. Adam's first steps are large, because its means of
    /// squared gradients have few samples (Liu et al. 2020, *On the Variance of the Adaptive Learning Rate and Beyond*).
    ///
    /// ```
    /// use softray::optim::Rate;
    /// let rate = Rate::constant(0.1).with_warm_up(4);
    /// assert_eq!([0, 1, 3, 50].map(|step| rate.at(step, 100)), [0.025, 0.05, 0.1, 0.1]);
    /// ```
    pub fn with_warm_up(mut self, steps: usize) -> Self {
        self.warm_up = steps;
        self
    }

    /// Returns the rate at a step of a fit of `steps` steps.
    pub fn at(&self, step: usize, steps: usize) -> f64 {
        let done = step as f64 / steps.max(1) as f64;
        let rising = ((step + 1) as f64 / self.warm_up.max(1) as f64).min(1.0);
        rising
            * if self.cosine {
                self.start * 0.5 * (1.0 + (std::f64::consts::PI * done).cos())
            } else {
                self.start * (self.end / self.start).powf(done)
            }
    }

    pub(super) fn check(&self) -> Result<()> {
        Error::unless_positive("fit", "rate", self.start)?;
        Error::unless_positive("fit", "rate", self.end)
    }
}

impl fmt::Display for Rate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (start, end) = (self.start, self.end);
        match (self.cosine, start == end) {
            (true, _) => write!(f, "from {start} to 0 along a cosine"),
            (_, true) => write!(f, "{start}"),
            _ => write!(f, "from {start} to {end}"),
        }?;
        match self.warm_up {
            0 => Ok(()),
            steps => write!(f, ", rising over {steps} steps"),
        }
    }
}

impl From<f64> for Rate {
    fn from(rate: f64) -> Self {
        Self::constant(rate)
    }
}
