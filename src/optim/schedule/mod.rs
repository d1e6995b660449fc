//! Blur over the steps of a fit: wide at the start, narrow at the end.
//!
//! `docs/BLUR.md` has the measurements that the fractions of [`BlurSchedule::auto`] come from.

mod auto;
mod plateau;

use std::f64::consts::PI;

use crate::error::{Error, Result};

pub use auto::pixel_angle;
pub use plateau::PlateauBlur;
#[cfg(feature = "fit")]
pub(crate) use plateau::{TOLERANCE, stopped_falling};

/// The name of errors.
const OBJECT: &str = "blur schedule";

/// Blur over the steps of a fit: constant, or falling, by the same factor at every step or slowly at
/// both ends.
///
/// It is what [`RenderOptions::blur`](crate::render::RenderOptions::blur) takes: the half-angle of cones
/// in radians (or σ of the softmax). The larger it is, the further away a gradient begins to point to
/// the target, and the more the image is off; so a fit starts with a large one and ends with a small
/// one.
///
/// ```
/// use softray::prelude::*;
/// let angle = BlurSchedule::decay(1e-1, 1e-3, 100)?.hold(20);
/// for step in 0..150 {
///     let options = RenderOptions::new(32, 32).blur(angle.at(step)).seed(step as u64);
///     // render, step of the optimiser …
///     # let _ = options;
/// }
/// assert_eq!(angle.at(0), 1e-1);
/// assert!((angle.at(20 + 50) - 1e-2).abs() < 1e-12);
/// assert_eq!(angle.at(120), 1e-3);
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct BlurSchedule {
    start: f64,
    end: f64,
    hold: usize,
    steps: usize,
    /// Whether it falls as half a period of the cosine, instead of by equal factors.
    cosine: bool,
}

impl BlurSchedule {
    /// A schedule with the same value at every step: radians for cones, scene units squared for the softmax.
    ///
    /// # Errors
    /// If it is not a finite number ≥ 0.
    pub fn constant(value: f64) -> Result<Self> {
        let valid = value.is_finite() && value >= 0.0;
        Error::unless(valid, OBJECT, "value", value, "a finite number ≥ 0")?;
        Ok(Self::new(value, value, 1))
    }

    /// A schedule from `start` at step 0 to `end` at step `steps` and after it: start·(end/start)^(step/steps);
    /// radians for cones, scene units squared for the softmax.
    ///
    /// # Errors
    /// If one of them is not a finite number > 0, `end` is larger than `start`, or there are no
    /// steps.
    pub fn decay(start: f64, end: f64, steps: usize) -> Result<Self> {
        check_ends(OBJECT, start, end)?;
        Error::unless(steps > 0, OBJECT, "steps", steps, "at least 1")?;
        Ok(Self::new(start, end, steps))
    }

    /// As [`BlurSchedule::decay`], but slow at both ends: start·(end/start)^((1 −
    /// cos(π·step/steps))/2). It is at the geometric mean half-way, like `decay`, and there falls
    /// π/2 times as fast.
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

    /// Sets the number of steps for which the value stays at the start.
    pub fn hold(mut self, steps: usize) -> Self {
        self.hold = steps;
        self
    }

    /// The value at a step: radians for cones, scene units squared for the softmax.
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

/// Blur of either kind, for a fit.
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
    /// Blur that depends on the number of the step.
    Scheduled(BlurSchedule),
    /// Blur that depends on the observed losses.
    Plateau(PlateauBlur),
}

impl Blur {
    /// The value at a step: radians for cones, scene units squared for the softmax. A
    /// plateau knows the present alone, whatever the step.
    pub fn value(&self, step: usize) -> f64 {
        match self {
            Self::Scheduled(schedule) => schedule.at(step),
            Self::Plateau(plateau) => plateau.value(),
        }
    }

    /// Observes the loss of a step, see [`PlateauBlur::observe`]; a schedule ignores it.
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

/// Checks that a value can fall from start to end by factors.
fn check_ends(object: &str, start: f64, end: f64) -> Result<()> {
    Error::unless_positive(object, "start", start)?;
    Error::unless_positive(object, "end", end)?;
    let expected = format!("at most the start, {start}");
    Error::unless(end <= start, object, "end", end, &expected)
}
