//! Square matrices that a user gives as numbers or as tensors.

use burn::tensor::Tensor;
use glam::{DMat3, DMat4};

use super::Parameter;
use crate::error::{Error, Result};
use crate::geometry::host_values;

// A tensor is a handle of some words; boxing it would cost more than it saves.
#[allow(clippy::large_enum_variant)]
/// A square matrix that a user gives as numbers, row by row, or as a tensor `[N, N]`.
#[derive(Clone, Debug)]
pub enum Matrix<const N: usize> {
    /// Rows of numbers.
    Constant([[f64; N]; N]),
    /// A tensor `[N, N]`.
    Tensor(Tensor<2>),
}

impl<const N: usize> From<[[f64; N]; N]> for Matrix<N> {
    fn from(rows: [[f64; N]; N]) -> Self {
        Self::Constant(rows)
    }
}

impl<const N: usize> From<[[f32; N]; N]> for Matrix<N> {
    fn from(rows: [[f32; N]; N]) -> Self {
        Self::Constant(rows.map(|row| row.map(f64::from)))
    }
}

impl<const N: usize> From<Tensor<2>> for Matrix<N> {
    fn from(matrix: Tensor<2>) -> Self {
        Self::Tensor(matrix)
    }
}

impl From<DMat4> for Matrix<4> {
    fn from(matrix: DMat4) -> Self {
        Self::Constant(matrix.transpose().to_cols_array_2d())
    }
}

impl From<DMat3> for Matrix<3> {
    fn from(matrix: DMat3) -> Self {
        Self::Constant(matrix.transpose().to_cols_array_2d())
    }
}

impl<const N: usize> Matrix<N> {
    /// The rows on the host.
    pub(super) fn rows(&self, field: &str) -> Result<[[f64; N]; N]> {
        let rows = match self {
            Self::Constant(rows) => *rows,
            Self::Tensor(matrix) => {
                if matrix.dims() != [N, N] {
                    let found = format!("of shape {:?}", matrix.dims());
                    let expected = format!("shape [{N}, {N}]");
                    return Err(Error::invalid("camera", field, found, expected));
                }
                let values = host_values(matrix)?;
                std::array::from_fn(|i| std::array::from_fn(|j| values[N * i + j]))
            }
        };
        if rows.iter().flatten().any(|v| !v.is_finite()) {
            let expected = "finite numbers";
            let shown = format!("{rows:?}");
            return Err(Error::invalid("camera", field, shown, expected));
        }
        Ok(rows)
    }

    /// The numbers at these rows and columns times a factor, in the graph of the matrix.
    pub(super) fn pick<const C: usize>(
        &self,
        rows: &[[f64; N]; N],
        places: [[usize; 2]; C],
        factor: f64,
    ) -> Parameter<C> {
        match self {
            Self::Constant(_) => Parameter::Constant(places.map(|[i, j]| factor * rows[i][j])),
            Self::Tensor(m) => {
                let at = |[i, j]: [usize; 2]| m.clone().slice([i..i + 1, j..j + 1]).reshape([1]);
                let picked = places.map(at).into_iter().collect();
                Parameter::Tensor(Tensor::cat(picked, 0) * factor)
            }
        }
    }
}
