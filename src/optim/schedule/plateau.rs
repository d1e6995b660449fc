//! Blur that falls when the loss has stopped falling.

use std::collections::VecDeque;

use super::check_ends;
use crate::error::{Error, Result};

/// The name of errors.
const OBJECT: &str = "plateau blur";
/// The relative fall of the loss up to which it counts as stopped, by default.
pub(crate) const TOLERANCE: f64 = 0.02;

/// Blur for a fit in which the number of steps for each width is unknown: it is multiplied by a
/// factor whenever the loss has stopped falling, down to an end.
///
/// Losses of renders are noisy, so means are compared: that of the last `patience` losses with
/// that of as many before them, all since the last change, so a value stays for 2·`patience`
/// observations at least. Where the noise of such a mean is not well under the tolerance, a change
/// comes late, or early: take more patience.
///
/// The value depends on the observed losses and their order alone: to resume a fit, observe its
/// losses again, or keep a clone.
///
/// ```
/// use softray::optim::PlateauBlur;
/// let mut blur = PlateauBlur::new(1e-1, 1e-3, 0.1, 5)?;
/// for step in 0..50 {
///     // render with blur.value(), step of the optimiser …
///     let loss = if step < 20 { 1.0 / f64::from(step + 1) } else { 0.05 };
///     blur.observe(loss);
/// }
/// assert_eq!(blur.value(), 1e-3);
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct PlateauBlur {
    value: f64,
    end: f64,
    factor: f64,
    patience: usize,
    tolerance: f64,
    /// The last 2·patience losses, or fewer, since the last change.
    losses: VecDeque<f64>,
}

impl PlateauBlur {
    /// A blur from `start` to `end`, in the units of its use (σ: scene units squared, γ: units of the
    /// scene's depth), by `factor` at every change; means are of `patience` losses.
    ///
    /// # Errors
    /// If `start` or `end` is not a finite number > 0, `end` is larger than `start`, `factor` is
    /// not between 0 and 1, or `patience` is 0.
    pub fn new(start: f64, end: f64, factor: f64, patience: usize) -> Result<Self> {
        check_ends(OBJECT, start, end)?;
        let between = factor > 0.0 && factor < 1.0;
        Error::unless(between, OBJECT, "factor", factor, "between 0 and 1")?;
        Error::unless(patience > 0, OBJECT, "patience", patience, "at least 1")?;
        Ok(Self {
            value: start,
            end,
            factor,
            patience,
            tolerance: TOLERANCE,
            losses: VecDeque::new(),
        })
    }

    /// Sets the relative fall of the mean loss up to which the value falls, in [0, 1); 0.02 by default.
    ///
    /// # Errors
    /// If it is not at least 0 and under 1.
    pub fn tolerance(mut self, tolerance: f64) -> Result<Self> {
        let valid = (0.0..1.0).contains(&tolerance);
        let expected = "at least 0 and under 1";
        Error::unless(valid, OBJECT, "tolerance", tolerance, expected)?;
        self.tolerance = tolerance;
        Ok(self)
    }

    /// The blur of the next step.
    pub fn value(&self) -> f64 {
        self.value
    }

    /// Observes the loss of a step. It is ignored if it is not finite; it may be negative
    /// ([`mse_unbiased`](crate::loss::mse_unbiased)): the fall is measured against its size.
    pub fn observe(&mut self, loss: f64) {
        if !loss.is_finite() || self.value <= self.end {
            return;
        }
        self.losses.push_back(loss);
        if self.losses.len() > 2 * self.patience {
            self.losses.pop_front();
        }
        if self.losses.len() < 2 * self.patience {
            return;
        }
        if stopped_falling(self.losses.make_contiguous(), self.tolerance) {
            self.value = (self.value * self.factor).max(self.end);
            self.losses.clear();
        }
    }
}

/// Whether the mean of the second half of some losses is less than that of the first half by no more than a
/// share of it.
pub(crate) fn stopped_falling(losses: &[f64], tolerance: f64) -> bool {
    let (earlier, later) = losses.split_at(losses.len() / 2);
    let mean = |losses: &[f64]| losses.iter().sum::<f64>() / losses.len() as f64;
    let (earlier, later) = (mean(earlier), mean(later));
    earlier - later <= tolerance * earlier.abs()
}
