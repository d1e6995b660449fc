//! Steps over several devices, by one thread a device.

use std::panic::resume_unwind;

use burn::module::Module;
use burn::optim::{GradientsAccumulator, GradientsParams};
use burn::tensor::Device;

use super::check::loss_of_step;
use super::step::Evaluated;
use super::{Evaluation, Step};
use crate::error::{Error, Result};

/// The part of a step that one device evaluates.
///
/// [`Fit::run_over`](super::Fit::run_over) has an example.
#[derive(Clone, Debug)]
pub struct Part {
    /// The device, without autodiff.
    pub device: Device,
    /// The index of the part, from 0.
    pub index: usize,
    /// The number of parts.
    pub count: usize,
}

impl Part {
    /// Returns this part's share of a list: consecutive items, and about as many as the others have.
    pub fn of<'a, T>(&self, all: &'a [T]) -> std::slice::Iter<'a, T> {
        let begin = |index: usize| all.len() * index / self.count;
        all[begin(self.index)..begin(self.index + 1)].iter()
    }

    /// Returns this part's share of a list for devices of different speed: consecutive items, whose number is in
    /// proportion to the weight of the part's device, rounded. A weight is a speed in any unit.
    ///
    /// ```
    /// use softray::optim::Part;
    /// use softray::prelude::*;
    ///
    /// let views = [0, 1, 2, 3, 4, 5, 6];
    /// let part = |index| Part { device: Device::flex(), index, count: 2 };
    /// assert_eq!(part(0).weighted(&views, &[3.0, 1.0])?.as_slice(), [0, 1, 2, 3, 4]);
    /// assert_eq!(part(1).weighted(&views, &[3.0, 1.0])?.as_slice(), [5, 6]);
    /// # Ok::<(), softray::Error>(())
    /// ```
    ///
    /// # Errors
    /// If the weights are not one for each device, each finite and not negative with a sum above 0.
    pub fn weighted<'a, T>(
        &self,
        all: &'a [T],
        weights: &[f64],
    ) -> Result<std::slice::Iter<'a, T>> {
        let sum: f64 = weights.iter().sum();
        let valid = weights.iter().all(|&w| w >= 0.0) && sum > 0.0 && sum.is_finite();
        if weights.len() != self.count || !valid {
            let expected = format!("{} numbers, not all of them 0", self.count);
            let found = format!("{weights:?}");
            return Err(Error::invalid("part of a step", "weights", found, expected));
        }
        let begin = |index: usize| {
            let before: f64 = weights[..index].iter().sum();
            (all.len() as f64 * before / sum).round() as usize
        };
        Ok(all[begin(self.index)..begin(self.index + 1)].iter())
    }
}

/// Evaluates all parts of a step, and sums their losses and gradients.
pub(super) fn evaluate_over<M: Module>(
    module: &M,
    step: &Step,
    devices: &[Device],
    f: &(impl Fn(&M, &Step, &Part) -> Result<Evaluation> + Sync),
) -> Result<Evaluated> {
    let main = module.devices().first().cloned();
    let main = main.ok_or_else(|| Error::invalid("fit", "module", "empty", "parameters"))?;
    let main = main.inner();
    let of_part = |copy: M, part: &Part| -> Result<Evaluated> {
        let evaluation = f(&copy, step, part)?;
        evaluation.check()?;
        let loss = loss_of_step(&evaluation.loss, step.index)?;
        let gradients = GradientsParams::from_grads(evaluation.loss.backward(), &copy);
        #[cfg(feature = "remote")]
        crate::render::finish(&part.device)?;
        Ok(Evaluated {
            evaluation,
            loss,
            gradients: gradients.to_device(&main, &copy),
        })
    };
    let parts = devices.iter().enumerate().map(|(index, device)| Part {
        device: device.clone().inner(),
        index,
        count: devices.len(),
    });
    let parts: Vec<Part> = parts.collect();
    let evaluated: Vec<Result<Evaluated>> = std::thread::scope(|scope| {
        let of_part = &of_part;
        let start = |part: &'_ Part| {
            let copy = module.clone().fork(&part.device.clone().autodiff());
            let part = part.clone();
            scope.spawn(move || of_part(copy, &part))
        };
        let threads: Vec<_> = parts.iter().map(start).collect();
        let results = threads.into_iter().map(|thread| thread.join());
        results
            .map(|result| result.unwrap_or_else(|panic| resume_unwind(panic)))
            .collect()
    });
    let mut all = GradientsAccumulator::<M>::new();
    let mut sum: Option<(Evaluation, f64)> = None;
    for evaluated in evaluated {
        let Evaluated {
            evaluation,
            loss,
            gradients,
        } = evaluated?;
        all.accumulate(module, gradients);
        sum = Some(match sum {
            None => (evaluation, loss),
            Some((mut first, total)) => {
                for (name, value) in evaluation.values {
                    match first.values.iter_mut().find(|known| known.0 == name) {
                        Some(known) => known.1 += value,
                        None => first.values.push((name, value)),
                    }
                }
                first.images.extend(evaluation.images);
                first.targets.extend(evaluation.targets);
                (first, total + loss)
            }
        });
    }
    let (evaluation, loss) =
        sum.ok_or_else(|| Error::invalid("fit", "devices", "empty", "at least one"))?;
    evaluation.check()?;
    Ok(Evaluated {
        evaluation,
        loss,
        gradients: all.grads(),
    })
}
