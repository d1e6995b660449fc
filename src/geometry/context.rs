use burn::tensor::{DType, Device, Int, Tensor, TensorData};

use crate::error::{Error, Result};

/// Where and in which float type a render runs: those of the scene's tensors.
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
pub(crate) fn plain<const D: usize>(tensor: &Tensor<D>) -> Tensor<D> {
    tensor.clone().inner()
}

/// Three planes on the host, as vectors.
pub(crate) fn host_vectors(v: &super::Vec3) -> Result<Vec<glam::DVec3>> {
    let (x, y, z) = (host_values(&v.x)?, host_values(&v.y)?, host_values(&v.z)?);
    let vector = |i: usize| glam::DVec3::new(x[i], y[i], z[i]);
    Ok((0..x.len()).map(vector).collect())
}

/// The first value that is not finite in f32, in row-major order, and where it is; without a list of all.
pub(crate) fn first_not_finite<const D: usize>(tensor: &Tensor<D>) -> Result<Option<(usize, f64)>> {
    let data = plain(tensor)
        .try_into_data()
        .map_err(|e| Error::Read(format!("{e:?}")))?;
    let mut values = data.iter::<f64>().enumerate();
    Ok(values.find(|(_, v)| !(*v as f32).is_finite()))
}

/// A float tensor's values on the host.
pub(crate) fn host_values<const D: usize>(tensor: &Tensor<D>) -> Result<Vec<f64>> {
    let data = plain(tensor)
        .try_into_data()
        .map_err(|e| Error::Read(format!("{e:?}")))?;
    Ok(data.iter::<f64>().collect())
}
