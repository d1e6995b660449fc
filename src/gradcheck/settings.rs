//! The settings of a comparison.

use std::sync::Arc;

use burn::tensor::{DType, Device, Tensor};

use super::parameter::Checked;
use super::report::{Estimate, Row, Verdict};
use crate::device::is_cpu;
use crate::render::RenderOptions;

type Objective = Arc<dyn Fn(Tensor<3>) -> Tensor<1> + Send + Sync>;

/// The settings of [`gradcheck`](super::gradcheck).
#[derive(Clone)]
pub struct GradCheck {
    pub(super) options: RenderOptions,
    pub(super) device: Device,
    pub(super) dtype: DType,
    pub(super) precision: f64,
    pub(super) tolerance: f64,
    pub(super) least: u64,
    pub(super) budget: u64,
    pub(super) objective: Objective,
    pub(super) only: Option<Vec<String>>,
}

impl GradCheck {
    /// With the settings of each render, whose seed is replaced. On a CPU backend in f64, else in
    /// f32. The objective is the mean radiance under weights that rise across the image, so that
    /// no symmetry cancels.
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
            tolerance: 0.03,
            least: 32,
            budget: 4096,
            only: None,
            objective: Arc::new(|radiance| {
                let [h, w, _] = radiance.dims();
                let weight = |i: usize| {
                    0.5 + ((i % w) as f32 + 0.5) / w as f32 + 0.5 * (i / w) as f32 / h as f32
                };
                let weights: Vec<f32> = (0..h * w).map(weight).collect();
                let device = radiance.device().inner();
                let weights = Tensor::<1>::from_floats(weights.as_slice(), &device)
                    .cast(radiance.dtype())
                    .reshape([h, w, 1]);
                (radiance * weights).mean()
            }),
        }
    }

    /// Renders are added until the standard error of gradient − difference is under this share of the difference
    /// (1 % by default).
    pub fn precision(mut self, share: f64) -> Self {
        self.precision = share;
        self
    }

    /// A disagreement is more than 3.5 standard errors and more than this share of the difference,
    /// which is what steps of a finite size may be off by (3 % by default).
    pub fn tolerance(mut self, share: f64) -> Self {
        self.tolerance = share;
        self
    }

    /// The least and the most seeds (32 and 4,096 by default). A gradient takes one render a seed, a difference two.
    pub fn seeds(mut self, least: u64, most: u64) -> Self {
        self.least = least.max(2);
        self.budget = most.max(least).max(2);
        self
    }

    /// Checks only the parameters of these names; the scene gets all, the others as constants.
    pub fn only(mut self, names: &[&str]) -> Self {
        self.only = Some(names.iter().map(|n| (*n).to_owned()).collect());
        self
    }

    /// Whether a parameter is one to check.
    pub(super) fn checks(&self, p: &Checked) -> bool {
        let only = self.only.as_ref();
        only.is_none_or(|names| names.contains(&p.name))
    }

    /// The function that is differentiated: a scalar `[1]` of the radiance `[H, W, 3]`.
    pub fn objective(mut self, f: impl Fn(Tensor<3>) -> Tensor<1> + Send + Sync + 'static) -> Self {
        self.objective = Arc::new(f);
        self
    }

    /// Whether the standard error of a row is small enough beside its difference.
    pub(super) fn precise(&self, row: &Row) -> bool {
        row.apart.error <= self.precision * row.difference.mean.abs()
    }

    /// Of gradients and differences by seed.
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
        if apart > 3.5 * row.apart.error && apart > self.tolerance * row.difference.mean.abs() {
            Verdict::Disagrees
        } else if self.precise(row) {
            Verdict::Agrees
        } else {
            Verdict::Undecided
        }
    }
}
