//! The device and float type of a render, and values to and from the host.

use burn::tensor::{DType, Device, Int, Tensor, TensorData};

use crate::error::{Error, Result};

/// The device and the float type of a render: those of the scene's tensors.
#[derive(Clone, Debug)]
pub struct Context {
    /// The device, without autodiff: constants record no tape.
    pub device: Device,
    /// The float type, `f32` or `f64`.
    pub dtype: DType,
}

impl Context {
    /// A constant of any shape from host values, in row-major order.
    pub fn tensor<const D: usize>(&self, values: &[f64], shape: [usize; D]) -> Tensor<D> {
        let data = if self.dtype == DType::F64 {
            TensorData::new(values.to_vec(), shape)
        } else {
            TensorData::new(values.iter().map(|&v| v as f32).collect::<Vec<_>>(), shape)
        };
        Tensor::from_data(data, (&self.device, self.dtype))
    }

    /// A constant row `[1, N]`: one value a ray.
    pub fn row(&self, values: &[f64]) -> Tensor<2> {
        self.tensor(values, [1, values.len()])
    }

    /// A constant column `[T, 1]`: one value a triangle.
    pub fn column(&self, values: &[f64]) -> Tensor<2> {
        self.tensor(values, [values.len(), 1])
    }

    /// A constant row `[1, N]` of indices.
    pub fn index_row(&self, values: &[u32]) -> Tensor<2, Int> {
        let data: Vec<i32> = values.iter().map(|&v| v as i32).collect();
        Tensor::from_data(TensorData::new(data, [1, values.len()]), &self.device)
    }

    /// The relative rounding error of the float type.
    pub fn epsilon(&self) -> f64 {
        if self.dtype == DType::F64 {
            f64::EPSILON
        } else {
            f64::from(f32::EPSILON)
        }
    }
}

/// The tensor's values without tape or autodiff.
pub(crate) fn detached<const D: usize>(tensor: &Tensor<D>) -> Tensor<D> {
    tensor.clone().inner()
}

/// Calls a function with the values of an image `[H, W, C]`, some rows at a time: reading it back in one
/// piece takes its memory twice more.
pub(crate) fn by_rows(tensor: &Tensor<3>, mut f: impl FnMut(&[f32])) -> Result<()> {
    const NUMBERS: usize = 1 << 20;
    let [height, width, channels] = tensor.dims();
    let rows = (NUMBERS / (width * channels).max(1)).max(1);
    let tensor = detached(tensor);
    for from in (0..height).step_by(rows) {
        let some = tensor.clone().slice([from..(from + rows).min(height)]);
        let data = some.try_into_data_as::<f32>().map_err(Error::read)?;
        f(data.as_slice::<f32>().map_err(Error::read)?);
    }
    Ok(())
}

/// The first value of an image that is not finite in f32, in row-major order, and where it is.
pub(crate) fn first_not_finite(tensor: &Tensor<3>) -> Result<Option<(usize, f64)>> {
    let (mut found, mut passed) = (None, 0);
    by_rows(tensor, |values| {
        if found.is_none() {
            let at = values.iter().position(|v| !v.is_finite());
            found = at.map(|i| (passed + i, f64::from(values[i])));
        }
        passed += values.len();
    })?;
    Ok(found)
}

/// Reads the values of a float tensor back to the host.
pub(crate) fn host_values<const D: usize>(tensor: &Tensor<D>) -> Result<Vec<f64>> {
    let data = detached(tensor).try_into_data();
    let data = data.map_err(Error::read)?;
    Ok(data.iter::<f64>().collect())
}
