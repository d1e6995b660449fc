//! The settings of a gradient check.

use std::sync::Arc;

use burn::tensor::{DType, Device, Tensor};

use super::parameter::Checked;
use super::report::{Estimate, Row, Verdict};
use crate::device::is_cpu;
use crate::render::RenderOptions;

/// A function from the radiance `[H, W, 3]` to a scalar `[1]`.
pub(super) type Objective = Arc<dyn Fn(Tensor<3>) -> Tensor<1> + Send + Sync>;

/// The settings of [`gradcheck`](super::gradcheck).
///
/// [`gradcheck`](super::gradcheck) has an example.
#[derive(Clone)]
pub struct GradCheck {
    pub(super) options: RenderOptions,
    pub(super) device: Device,
    pub(super) dtype: DType,
    pub(super) precision: f64,
    pub(super) tolerance: f64,
    pub(super) least: u64,
    pub(super) budget: u64,
    pub(super) objective: Option<Objective>,
    pub(super) only: Option<Vec<String>>,
}

impl GradCheck {
    /// Makes settings from the options of the renders, whose seed is replaced. Tensors are f64 on a CPU backend and f32
    /// on others. By default the objective is the mean radiance under weights by how the parameters change the image, so
    /// that no derivative cancels over it.
    pub fn new(options: RenderOptions, device: &Device) -> Self {
        let device = device.clone().inner();
        let dtype = match is_cpu(&device) {
            true => DType::F64,
            false => DType::F32,
        };
        Self {
            options,
            device,
            dtype,
            precision: 0.01,
            tolerance: 0.01,
            least: 32,
            budget: 4096,
            only: None,
            objective: None,
        }
    }

    /// Sets the precision, as a fraction of the difference (0.01 by default). Renders are added until the standard
    /// error of gradient − difference is at most this.
    pub fn with_precision(mut self, share: f64) -> Self {
        self.precision = share;
        self
    }

    /// Sets the tolerance, as a fraction of the difference (0.01 by default). It allows for rounding. A disagreement
    /// exceeds both the tolerance and 3.5 standard errors, or more for few seeds.
    pub fn with_tolerance(mut self, share: f64) -> Self {
        self.tolerance = share;
        self
    }

    /// Sets the minimum and maximum number of seeds (32 and 4,096 by default, even and at least 8). Per seed, a gradient
    /// takes one render and a difference two.
    pub fn with_seeds(mut self, least: u64, most: u64) -> Self {
        self.least = least.max(8).next_multiple_of(2);
        self.budget = most.max(self.least).next_multiple_of(2);
        self
    }

    /// Checks only the parameters with these names. The others are constants of the scene.
    pub fn with_parameters(mut self, names: &[&str]) -> Self {
        self.only = Some(names.iter().map(|n| (*n).to_owned()).collect());
        self
    }

    /// Whether a parameter is to be checked.
    pub(super) fn checks(&self, p: &Checked) -> bool {
        let only = self.only.as_ref();
        only.is_none_or(|names| names.contains(&p.name))
    }

    /// Sets the differentiated function, from the radiance `[H, W, 3]` to a scalar `[1]`.
    pub fn with_objective(
        mut self,
        f: impl Fn(Tensor<3>) -> Tensor<1> + Send + Sync + 'static,
    ) -> Self {
        self.objective = Some(Arc::new(f));
        self
    }

    /// Whether the standard error of a row is small enough relative to its difference.
    fn precise(&self, row: &Row) -> bool {
        row.apart.error <= self.precision * row.difference.mean.abs()
    }

    /// Whether a row needs no more seeds. Of many rows some disagree by chance, so that it is confirmed with more seeds.
    pub(super) fn decided(&self, row: &Row) -> bool {
        let is_certain = || row.apart.mean.abs() > 3.0 * limit(row.apart.seeds) * row.apart.error;
        match row.verdict {
            Verdict::Agrees => true,
            Verdict::Disagrees => is_certain(),
            Verdict::Undecided => false,
        }
    }

    /// Makes a row from the gradients and differences of all seeds.
    pub(super) fn row(&self, parameter: &str, gradients: &[f64], differences: &[f64]) -> Row {
        let pairs = gradients.iter().zip(differences);
        let mut row = Row {
            parameter: parameter.to_owned(),
            gradient: Estimate::of(gradients),
            difference: Estimate::of(differences),
            apart: Estimate::of(&pairs.map(|(g, d)| g - d).collect::<Vec<_>>()),
            verdict: Verdict::Undecided,
        };
        row.verdict = self.verdict(&row);
        row
    }

    fn verdict(&self, row: &Row) -> Verdict {
        let apart = row.apart.mean.abs();
        if apart > limit(row.apart.seeds) * row.apart.error
            && apart > self.tolerance * row.difference.mean.abs()
        {
            Verdict::Disagrees
        } else if self.precise(row) {
            Verdict::Agrees
        } else {
            Verdict::Undecided
        }
    }
}

/// Returns the number of standard errors that a mean exceeds as rarely as 3.5 with very many seeds: Student's t by its first
/// terms (Fisher and Cornish 1960). Two seeds make one number.
fn limit(seeds: u64) -> f64 {
    let z = 3.5f64;
    let freedom = (seeds / 2).saturating_sub(1).max(1) as f64;
    let [z2, z4] = [2, 4].map(|power| z.powi(power));
    let second = (5.0 * z4 + 16.0 * z2 + 3.0) / (96.0 * freedom * freedom);
    z * (1.0 + (z2 + 1.0) / (4.0 * freedom) + second)
}
