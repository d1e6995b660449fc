//! The parameters whose gradients are checked.

use burn::tensor::{DType, Device, Tensor};

use crate::error::{Error, Result, one_of};

/// A parameter to check: a tensor `[C]`, differentiated component by component or along one direction.
///
/// [`gradcheck`](super::gradcheck) has an example.
#[derive(Clone, Debug)]
pub struct Checked {
    pub(super) name: String,
    pub(super) values: Vec<f64>,
    direction: Option<Vec<f64>>,
    pub(super) step: f64,
}

impl Checked {
    /// Makes a parameter from its name, its values and the step h of the central difference (f(x + h) − f(x − h))/2h,
    /// which is compared with the mean of f′ over the same interval. So h needs not be small: a wide step has less noise.
    /// The scene must be valid within ± h.
    pub fn new(name: impl Into<String>, values: impl Into<Vec<f64>>, step: f64) -> Self {
        Self {
            name: name.into(),
            values: values.into(),
            direction: None,
            step,
        }
    }

    /// Checks one directional derivative instead of each component's derivative. This suits parameters with many
    /// components, such as vertices. `direction` has one finite number per value.
    pub fn with_direction(mut self, direction: impl Into<Vec<f64>>) -> Self {
        self.direction = Some(direction.into());
        self
    }

    /// The directions to check, with their names.
    pub(super) fn directions(&self) -> Vec<(String, Vec<f64>)> {
        let n = self.values.len();
        if let Some(d) = &self.direction {
            return vec![(self.name.clone(), d.clone())];
        }
        let axis = |i: usize| {
            let name = match n {
                1 => self.name.clone(),
                _ => format!("{}[{i}]", self.name),
            };
            let mut axis = vec![0.0; n];
            axis[i] = 1.0;
            (name, axis)
        };
        (0..n).map(axis).collect()
    }

    pub(super) fn check(&self) -> Result<()> {
        let finite = |values: &[f64]| values.iter().all(|v| v.is_finite());
        let (name, n) = (&self.name, self.values.len());
        let valid = n > 0 && finite(&self.values);
        let found = format!("{:?}", self.values);
        Error::unless(valid, name, "values", found, "finite numbers")?;
        Error::unless_positive(name, "step", self.step)?;
        let direction = self.direction.as_deref().unwrap_or(&self.values);
        let valid = direction.len() == n && finite(direction);
        let found = format!("{direction:?}");
        let expected = "a finite number for each value";
        Error::unless(valid, name, "direction", found, expected)
    }
}

/// The parameters as tensors, for the closure that builds a scene.
///
/// [`gradcheck`](super::gradcheck) has an example.
#[derive(Clone, Debug)]
pub struct Point {
    /// The device for the scene.
    pub device: Device,
    /// The float type for all tensors of the scene; see [`Mesh::cast`](crate::scene::Mesh::cast).
    pub dtype: DType,
    pub(super) tensors: Vec<(String, Tensor<1>)>,
}

impl Point {
    /// Returns a parameter `[C]`. It is tracked in renders for autodiff if it is to be checked.
    ///
    /// # Errors
    /// If there is no parameter with that name.
    pub fn get(&self, name: &str) -> Result<Tensor<1>> {
        let found = self.tensors.iter().find(|(n, _)| n == name);
        found.map(|(_, t)| t.clone()).ok_or_else(|| {
            let names = one_of(self.tensors.iter().map(|(n, _)| n.as_str()));
            Error::invalid("gradcheck", "parameter", format!("{name:?}"), names)
        })
    }
}
