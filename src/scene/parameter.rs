use burn::tensor::Tensor;

use crate::error::{Error, Result};
use crate::geometry::{Context, host_values};

// A tensor is a handle of some words; boxing it would cost more than it saves.
#[allow(clippy::large_enum_variant)]
/// A small vector that a user gives as numbers or as a tensor `[C]`: a constant, a leaf with
/// `require_grad`, a module's parameter or the output of a network.
#[derive(Clone)]
pub enum Parameter<const C: usize> {
    /// Numbers, put on the scene's device in the scene's float type.
    Constant([f64; C]),
    /// A tensor `[C]`.
    Tensor(Tensor<1>),
}

impl<const C: usize> Parameter<C> {
    /// Whether gradients flow to it.
    pub fn is_tracked(&self) -> bool {
        matches!(self, Self::Tensor(t) if t.is_tracked())
    }

    /// The values on the host.
    pub fn values(&self) -> Result<[f64; C]> {
        match self {
            Self::Constant(v) => Ok(*v),
            Self::Tensor(t) => {
                let v = host_values(t)?;
                v.as_slice().try_into().map_err(|_| {
                    Error::invalid(
                        "parameter",
                        "shape",
                        format!("[{}]", v.len()),
                        format!("[{C}]"),
                    )
                })
            }
        }
    }

    /// Returns one plane `[1, 1]` for each component, on the device of the context.
    pub(crate) fn planes(&self, context: &Context) -> [Tensor<2>; C] {
        std::array::from_fn(|i| match self {
            Self::Constant(v) => context.row(&v[i..=i]),
            Self::Tensor(t) => {
                let t = if t.is_tracked() {
                    t.clone()
                } else {
                    t.clone().inner()
                };
                t.slice([i..i + 1]).reshape([1, 1])
            }
        })
    }

    /// Checks shape, finiteness and range of the values.
    pub(crate) fn check(
        &self,
        object: &str,
        field: &str,
        expected: &str,
        valid: impl Fn(f64) -> bool,
    ) -> Result<[f64; C]> {
        if let Self::Tensor(t) = self
            && t.dims() != [C]
        {
            return Err(Error::invalid(
                object,
                field,
                format!("of shape {:?}", t.dims()),
                format!("shape [{C}]"),
            ));
        }
        let values = self.values()?;
        // Kernels are in f32.
        if values.iter().all(|&v| (v as f32).is_finite() && valid(v)) {
            Ok(values)
        } else {
            let shown = if C == 1 {
                values[0].to_string()
            } else {
                format!("{values:?}")
            };
            Err(Error::invalid(object, field, shown, expected))
        }
    }

    pub(crate) fn tensor(&self) -> Option<&Tensor<1>> {
        match self {
            Self::Constant(_) => None,
            Self::Tensor(t) => Some(t),
        }
    }
}

impl<const C: usize> From<[f64; C]> for Parameter<C> {
    fn from(v: [f64; C]) -> Self {
        Self::Constant(v)
    }
}

impl<const C: usize> From<[f32; C]> for Parameter<C> {
    fn from(v: [f32; C]) -> Self {
        Self::Constant(v.map(f64::from))
    }
}

impl<const C: usize> From<Tensor<1>> for Parameter<C> {
    fn from(t: Tensor<1>) -> Self {
        Self::Tensor(t)
    }
}

impl From<f64> for Parameter<1> {
    fn from(v: f64) -> Self {
        Self::Constant([v])
    }
}

impl From<f32> for Parameter<1> {
    fn from(v: f32) -> Self {
        Self::Constant([f64::from(v)])
    }
}

impl From<glam::DVec3> for Parameter<3> {
    fn from(v: glam::DVec3) -> Self {
        Self::Constant(v.to_array())
    }
}

impl From<glam::Vec3> for Parameter<3> {
    fn from(v: glam::Vec3) -> Self {
        v.to_array().into()
    }
}
