//! Blur that falls when the loss has stopped falling.

use std::collections::VecDeque;
use std::fmt;

use super::check_ends;
use crate::error::{Error, Result};

/// The object name in error messages.
const OBJECT: &str = "plateau blur";
/// The default tolerance: the largest relative fall of the loss that counts as stopped.
pub(crate) const TOLERANCE: f64 = 0.02;

/// Blur that is multiplied by a factor whenever the loss has stopped falling, down to an end. Use it if the
/// number of steps for each width is unknown.
///
/// Losses of renders are noisy, so means are compared: the mean of the last `patience` losses with the mean of
/// the `patience` losses before them. Only losses since the last change count, so a value stays for at least
/// 2·`patience` observations. If the noise of such a mean is not well below the tolerance, a change comes too
/// late or too early; increase the patience.
///
/// The value depends only on the observed losses and their order. To resume a fit, observe its losses again, or
/// keep a clone.
///
/// ```
/// use softray::optim::PlateauBlur;
/// let mut blur = PlateauBlur::new(1e-1, 1e-3, 0.1, 5)?;
/// for step in 0..50 {
///     // render with blur.value(), step of the optimizer …
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
    /// The losses since the last change, at most the last 2·patience of them.
    losses: VecDeque<f64>,
}

impl fmt::Display for PlateauBlur {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            value,
            end,
            factor,
            patience,
            tolerance,
            ..
        } = self;
        write!(
            f,
            "from {value} to {end} by a factor of {factor}, when the mean of {patience} losses falls by less than \
             {tolerance}"
        )
    }
}

impl PlateauBlur {
    /// A blur that falls from `start` to `end`, multiplied by `factor` at every change; means are over
    /// `patience` losses. The values are in the units of their use (cones: degrees, σ: scene units squared, γ:
    /// units of the scene's depth). The tolerance is 0.02.
    ///
    /// # Errors
    /// If `start` or `end` is not a finite number > 0, `end` is larger than `start`, `factor` is not between 0
    /// and 1, or `patience` is 0.
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

    /// Sets the largest relative fall of the mean loss that counts as stopped, in [0, 1); 0.02 by default.
    ///
    /// # Errors
    /// If it is not at least 0 and less than 1.
    pub fn with_tolerance(mut self, tolerance: f64) -> Result<Self> {
        let valid = (0.0..1.0).contains(&tolerance);
        let expected = "at least 0 and under 1";
        Error::unless(valid, OBJECT, "tolerance", tolerance, expected)?;
        self.tolerance = tolerance;
        Ok(self)
    }

    /// Returns the blur for the next step.
    pub fn value(&self) -> f64 {
        self.value
    }

    /// Observes the loss of a step. A loss that is not finite is ignored. A loss may be negative
    /// ([`mse_unbiased`](crate::loss::mse_unbiased)); the fall is relative to the magnitude of the earlier
    /// mean.
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

/// Returns whether the mean of the losses has stopped falling: the mean of the second half is lower than the
/// mean of the first half by at most the share `tolerance` of its magnitude.
pub(crate) fn stopped_falling(losses: &[f64], tolerance: f64) -> bool {
    let (earlier, later) = losses.split_at(losses.len() / 2);
    let mean = |losses: &[f64]| losses.iter().sum::<f64>() / losses.len() as f64;
    let (earlier, later) = (mean(earlier), mean(later));
    earlier - later <= tolerance * earlier.abs()
}
