//! Estimates of derivatives over seeds.

use burn::tensor::{Tensor, TensorData};
use rayon::prelude::*;

use super::parameter::{Checked, Point};
use super::report::Estimate;
use super::settings::GradCheck;
use crate::device::is_cpu;
use crate::error::{Error, Result};
use crate::geometry::host_values;
use crate::render::{RenderOptions, render};
use crate::scene::{Camera, Scene};

/// The parameters as tensors, in a graph if they are to be tracked.
pub(super) fn point(
    parameters: &[Checked],
    settings: &GradCheck,
    values: &[Vec<f64>],
    track: bool,
) -> Point {
    let tensors = parameters.iter().zip(values).map(|(p, v)| {
        let data = TensorData::new(v.clone(), [v.len()]);
        let t = Tensor::<1>::from_data(data, (&settings.device, settings.dtype));
        match track && settings.checks(p) {
            true => (p.name.clone(), t.autodiff().require_grad()),
            false => (p.name.clone(), t),
        }
    });
    Point {
        device: settings.device.clone(),
        dtype: settings.dtype,
        tensors: tensors.collect(),
    }
}

/// A direction in which a parameter is differentiated.
pub(super) struct Direction {
    /// The number of the parameter.
    pub parameter: usize,
    pub name: String,
    pub vector: Vec<f64>,
}

/// A comparison that runs.
pub(super) struct Run<'a, F> {
    pub parameters: &'a [Checked],
    pub settings: &'a GradCheck,
    pub options: RenderOptions,
    pub build: &'a F,
}

/// Seeds of the differences begin here, so that both sides are independent.
const DIFFERENCES: u64 = 1 << 40;

impl<F: Fn(&Point) -> Result<(Scene, Camera)> + Sync> Run<'_, F> {
    fn objective(&self, point: &Point, seed: u64) -> Result<Tensor<1>> {
        let (scene, camera) = (self.build)(point)?;
        let image = render(&scene, &camera, &self.options.clone().seed(seed))?;
        Ok((self.settings.objective)(image.radiance))
    }

    fn values(&self) -> Vec<Vec<f64>> {
        self.parameters.iter().map(|p| p.values.clone()).collect()
    }

    /// Estimates columns of values by seed, adding seeds until all are precise.
    fn estimate(
        &self,
        columns: usize,
        first: u64,
        f: impl Fn(u64) -> Result<Vec<f64>> + Sync,
        value: impl Fn(usize, &Estimate) -> f64,
    ) -> Result<Vec<Estimate>> {
        let mut found: Vec<Vec<f64>> = Vec::new();
        let mut wanted = self.settings.least;
        loop {
            let seeds = first + found.len() as u64..first + wanted;
            let new: Result<Vec<_>> = match is_cpu(&self.settings.device) {
                true => seeds.into_par_iter().map(&f).collect(),
                false => seeds.map(&f).collect(),
            };
            found.extend(new?);
            let estimates: Vec<Estimate> = (0..columns)
                .map(|c| Estimate::of(&found.iter().map(|v| v[c]).collect::<Vec<_>>()))
                .collect();
            let n = found.len() as u64;
            // The noisiest needs so many times the seeds.
            let factor = estimates
                .iter()
                .enumerate()
                .filter(|(c, e)| !self.settings.precise(**e, value(*c, e)))
                .map(|(c, e)| {
                    let goal = self.settings.precision * value(c, e).abs();
                    (e.error / goal).powi(2)
                })
                .fold(1.0f64, f64::max);
            if factor <= 1.0 || n >= self.settings.budget {
                return Ok(estimates);
            }
            let more = (1.1 * factor).min(8.0) * n as f64;
            wanted = (more.ceil() as u64).min(self.settings.budget);
        }
    }

    /// A derivative by central differences.
    pub fn difference(&self, direction: &Direction) -> Result<Estimate> {
        let parameter = direction.parameter;
        let step = self.parameters[parameter].step;
        let at = |sign: f64, seed: u64| -> Result<f64> {
            let mut values = self.values();
            for (v, d) in values[parameter].iter_mut().zip(&direction.vector) {
                *v += sign * step * d;
            }
            let point = point(self.parameters, self.settings, &values, false);
            Ok(host_values(&self.objective(&point, seed)?)?[0])
        };
        let one = |seed| Ok(vec![(at(1.0, seed)? - at(-1.0, seed)?) / (2.0 * step)]);
        Ok(self.estimate(1, DIFFERENCES, one, |_, e| e.mean)?[0])
    }

    /// Derivatives by autodiff.
    pub fn gradients(
        &self,
        directions: &[Direction],
        differences: &[Estimate],
    ) -> Result<Vec<Estimate>> {
        let one = |seed| -> Result<Vec<f64>> {
            let point = point(self.parameters, self.settings, &self.values(), true);
            let objective = self.objective(&point, seed)?;
            let tracked = objective.is_tracked();
            let expected = "a scene that depends on the parameters";
            Error::unless(tracked, "gradcheck", "objective", "a constant", expected)?;
            let gradients = objective.backward();
            let of = |t: &Tensor<1>| match t.grad(&gradients) {
                Some(g) => host_values(&g),
                None => Ok(vec![0.0; t.dims()[0]]),
            };
            let found = point.tensors.iter().map(|(_, t)| of(t));
            let found = found.collect::<Result<Vec<_>>>()?;
            let along = |d: &Direction| -> f64 {
                let pairs = found[d.parameter].iter().zip(&d.vector);
                pairs.map(|(g, d)| g * d).sum()
            };
            Ok(directions.iter().map(along).collect())
        };
        self.estimate(directions.len(), 0, one, |c, _| differences[c].mean)
    }
}
