use burn::tensor::Tensor;

use crate::error::{Error, Result};
use crate::geometry::{Context, Vec3, host_values};

/// A small vector: numbers or a tensor `[C]`.
/// The tensor may be a constant, a leaf tensor with `require_grad`, a module's parameter or the output of a network.
///
/// [`Mesh::translated`](super::Mesh::translated) has an example.
#[derive(Clone)]
#[cfg_attr(feature = "remote", derive(serde::Serialize, serde::Deserialize))]
pub enum Parameter<const C: usize> {
    /// Numbers. They are put on the scene's device in the scene's float type.
    Constant(#[cfg_attr(feature = "remote", serde(with = "super::slots::numbers"))] [f64; C]),
    /// A tensor `[C]`.
    Tensor(#[cfg_attr(feature = "remote", serde(with = "super::slots::tensor"))] Tensor<1>),
}

impl<const C: usize> Parameter<C> {
    /// Returns whether gradients flow to it: whether it is a tracked tensor.
    pub fn is_tracked(&self) -> bool {
        matches!(self, Self::Tensor(t) if t.is_tracked())
    }

    /// Returns the values on the host.
    ///
    /// # Errors
    /// If the tensor can't be read or has another number of values.
    pub fn values(&self) -> Result<[f64; C]> {
        match self {
            Self::Constant(v) => Ok(*v),
            Self::Tensor(t) => {
                let v = host_values(t)?;
                v.as_slice().try_into().map_err(|_| {
                    let [found, expected] = [v.len(), C].map(|n| format!("[{n}]"));
                    Error::invalid("parameter", "shape", found, expected)
                })
            }
        }
    }

    /// Returns one plane `[1, 1]` for each component, on the device of the context.
    pub(crate) fn planes(&self, context: &Context) -> [Tensor<2>; C] {
        std::array::from_fn(|i| match self {
            Self::Constant(v) => context.row(&v[i..=i]),
            Self::Tensor(t) => without_tape(t).slice([i..i + 1]).reshape([1, 1]),
        })
    }

    /// Checks the shape and the range of the values, and returns the values.
    pub(crate) fn check(&self, object: &str, field: &str, range: Range) -> Result<[f64; C]> {
        if let Self::Tensor(t) = self
            && t.dims() != [C]
        {
            let found = format!("of shape {:?}", t.dims());
            return Err(Error::invalid(object, field, found, format!("shape [{C}]")));
        }
        let values = self.values()?;
        range.check(object, field, &values)?;
        Ok(values)
    }

    /// Whether any value is above 0 or can't be read.
    pub(crate) fn shines(&self) -> bool {
        self.values().map_or(true, |v| v.iter().any(|&v| v > 0.0))
    }

    pub(crate) fn tensor(&self) -> Option<&Tensor<1>> {
        match self {
            Self::Constant(_) => None,
            Self::Tensor(t) => Some(t),
        }
    }
}

impl Parameter<3> {
    /// Returns the planes as a vector.
    pub(crate) fn vector(&self, context: &Context) -> Vec3 {
        let [x, y, z] = self.planes(context);
        Vec3::new(x, y, z)
    }
}

/// Returns the tensor, without autodiff if it is untracked, so that no tape is recorded for it.
pub(super) fn without_tape<const D: usize>(t: &Tensor<D>) -> Tensor<D> {
    if t.is_tracked() {
        t.clone()
    } else {
        t.clone().inner()
    }
}

/// A value's name in error messages and its range.
pub(crate) trait Described: Sized {
    fn described(self) -> (&'static str, Range);

    fn name(self) -> &'static str {
        self.described().0
    }

    fn range(self) -> Range {
        self.described().1
    }
}

/// The largest radiance, intensity or irradiance. Sums over an image's samples, their squares, and products with
/// factors near a light then stay in the range of f32.
pub(crate) const MAX_LIGHT: f64 = 1e15;

/// A range of values. All values must be finite in f32, the float type of kernels.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Range {
    Finite,
    Positive,
    NotNegative,
    /// From 0 to 1, inclusive.
    Share,
    /// From the first number to the second, inclusive.
    Within(f64, f64),
    /// Light of either sign, of an absolute value of at most [`MAX_LIGHT`].
    Light,
    /// Between both numbers, exclusive.
    Degrees(i32, i32),
}

impl Range {
    /// # Errors
    /// If a value is out of the range. The error shows all values if there are 2 to 16, otherwise the first invalid
    /// value.
    pub fn check(self, object: &str, field: &str, values: &[f64]) -> Result<()> {
        let Some(wrong) = values.iter().find(|&&v| !self.holds(v)) else {
            return Ok(());
        };
        let shown = match values.len() {
            2..=16 => format!("{values:?}"),
            _ => wrong.to_string(),
        };
        let expected = self.expected(values.len());
        Err(Error::invalid(object, field, shown, expected))
    }

    /// Whether a value is in the range.
    pub fn holds(self, v: f64) -> bool {
        (v as f32).is_finite()
            && match self {
                Self::Finite => true,
                Self::Positive => v > 0.0,
                Self::NotNegative => v >= 0.0,
                Self::Share => (0.0..=1.0).contains(&v),
                Self::Within(low, high) => (low..=high).contains(&v),
                Self::Light => v.abs() <= MAX_LIGHT,
                Self::Degrees(low, high) => v > low.into() && v < high.into(),
            }
    }

    /// The description of the range in error messages, for one number or for several.
    pub fn expected(self, count: usize) -> String {
        let (finite, numbers) = match count {
            1 => ("a finite number", "a number"),
            _ => ("finite numbers", "numbers"),
        };
        match self {
            Self::Finite => finite.into(),
            Self::Positive => format!("{numbers} > 0"),
            Self::NotNegative => format!("{numbers} ≥ 0"),
            Self::Share => format!("{numbers} in [0, 1]"),
            Self::Within(low, high) => format!("{numbers} in [{low}, {high}]"),
            Self::Light => {
                format!("{finite} of at most {MAX_LIGHT:e}, so that sums of light do not overflow")
            }
            Self::Degrees(low, high) => format!("degrees in ({low}, {high})"),
        }
    }
}

/// Implements conversions into a type, one per line: `[generics] source => type: |value| converted`.
macro_rules! conversions {
    ($([$($generics:tt)*] $source:ty => $target:ty: |$value:ident| $converted:expr;)*) => {$(
        impl<$($generics)*> From<$source> for $target {
            fn from($value: $source) -> Self {
                $converted
            }
        }
    )*};
}
pub(super) use conversions;

conversions! {
    [const C: usize] [f64; C] => Parameter<C>: |v| Self::Constant(v);
    [const C: usize] [f32; C] => Parameter<C>: |v| Self::Constant(v.map(f64::from));
    [const C: usize] Tensor<1> => Parameter<C>: |t| Self::Tensor(t);
    [] f64 => Parameter<1>: |v| Self::Constant([v]);
    [] f32 => Parameter<1>: |v| Self::Constant([v.into()]);
    [] glam::DVec3 => Parameter<3>: |v| Self::Constant(v.to_array());
    [] glam::Vec3 => Parameter<3>: |v| v.to_array().into();
}
