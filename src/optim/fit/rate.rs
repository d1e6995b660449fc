use crate::error::{Error, Result};

/// A learning rate over the steps of a fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rate {
    start: f64,
    shape: Shape,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Shape {
    Constant,
    Cosine,
    Exponential(f64),
}

impl Rate {
    /// The same rate at every step.
    pub fn constant(rate: f64) -> Self {
        Self {
            start: rate,
            shape: Shape::Constant,
        }
    }

    /// A rate that falls from `start` to 0 along half a cosine: start·(1 + cos(π·step/steps))/2.
    pub fn cosine(start: f64) -> Self {
        Self {
            start,
            shape: Shape::Cosine,
        }
    }

    /// A rate that goes from `start` to `end` by the same factor at every step.
    pub fn exponential(start: f64, end: f64) -> Self {
        Self {
            start,
            shape: Shape::Exponential(end),
        }
    }

    /// The rate of a step of `steps`.
    pub fn at(&self, step: usize, steps: usize) -> f64 {
        let done = step as f64 / steps.max(1) as f64;
        match self.shape {
            Shape::Constant => self.start,
            Shape::Cosine => self.start * 0.5 * (1.0 + (std::f64::consts::PI * done).cos()),
            Shape::Exponential(end) => self.start * (end / self.start).powf(done),
        }
    }

    pub(super) fn check(&self) -> Result<()> {
        let end = match self.shape {
            Shape::Exponential(end) => end,
            _ => self.start,
        };
        for rate in [self.start, end] {
            if !(rate.is_finite() && rate > 0.0) {
                return Err(Error::invalid("fit", "rate", rate, "a finite number > 0"));
            }
        }
        Ok(())
    }
}

impl From<f64> for Rate {
    fn from(rate: f64) -> Self {
        Self::constant(rate)
    }
}
