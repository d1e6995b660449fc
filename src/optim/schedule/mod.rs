//! Blur over the steps of a fit: wide at the start, narrow at the end.
//!
//! `docs/BLUR.md` explains how to choose the blur. `docs/BASINS.md` and `docs/ACCURACY.md` have the
//! measurements.

mod auto;
mod plateau;

use std::f64::consts::PI;
use std::fmt;

use crate::error::{Error, Result};

pub use auto::pixel_angle;
pub use plateau::PlateauBlur;
#[cfg(feature = "fit")]
pub(crate) use plateau::{TOLERANCE, stopped_falling};

/// The object name in error messages.
const OBJECT: &str = "blur schedule";

/// Blur over the steps of a fit: constant, or falling from a start to an end.
///
/// It falls by the same factor at every step ([`BlurSchedule::decay`]) or slowly at both ends
/// ([`BlurSchedule::cosine`]). The value is an argument for
/// [`RenderOptions::with_blur`](crate::render::RenderOptions::with_blur): the half-angle of cones in degrees. For the
/// softmax, pass it to [`SoftmaxOptions::sigma`](crate::render::SoftmaxOptions::sigma). A larger value lets gradients
/// point to the target from further away, but biases the image more. A fit therefore starts with a large value and ends
/// with a small one.
///
/// ```
/// use softray::prelude::*;
/// let angle = BlurSchedule::decay(5.0, 0.05, 100)?.with_hold(20);
/// for step in 0..150 {
///     let options = RenderOptions::new(32, 32).with_blur(angle.at(step)).with_seed(step as u64);
///     // render, step of the optimizer …
///     # let _ = options;
/// }
/// assert_eq!(angle.at(0), 5.0);
/// assert!((angle.at(20 + 50) - 0.5).abs() < 1e-12);
/// assert_eq!(angle.at(120), 0.05);
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct BlurSchedule {
    start: f64,
    end: f64,
    hold: usize,
    steps: usize,
    /// Whether the logarithm falls as half a cosine period instead of linearly.
    cosine: bool,
}

impl BlurSchedule {
    /// A schedule with the same value at every step, in degrees for cones, in scene units squared for the
    /// softmax.
    ///
    /// # Errors
    /// If the value is not a finite number ≥ 0.
    pub fn constant(value: f64) -> Result<Self> {
        let valid = value.is_finite() && value >= 0.0;
        Error::unless(valid, OBJECT, "value", value, "a finite number ≥ 0")?;
        Ok(Self::new(value, value, 1))
    }

    /// A schedule that falls by the same factor at every step: start·(end/start)^(step/steps), and `end` from
    /// step `steps` on. Values are in degrees for cones, in scene units squared for the softmax.
    ///
    /// # Errors
    /// If `start` or `end` is not a finite number > 0, `end` is larger than `start`, or `steps` is 0.
    pub fn decay(start: f64, end: f64, steps: usize) -> Result<Self> {
        check_ends(OBJECT, start, end)?;
        Error::unless(steps > 0, OBJECT, "steps", steps, "at least 1")?;
        Ok(Self::new(start, end, steps))
    }

    /// A schedule that falls slowly at both ends: start·(end/start)^((1 − cos(π·step/steps))/2). Like
    /// [`BlurSchedule::decay`], it reaches the geometric mean half-way, and there it falls π/2 times as fast.
    ///
    /// # Errors
    /// Like [`BlurSchedule::decay`].
    pub fn cosine(start: f64, end: f64, steps: usize) -> Result<Self> {
        let cosine = true;
        Self::decay(start, end, steps).map(|even| Self { cosine, ..even })
    }

    fn new(start: f64, end: f64, steps: usize) -> Self {
        Self {
            start,
            end,
            hold: 0,
            steps,
            cosine: false,
        }
    }

    /// Sets the number of steps for which the value stays at the start before it falls; 0 by default.
    pub fn with_hold(mut self, steps: usize) -> Self {
        self.hold = steps;
        self
    }

    /// Returns the value at a step, in degrees for cones, in scene units squared for the softmax.
    pub fn at(&self, step: usize) -> f64 {
        let step = step.saturating_sub(self.hold);
        if step == 0 {
            self.start
        } else if step >= self.steps {
            self.end
        } else {
            let share = step as f64 / self.steps as f64;
            let share = match self.cosine {
                true => 0.5 - 0.5 * (PI * share).cos(),
                false => share,
            };
            self.start * (self.end / self.start).powf(share)
        }
    }
}

/// The blur of a fit, of either kind.
///
/// ```
/// use softray::optim::{Blur, BlurSchedule, PlateauBlur};
/// let scheduled: Blur = BlurSchedule::decay(1e-2, 1e-4, 50)?.into();
/// let adaptive: Blur = PlateauBlur::new(1e-2, 1e-4, 0.5, 10)?.into();
/// for mut blur in [scheduled, adaptive] {
///     for step in 0..100 {
///         let _options_take = blur.value(step);
///         let loss = 0.3; // of the render
///         blur.observe(loss);
///     }
///     assert!(blur.value(100) < 1e-2);
/// }
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub enum Blur {
    /// Blur that depends on the step number.
    Scheduled(BlurSchedule),
    /// Blur that depends on the observed losses.
    Plateau(PlateauBlur),
}

impl fmt::Display for BlurSchedule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            start,
            end,
            hold,
            steps,
            cosine,
        } = self;
        if start == end {
            return write!(f, "{start}");
        }
        let form = if *cosine { " along a cosine" } else { "" };
        write!(f, "from {start} to {end} in {steps} steps{form}")?;
        match hold {
            0 => Ok(()),
            _ => write!(f, " after {hold} steps"),
        }
    }
}

impl fmt::Display for Blur {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Scheduled(schedule) => schedule.fmt(f),
            Self::Plateau(plateau) => plateau.fmt(f),
        }
    }
}

impl Blur {
    /// Returns the value at a step, in degrees for cones, in scene units squared for the softmax. A
    /// [`PlateauBlur`] returns its current value and ignores the step.
    pub fn value(&self, step: usize) -> f64 {
        match self {
            Self::Scheduled(schedule) => schedule.at(step),
            Self::Plateau(plateau) => plateau.value(),
        }
    }

    /// Observes the loss of a step (see [`PlateauBlur::observe`]). A schedule ignores it.
    pub fn observe(&mut self, loss: f64) {
        match self {
            Self::Scheduled(_) => {}
            Self::Plateau(plateau) => plateau.observe(loss),
        }
    }
}

impl From<BlurSchedule> for Blur {
    fn from(schedule: BlurSchedule) -> Self {
        Self::Scheduled(schedule)
    }
}

impl From<PlateauBlur> for Blur {
    fn from(plateau: PlateauBlur) -> Self {
        Self::Plateau(plateau)
    }
}

/// Checks that `start` and `end` are positive and `end` is not larger than `start`.
fn check_ends(object: &str, start: f64, end: f64) -> Result<()> {
    Error::unless_positive(object, "start", start)?;
    Error::unless_positive(object, "end", end)?;
    let expected = format!("at most the start, {start}");
    Error::unless(end <= start, object, "end", end, &expected)
}
