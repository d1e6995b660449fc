//! Estimates derivatives over seeds.

use std::ops::Range;

use burn::tensor::{Tensor, TensorData};
use rayon::prelude::*;

use super::parameter::{Checked, Point};
use super::report::Row;
use super::settings::{GradCheck, Objective};
use crate::device::is_cpu;
use crate::error::{Error, Result};
use crate::geometry::host_values;
use crate::render::{RenderOptions, render};
use crate::scene::{Camera, Scene};
use softray_kernels::model::integers::mix;

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

impl<F: Fn(&Point) -> Result<(Scene, Camera)> + Sync> Run<'_, F> {
    pub fn radiance(&self, point: &Point, seed: u64) -> Result<Tensor<3>> {
        let (scene, camera) = (self.build)(point)?;
        let image = render(&scene, &camera, &self.options.clone().with_seed(seed))?;
        Ok(image.radiance)
    }

    pub fn point(&self, values: &[Vec<f64>], track: bool) -> Point {
        point(self.parameters, self.settings, values, track)
    }

    /// Returns the parameters at a point of the box, whose coordinates are from −1 to 1 along each direction.
    pub fn at(&self, directions: &[Direction], coordinates: &[f64]) -> Vec<Vec<f64>> {
        let mut values: Vec<Vec<f64>> = self.parameters.iter().map(|p| p.values.clone()).collect();
        for (direction, coordinate) in directions.iter().zip(coordinates) {
            let by = coordinate * self.parameters[direction.parameter].step;
            let all = values[direction.parameter].iter_mut();
            all.zip(&direction.vector).for_each(|(v, d)| *v += by * d);
        }
        values
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
    pub fn rows(&self, directions: &[Direction], objective: &Objective) -> Result<Vec<Row>> {
        let mut gradients: Vec<Vec<f64>> = Vec::new();
        let mut differences = vec![Vec::new(); directions.len()];
        let mut rows: Vec<Option<Row>> = vec![None; directions.len()];
        let mut wanted = self.settings.least;
        loop {
            let new = gradients.len() as u64..wanted;
            let of_seed = |seed| self.gradients(directions, objective, seed);
            gradients.extend(self.over(new.clone(), of_seed)?);
            let mut factor = 1.0f64;
            for (c, direction) in directions.iter().enumerate() {
                if rows[c]
                    .as_ref()
                    .is_some_and(|row| self.settings.decided(row))
                {
                    continue;
                }
                let at = |coordinates: &[f64], seed| {
                    let point = self.point(&self.at(directions, coordinates), false);
                    Ok(host_values(&objective(self.radiance(&point, seed)?))?[0])
                };
                let width = 2.0 * self.parameters[direction.parameter].step;
                let of_seed = |seed| {
                    let mut ends = [(); 2].map(|()| coordinates(directions.len(), seed));
                    [ends[0][c], ends[1][c]] = [-1.0, 1.0];
                    Ok((at(&ends[1], seed)? - at(&ends[0], seed)?) / width)
                };
                differences[c].extend(self.over(new.clone(), of_seed)?);
                let by_seed: Vec<f64> = gradients.iter().map(|g| g[c]).collect();
                let row = self
                    .settings
                    .row(&direction.name, &by_seed, &differences[c]);
                if !self.settings.decided(&row) {
                    // The noisiest row sets the factor of the number of seeds.
                    let goal = self.settings.precision * row.difference.mean.abs();
                    factor = factor.max((row.apart.error / goal).powi(2)).max(2.0);
                }
                rows[c] = Some(row);
            }
            if factor <= 1.0 || wanted >= self.settings.budget {
                return Ok(rows.into_iter().flatten().collect());
            }
            let more = (1.1 * factor).min(8.0) * wanted as f64;
            wanted = (more.ceil() as u64).next_multiple_of(2);
            wanted = wanted.min(self.settings.budget);
        }
    }

    /// Returns the derivatives by autodiff.
    fn gradients(
        &self,
        directions: &[Direction],
        objective: &Objective,
        seed: u64,
    ) -> Result<Vec<f64>> {
        let values = self.at(directions, &coordinates(directions.len(), seed));
        let point = self.point(&values, true);
        let value = objective(self.radiance(&point, seed)?);
        let tracked = value.is_tracked();
        let expected = "a scene that depends on the parameters";
        Error::unless(tracked, "gradcheck", "objective", "a constant", expected)?;
        let gradients = value.backward();
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

/// Returns a point of the box, from −1 to 1 in each coordinate. An even seed and the next one have opposite points, so
/// that a derivative that changes linearly over the box has no noise from it.
fn coordinates(count: usize, seed: u64) -> Vec<f64> {
    let side = if seed.is_multiple_of(2) { 1.0 } else { -1.0 };
    let number = |c: usize| mix(mix(seed / 2) ^ c as u64) as f64 / 2f64.powi(64);
    (0..count).map(|c| side * (2.0 * number(c) - 1.0)).collect()
}
