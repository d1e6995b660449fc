//! The values of a scene and a camera as numbers, and differences of these.

use std::collections::HashMap;

use burn::tensor::Tensor;

use crate::error::{Error, Result};
use crate::geometry::host_values;
use crate::scene::{Camera, Described, Parameter, Scene, Visit, visit_tensors};
use softray_kernels::host::ParameterId;

/// The first step of the differences, relative to a number of size 1 or more, the factor from one step to the next, and
/// the number of steps.
const STEP: f64 = 0.5;
const FACTOR: f64 = 4.0;
const STEPS: usize = 6;
/// The error, relative to the largest derivative, at which the extrapolation ends. It is above the rounding of f32.
const PRECISION: f64 = 1e-6;
/// Extrapolates central differences to a step of 0, by Neville's scheme. Returns the entry of the scheme that differs
/// least from those from which it was made.
pub(super) fn extrapolated(
    number: f64,
    difference: &mut impl FnMut(f64) -> Result<Vec<Values>>,
) -> Result<Vec<Values>> {
    let mut best: Option<(f64, Vec<Values>)> = None;
    let mut last: Vec<Vec<Values>> = Vec::new();
    let mut failed = None;
    for i in 0..STEPS {
        let step = STEP * number.abs().max(1.0) / FACTOR.powi(i as i32);
        let mut row = vec![match difference(step) {
            Ok(values) => values,
            Err(error) if last.is_empty() => {
                failed = Some(error);
                continue;
            }
            Err(error) => return Err(error),
        }];
        let mut error = f64::INFINITY;
        for (j, coarse) in last.iter().enumerate() {
            let factor = FACTOR.powi(2 * (j as i32 + 1));
            let pairs = row[j].iter().zip(coarse);
            let finer: Vec<Values> = pairs.map(|(a, b)| a.extrapolated(b, factor)).collect();
            let distance = |other: &[Values]| {
                let pairs = finer.iter().zip(other);
                pairs.map(|(a, b)| a.distance(b)).fold(0.0, f64::max)
            };
            let own = distance(&row[j]).max(distance(coarse));
            error = error.min(own);
            if best.as_ref().is_none_or(|(least, _)| own <= *least) {
                best = Some((own, finer.clone()));
            }
            row.push(finer);
        }
        let least = best.as_ref().map_or(f64::INFINITY, |best| best.0);
        let size = best.iter().flat_map(|best| &best.1).map(Values::largest);
        if least <= PRECISION * size.fold(0.0, f64::max)
            || (error.is_finite() && error > 2.0 * least)
        {
            break;
        }
        last = row;
    }
    match (best, failed) {
        (Some((_, values)), _) => Ok(values),
        (None, Some(error)) => Err(error),
        (None, None) => unreachable!("there are several steps"),
    }
}

/// The values of all tensors and constants of a scene and a camera, in the order of a visit.
#[derive(Clone)]
pub(crate) struct Values {
    pub(super) all: Vec<(ParameterId, Vec<f64>)>,
}

/// Reads [`Values`].
struct Read {
    all: Result<Vec<(ParameterId, Vec<f64>)>>,
}

impl Values {
    pub(crate) fn of(scene: &Scene, camera: &Camera) -> Result<Self> {
        let mut read = Read {
            all: Ok(Vec::new()),
        };
        visit_tensors(&mut scene.clone(), &mut camera.clone(), &mut read);
        Ok(Self { all: read.all? })
    }

    /// Returns the differences from other values, divided by `step`.
    pub(super) fn minus(mut self, other: &Self, step: f64) -> Self {
        for ((_, own), (_, other)) in self.all.iter_mut().zip(&other.all) {
            own.iter_mut()
                .zip(other)
                .for_each(|(a, b)| *a = (*a - b) / step);
        }
        self
    }

    /// Returns (factor · these − coarser values) / (factor − 1).
    fn extrapolated(&self, coarse: &Self, factor: f64) -> Self {
        let mut finer = self.clone();
        for ((_, own), (_, coarse)) in finer.all.iter_mut().zip(&coarse.all) {
            for (own, coarse) in own.iter_mut().zip(coarse) {
                *own += (*own - coarse) / (factor - 1.0);
            }
        }
        finer
    }

    /// Returns the largest absolute value.
    fn largest(&self) -> f64 {
        let values = self.all.iter().flat_map(|(_, values)| values);
        values.fold(0.0, |largest, value| value.abs().max(largest))
    }

    /// Returns the largest difference of two values.
    fn distance(&self, other: &Self) -> f64 {
        let pairs = self.all.iter().zip(&other.all);
        let of_pair = |((_, a), (_, b)): (&(_, Vec<f64>), &(_, Vec<f64>))| {
            let differences = a.iter().zip(b).map(|(a, b)| (a - b).abs());
            differences.fold(0.0, f64::max)
        };
        pairs.map(of_pair).fold(0.0, f64::max)
    }
}

impl Read {
    fn push(&mut self, id: ParameterId, values: Result<Vec<f64>>) {
        if let Ok(all) = &mut self.all {
            match values {
                Ok(values) => all.push((id, values)),
                Err(error) => self.all = Err(error),
            }
        }
    }
}

impl Visit for Read {
    fn visit<const D: usize>(&mut self, id: ParameterId, tensor: &mut Tensor<D>) {
        self.push(id, host_values(tensor));
    }

    fn parameter<const C: usize>(&mut self, id: ParameterId, p: &mut Parameter<C>) {
        self.push(id, p.values().map(|values| values.to_vec()));
    }
}

/// Checks that values are those of a scene of the same structure.
pub(super) fn check_same(values: &Values, shapes: &Values) -> Result<()> {
    let of = |values: &Values| -> HashMap<ParameterId, usize> {
        values.all.iter().map(|(id, v)| (*id, v.len())).collect()
    };
    let (found, expected) = (of(values), of(shapes));
    // Tangents of normal maps may have been computed for one of them.
    let computed = |id: &ParameterId| matches!(id, ParameterId::Tangents(_));
    for (id, count) in &found {
        match expected.get(id) {
            Some(other) if other != count => {
                return Err(invalid(
                    *id,
                    count,
                    &format!("{other} values as in the scene"),
                ));
            }
            None if !computed(id) => {
                return Err(invalid(*id, "present", "absent as in the scene"));
            }
            _ => {}
        }
    }
    match expected.keys().find(|id| !found.contains_key(id)) {
        Some(id) => Err(invalid(*id, "absent", "present as in the scene")),
        None => Ok(()),
    }
}

pub(super) fn invalid(id: ParameterId, found: impl ToString, expected: &str) -> Error {
    Error::invalid("tangent", id.name(), found, expected)
}
