//! Estimates derivatives over seeds.

use std::ops::Range;

use burn::tensor::{Tensor, TensorData};
use rayon::prelude::*;

use super::parameter::{Checked, Point};
use super::report::Row;
use super::settings::GradCheck;
use crate::device::is_cpu;
use crate::error::{Error, Result};
use crate::geometry::host_values;
use crate::render::{RenderOptions, render};
use crate::scene::{Camera, Scene};

/// Makes tensors of the parameters. With `track`, those to check are tracked.
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

/// A direction along which a parameter is differentiated.
pub(super) struct Direction {
    /// The index of the parameter.
    pub parameter: usize,
    pub name: String,
    pub vector: Vec<f64>,
}

/// A running comparison.
pub(super) struct Run<'a, F> {
    pub parameters: &'a [Checked],
    pub settings: &'a GradCheck,
    pub options: RenderOptions,
    pub build: &'a F,
}

impl<F: Fn(&Point) -> Result<(Scene, Camera)> + Sync> Run<'_, F> {
    fn objective(&self, point: &Point, seed: u64) -> Result<Tensor<1>> {
        let (scene, camera) = (self.build)(point)?;
        let image = render(&scene, &camera, &self.options.clone().with_seed(seed))?;
        Ok((self.settings.objective)(image.radiance))
    }

    fn values(&self) -> Vec<Vec<f64>> {
        self.parameters.iter().map(|p| p.values.clone()).collect()
    }

    /// Returns the values of `f` for each seed.
    fn over<T: Send>(
        &self,
        seeds: Range<u64>,
        f: impl Fn(u64) -> Result<T> + Sync,
    ) -> Result<Vec<T>> {
        match is_cpu(&self.settings.device) {
            true => seeds.into_par_iter().map(&f).collect(),
            false => seeds.map(f).collect(),
        }
    }

    /// Returns both derivatives along each direction. Both use the same seeds, so that shared noise cancels. Seeds are
    /// added to a direction until the standard error of gradient − difference is small enough.
    pub fn rows(&self, directions: &[Direction]) -> Result<Vec<Row>> {
        let mut gradients: Vec<Vec<f64>> = Vec::new();
        let mut differences = vec![Vec::new(); directions.len()];
        let mut rows: Vec<Option<Row>> = vec![None; directions.len()];
        let mut wanted = self.settings.least;
        loop {
            let new = gradients.len() as u64..wanted;
            gradients.extend(self.over(new.clone(), |seed| self.gradients(directions, seed))?);
            let mut factor = 1.0f64;
            for (c, direction) in directions.iter().enumerate() {
                if rows[c]
                    .as_ref()
                    .is_some_and(|row| self.settings.precise(row))
                {
                    continue;
                }
                let more = self.over(new.clone(), |seed| self.difference(direction, seed))?;
                differences[c].extend(more);
                let by_seed: Vec<f64> = gradients.iter().map(|g| g[c]).collect();
                let row = self
                    .settings
                    .row(&direction.name, &by_seed, &differences[c]);
                if !self.settings.precise(&row) {
                    // The noisiest row sets the factor of the number of seeds.
                    let goal = self.settings.precision * row.difference.mean.abs();
                    factor = factor.max((row.apart.error / goal).powi(2));
                }
                rows[c] = Some(row);
            }
            if factor <= 1.0 || wanted >= self.settings.budget {
                return Ok(rows.into_iter().flatten().collect());
            }
            let more = (1.1 * factor).min(8.0) * wanted as f64;
            wanted = (more.ceil() as u64).min(self.settings.budget);
        }
    }

    /// Returns a derivative by central differences.
    fn difference(&self, direction: &Direction, seed: u64) -> Result<f64> {
        let parameter = direction.parameter;
        let step = self.parameters[parameter].step;
        let at = |sign: f64| -> Result<f64> {
            let mut values = self.values();
            for (v, d) in values[parameter].iter_mut().zip(&direction.vector) {
                *v += sign * step * d;
            }
            let point = point(self.parameters, self.settings, &values, false);
            Ok(host_values(&self.objective(&point, seed)?)?[0])
        };
        Ok((at(1.0)? - at(-1.0)?) / (2.0 * step))
    }

    /// Returns the derivatives by autodiff.
    fn gradients(&self, directions: &[Direction], seed: u64) -> Result<Vec<f64>> {
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
    }
}
