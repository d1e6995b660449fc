//! The parameters whose gradients are checked.

use std::fmt;

use burn::tensor::{DType, Device, Tensor};

use crate::debug::{numbers, tensor};
use crate::error::{Error, Result, one_of};

/// A parameter to check: a tensor `[C]`, component by component or along one direction.
#[derive(Clone)]
pub struct Checked {
    pub(super) name: String,
    pub(super) values: Vec<f64>,
    direction: Option<Vec<f64>>,
    pub(super) step: f64,
}

impl Checked {
    /// By name, with its values and the step h of (f(x + h) − f(x − h))/2h, which is off by about
    /// h²·f'''/6: a few per cent of what the parameter means for the scene.
    pub fn new(name: impl Into<String>, values: impl Into<Vec<f64>>, step: f64) -> Self {
        Self {
            name: name.into(),
            values: values.into(),
            direction: None,
            step,
        }
    }

    /// Checks the derivative along one direction in place of each component's: for parameters
    /// with many, such as vertices.
    pub fn along(mut self, direction: impl Into<Vec<f64>>) -> Self {
        self.direction = Some(direction.into());
        self
    }

    /// The directions to check, by name.
    pub(super) fn directions(&self) -> Vec<(String, Vec<f64>)> {
        let n = self.values.len();
        match &self.direction {
            Some(d) => vec![(self.name.clone(), d.clone())],
            None if n == 1 => vec![(self.name.clone(), vec![1.0])],
            None => (0..n)
                .map(|i| {
                    let axis = (0..n).map(|j| if i == j { 1.0 } else { 0.0 }).collect();
                    (format!("{}[{i}]", self.name), axis)
                })
                .collect(),
        }
    }

    pub(super) fn check(&self) -> Result<()> {
        let invalid = |field: &str, value: String, expected: &str| {
            Err(Error::invalid(&self.name, field, value, expected))
        };
        if self.values.is_empty() || self.values.iter().any(|v| !v.is_finite()) {
            return invalid("values", format!("{:?}", self.values), "finite numbers");
        }
        if !(self.step.is_finite() && self.step > 0.0) {
            return invalid("step", self.step.to_string(), "a finite number > 0");
        }
        match &self.direction {
            Some(d) if d.len() != self.values.len() || d.iter().any(|v| !v.is_finite()) => invalid(
                "direction",
                format!("{d:?}"),
                "a finite number for each value",
            ),
            _ => Ok(()),
        }
    }
}

/// The parameters as tensors, handed to the closure that builds a scene.
#[derive(Clone)]
pub struct Point {
    /// The device that the scene has to be on.
    pub device: Device,
    /// The float type that all of the scene's tensors need: see [`Mesh::cast`](crate::scene::Mesh::cast).
    pub dtype: DType,
    pub(super) tensors: Vec<(String, Tensor<1>)>,
}

impl Point {
    /// A parameter `[C]`, in the graph where autodiff is asked.
    ///
    /// # Errors
    /// If there is none of that name.
    pub fn get(&self, name: &str) -> Result<Tensor<1>> {
        let found = self.tensors.iter().find(|(n, _)| n == name);
        found.map(|(_, t)| t.clone()).ok_or_else(|| {
            let names = one_of(self.tensors.iter().map(|(n, _)| n.as_str()));
            Error::invalid("gradcheck", "parameter", format!("{name:?}"), names)
        })
    }
}

impl fmt::Debug for Checked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut all = f.debug_struct("Checked");
        all.field("name", &self.name)
            .field("values", &numbers(self.values.iter().copied()))
            .field("step", &self.step);
        if let Some(direction) = &self.direction {
            all.field("direction", &numbers(direction.iter().copied()));
        }
        all.finish()
    }
}

impl fmt::Debug for Point {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let tensors = self.tensors.iter().map(|(name, t)| (name, tensor(t)));
        f.debug_map().entries(tensors).finish()
    }
}
