//! The problem of a step: its equations, and the damping of the step.

use burn::module::Module;
use burn::tensor::Tensor;

use super::equations::Equations;
use super::numbers::{gradients, numbers, with_numbers};
use super::residual::Residual;
use crate::error::{Error, Result};
use crate::optim::fit::check::not_finite;
use crate::optim::fit::step::Evaluated;
use crate::optim::fit::{Evaluation, History, Step};
use crate::render::{Tangent, Values};

/// The most numbers of a module: each costs derivative images.
const MAX_NUMBERS: usize = 256;
/// The damping of the first step, the least and the most, and the factor between those that a step tries.
const DAMPING: f64 = 1.0;
const MIN_DAMPING: f64 = 1e-6;
const MAX_DAMPING: f64 = 1e6;
const FACTOR: f64 = 10.0;
/// The names of values in the history: the damping, the number of steps that are averaged, and the level of noise below
/// which losses are not distinguished.
const NAMES: [&str; 3] = ["damping", "averaged", "noise"];

/// The views of a module.
pub(super) type Views<'a, M> = &'a mut dyn FnMut(&M) -> Result<Vec<Residual>>;

/// The problem of a step.
pub(super) struct Problem<'a, M> {
    module: &'a M,
    step: &'a Step,
    numbers: Vec<f64>,
}

impl<'a, M: Module> Problem<'a, M> {
    pub fn new(module: &'a M, step: &'a Step) -> Result<Self> {
        let numbers = numbers(module)?;
        let few = numbers.len() <= MAX_NUMBERS;
        let expected = format!("at most {MAX_NUMBERS} that are not frozen; Fit is for more");
        Error::unless(
            few,
            "least squares",
            "numbers of the module",
            numbers.len(),
            &expected,
        )?;
        Ok(Self {
            module,
            step,
            numbers,
        })
    }

    /// Returns the seeds of a pair of renders of a view. The first pair is for derivatives, the second for images.
    fn seeds(&self, view: usize, pair: u64) -> [u64; 2] {
        let first = 4 * view as u64 + 2 * pair;
        [first, first + 1].map(|render| self.step.seed(render))
    }

    /// Evaluates the step. The gradients move the numbers to the next point if their rate is 1.
    pub fn evaluated(&self, f: Views<M>, history: &History) -> Result<Evaluated> {
        // The numbers are not tracked, so renders record no tape.
        let views = f(&with_numbers(self.module, &self.numbers))?;
        Error::unless(
            !views.is_empty(),
            "least squares",
            "residuals",
            "empty",
            "at least one",
        )?;
        views.iter().try_for_each(Residual::check)?;
        let (mut evaluation, equations) = self.equations(&views, f)?;
        if !equations.loss.is_finite() {
            return Err(not_finite("the loss", equations.loss, self.step.index));
        }
        let unused: Vec<usize> = equations.unused().collect();
        if unused.len() == self.numbers.len() && self.step.index == 0 {
            let expected = "numbers of the module on which the images depend";
            return Err(Error::invalid(
                "least squares",
                "derivatives",
                "0",
                expected,
            ));
        }
        let last = |name: &str| history.curve(name).last().map(|point| point.1);
        let [damping, averaged, _] = NAMES.map(last);
        let noise = equations.variance.sqrt();
        // Another blur has another solution.
        let same_blur = history.rows.last().map(|row| row.blur) == Some(self.step.blur);
        let averaged = averaged.filter(|_| same_blur);
        // Far from the target, earlier steps do not count.
        let (damping, step, averaged) = if equations.decrease() < noise {
            let (damping, step) = equations.step_of_least_damping();
            (damping, step, averaged.unwrap_or(0.0) + 1.0)
        } else {
            let (damping, step) = self.best(&equations, damping.unwrap_or(DAMPING), f)?;
            (damping, step, 1.0)
        };
        let values = NAMES.into_iter().zip([damping, averaged, noise]);
        evaluation = values.fold(evaluation, |all, (name, value)| all.with_value(name, value));
        let step: Vec<f64> = step.iter().map(|x| x / averaged).collect();
        let nothing = unused.len() == self.numbers.len();
        let moves = |i: usize| nothing || !unused.contains(&i);
        Ok(Evaluated {
            evaluation,
            loss: equations.loss,
            gradients: gradients(self.module, &step, moves),
        })
    }

    /// Renders all views with derivatives.
    fn equations(&self, views: &[Residual], f: Views<M>) -> Result<(Evaluation, Equations)> {
        let shapes = views.iter().map(|v| Values::of(&v.scene, &v.camera));
        let shapes = shapes.collect::<Result<Vec<_>>>()?;
        let mut build = |numbers: &[f64]| {
            let views = f(&with_numbers(self.module, numbers))?;
            let same = views.len() == shapes.len();
            let expected = format!("{} at all points", shapes.len());
            Error::unless(
                same,
                "least squares",
                "number of residuals",
                views.len(),
                &expected,
            )?;
            Ok(views.into_iter().map(|v| (v.scene, v.camera)).collect())
        };
        let by_number = Tangent::of_views(&self.numbers, &shapes, &mut build)?;
        let device = views[0].target.device();
        let mut evaluation = Evaluation::new(Tensor::zeros([1], &device));
        let mut all = Equations::zero(self.numbers.len());
        for (index, view) in views.iter().enumerate() {
            let tangents: Vec<Tangent> = by_number.iter().map(|of| of[index].clone()).collect();
            let seeds = [0, 1].map(|pair| self.seeds(index, pair));
            let [a, b] = [0, 1].map(|k| view.linear(&tangents, seeds.map(|pair| pair[k])));
            let ((image, a), (_, b)) = (a?, b?);
            all.add(&Equations::new(&a, &b));
            let values = view.values.iter();
            evaluation = values
                .fold(evaluation, |all, (name, value)| {
                    all.with_value(name, *value)
                })
                .with_image(view.name.as_str(), image)
                .with_target(view.name.as_str(), view.target.clone());
        }
        evaluation.check()?;
        Ok((evaluation, all))
    }

    /// Returns the damping and the step with the least loss: it goes from the last damping to larger and to smaller ones
    /// while the loss falls. The step is 0 if none reduces the loss.
    fn best(&self, equations: &Equations, last: f64, f: Views<M>) -> Result<(f64, Vec<f64>)> {
        let none = vec![0.0; self.numbers.len()];
        let here = self.loss(&none, f)?;
        let mut tried = |damping: f64| -> (f64, f64, Vec<f64>) {
            let step = equations.step(damping);
            // A long step may lead to a scene that is an error.
            let of_step = step.map(|step| (self.loss(&step, f).unwrap_or(f64::INFINITY), step));
            let (loss, step) = of_step.unwrap_or((f64::INFINITY, none.clone()));
            (loss, damping, step)
        };
        let mut best = tried(last);
        for factor in [FACTOR, FACTOR.recip()] {
            let from = best.1;
            let dampings = (1..).map(|k| from * factor.powi(k));
            for damping in dampings.take_while(|d| (MIN_DAMPING..=MAX_DAMPING).contains(d)) {
                let next = tried(damping);
                // Larger dampings are tried until one reduces the loss.
                let hopeless = factor > 1.0 && best.0.min(next.0) >= here;
                if next.0 >= best.0 && !hopeless {
                    break;
                }
                if next.0 < best.0 {
                    best = next;
                }
            }
            if best.1 != last {
                break;
            }
        }
        // Differences within the noise do not matter.
        if best.0 > here + equations.variance.sqrt() {
            return Ok((DAMPING.max(last), none));
        }
        Ok((best.1, best.2))
    }

    /// Returns the loss after a step, with the same seeds for all steps.
    fn loss(&self, step: &[f64], f: Views<M>) -> Result<f64> {
        let pairs = self.numbers.iter().zip(step);
        let numbers: Vec<f64> = pairs.map(|(number, step)| number + step).collect();
        let views = f(&with_numbers(self.module, &numbers))?;
        let views = views.iter().enumerate();
        let losses = views.map(|(index, view)| view.loss(self.seeds(index, 1)));
        losses.sum()
    }
}
