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
        }
    }

    /// Returns the rate at a step of a fit of `steps` steps.
    pub fn at(&self, step: usize, steps: usize) -> f64 {
        let done = step as f64 / steps.max(1) as f64;
        if self.cosine {
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
        let Self { start, end, cosine } = self;
        match (cosine, start == end) {
            (true, _) => write!(f, "from {start} to 0 along a cosine"),
            (_, true) => write!(f, "{start}"),
            _ => write!(f, "from {start} to {end}"),
        }
    }
}

impl From<f64> for Rate {
    fn from(rate: f64) -> Self {
        Self::constant(rate)
    }
}
