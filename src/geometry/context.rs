//! The device and float type of a render, and copies of values to and from the host.

use std::pin::pin;
use std::task;

#[cfg(feature = "flex")]
use burn::backend::{BackendTensor, DispatchTensorKind};
use burn::tensor::{DType, Device, ExecutionError, Int, Tensor, TensorData};

use crate::device::count_read_back;
use crate::error::{Error, Result};

/// The device and the float type of a render, taken from the scene's tensors.
#[derive(Clone, Debug)]
pub struct Context {
    /// The device, without autodiff, so that constants record no tape.
    pub device: Device,
    /// The float type, `f32` or `f64`.
    pub dtype: DType,
}

impl Context {
    /// Creates a constant of any shape from host values, in row-major order.
    pub fn tensor<const D: usize>(&self, values: &[f64], shape: [usize; D]) -> Tensor<D> {
        let data = if self.dtype == DType::F64 {
            TensorData::new(values.to_vec(), shape)
        } else {
            TensorData::new(values.iter().map(|&v| v as f32).collect::<Vec<_>>(), shape)
        };
        Tensor::from_data(data, (&self.device, self.dtype))
    }

    /// Creates a constant row `[1, N]`, one value per ray.
    pub fn row(&self, values: &[f64]) -> Tensor<2> {
        self.tensor(values, [1, values.len()])
    }

    /// Creates a constant column `[T, 1]`, one value per triangle.
    pub fn column(&self, values: &[f64]) -> Tensor<2> {
        self.tensor(values, [values.len(), 1])
    }

    /// Creates a constant row `[1, N]` of indices.
    pub fn index_row(&self, values: &[u32]) -> Tensor<2, Int> {
        let data: Vec<i32> = values.iter().map(|&v| v as i32).collect();
        Tensor::from_data(TensorData::new(data, [1, values.len()]), &self.device)
    }

    /// Returns the relative rounding error of the float type.
    pub fn epsilon(&self) -> f64 {
        if self.dtype == DType::F64 {
            f64::EPSILON
        } else {
            f64::from(f32::EPSILON)
        }
    }
}

/// Returns the tensor's values without tape or autodiff.
pub(crate) fn detached<const D: usize>(tensor: &Tensor<D>) -> Tensor<D> {
    tensor.clone().inner()
}

/// Calls a function with the values of an image `[H, W, C]`, some rows at a time. Reading the image back in one piece
/// would take its memory twice more.
pub(crate) fn by_rows<const D: usize>(tensor: &Tensor<D>, mut f: impl FnMut(&[f32])) -> Result<()> {
    const NUMBERS: usize = 1 << 20;
    let dims = tensor.dims();
    let height = dims[0];
    let rows = (NUMBERS / dims[1..].iter().product::<usize>().max(1)).max(1);
    let tensor = detached(tensor);
    for from in (0..height).step_by(rows) {
        let some = tensor.clone().slice([from..(from + rows).min(height)]);
        count_read_back(&some.device(), some.shape().num_elements());
        let data = some.try_into_data_as::<f32>().map_err(Error::read)?;
        f(data.as_slice::<f32>().map_err(Error::read)?);
    }
    Ok(())
}

/// Returns the first value of an image for which `holds` is false, in row-major order, with its index.
pub(crate) fn first_outside<const D: usize>(
    tensor: &Tensor<D>,
    holds: impl Fn(f64) -> bool,
) -> Result<Option<(usize, f64)>> {
    let (mut found, mut passed) = (None, 0);
    by_rows(tensor, |values| {
        if found.is_none() {
            let at = values.iter().position(|&v| !holds(v.into()));
            found = at.map(|i| (passed + i, f64::from(values[i])));
        }
        passed += values.len();
    })?;
    Ok(found)
}

/// Returns the address and the shape of a tensor's values on the host. Tensors of the same address and shape that are
/// alive at the same time are the same. Returns None if the address is unknown or the tensor is tracked.
pub(crate) fn place_of<const D: usize>(tensor: &Tensor<D>) -> Option<(usize, [usize; D])> {
    #[cfg(feature = "flex")]
    if !tensor.is_tracked()
        && let DispatchTensorKind::Flex(BackendTensor::Float(own)) =
            detached(tensor).into_dispatch().kind
        && own.is_contiguous()
    {
        let first =
            own.bytes().as_ptr() as usize + own.layout().start_offset() * own.dtype().size();
        return Some((first, tensor.dims()));
    }
    let _ = tensor;
    None
}

/// Returns whether any value of an image is above 0 or can't be read.
pub(crate) fn any_positive<const D: usize>(image: &Tensor<D>) -> bool {
    // Computed on the device of the image: only one number is read back.
    let most = host_values(&detached(image).max());
    most.map_or(true, |most| most.iter().any(|&v| v > 0.0))
}

/// Reads the values of a float tensor back to the host.
pub(crate) fn host_values<const D: usize>(tensor: &Tensor<D>) -> Result<Vec<f64>> {
    count_read_back(&tensor.device(), tensor.shape().num_elements());
    numbers(detached(tensor).try_into_data())
}

/// Reads values like [`host_values`], without waiting for the device.
pub(crate) async fn host_values_async(tensor: Tensor<1>) -> Result<Vec<f64>> {
    count_read_back(&tensor.device(), tensor.shape().num_elements());
    numbers(detached(&tensor).into_data_async().await)
}

fn numbers(data: std::result::Result<TensorData, ExecutionError>) -> Result<Vec<f64>> {
    let data = data.map_err(Error::read)?;
    Ok(match data.as_slice::<f32>() {
        Ok(values) => values.iter().map(|&v| v.into()).collect(),
        Err(_) => data.iter::<f64>().collect(),
    })
}

/// Returns the output of a future that waits for nothing.
pub(crate) fn now<T>(future: impl Future<Output = T>) -> T {
    let waker = &mut task::Context::from_waker(task::Waker::noop());
    match pin!(future).poll(waker) {
        task::Poll::Ready(output) => output,
        task::Poll::Pending => unreachable!("it waits for nothing"),
    }
}

/// Computes sine and cosine to rounding on every device. Vulkan allows its instructions an absolute error of 2⁻¹¹,
/// which shows as a camera with another field of view.
pub(crate) fn sin_cos<const D: usize>(angle: Tensor<D>) -> (Tensor<D>, Tensor<D>) {
    use std::f64::consts::TAU;
    /// The Taylor series is used for angles up to π/2^HALVINGS.
    const HALVINGS: i32 = 3;
    // 2π in two parts. The first has few bits, so that whole turns are subtracted exactly.
    const HIGH: f64 = 6.28125;
    let turns = (super::context::detached(&angle) / TAU).round();
    let small = angle - turns.clone() * HIGH - turns * (TAU - HIGH);
    let x = small * 0.5f64.powi(HALVINGS);
    let square = x.clone() * x.clone();
    // sin x = x·(1 − x²/(2·3)·(1 − x²/(4·5)·(…))); 1 − cos x = x²/2·(1 − x²/(3·4)·(…)).
    let series = |first: usize| {
        let mut sum = square.ones_like();
        for n in (first..first + 16).step_by(2).rev() {
            sum = (sum * square.clone() * ((n * (n + 1)) as f64).recip()).neg() + 1.0;
        }
        sum
    };
    let mut sin = x * series(2);
    let mut versine = square.clone() * series(3) * 0.5;
    for _ in 0..HALVINGS {
        let cos = versine.clone().neg() + 1.0;
        versine = sin.clone() * sin.clone() * 2.0;
        sin = sin * cos * 2.0;
    }
    (sin, versine.neg() + 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::{DType, Device, TensorData};

    #[test]
    fn values_and_derivatives_to_rounding() {
        for (dtype, tolerance) in [(DType::F64, 1e-14), (DType::F32, 5e-7)] {
            let device = Device::flex();
            for angle in [-40.0, -3.15, -1.3, -1e-9, 0.0, 1e-3, 0.6, 1.58, 3.0, 25.0] {
                let leaf = || {
                    Tensor::<1>::from_data(TensorData::new(vec![angle], [1]), (&device, dtype))
                        .autodiff()
                        .require_grad()
                };
                let slope = |second: bool| {
                    let x = leaf();
                    let (sin, cos) = sin_cos(x.clone());
                    let gradients = if second { cos } else { sin }.backward();
                    let slope = x.grad(&gradients).map(|g| g.into_scalar::<f64>());
                    slope.unwrap_or(f64::NAN)
                };
                let x = leaf();
                let (sin, cos) = sin_cos(x.clone());
                let value = |y: &Tensor<1>| y.clone().inner().into_scalar::<f64>();
                let rounded = x.clone().inner().into_scalar::<f64>();
                // Rounding of the angle itself, relative to its size.
                let tolerance = tolerance * rounded.abs().max(1.0);
                assert!(
                    (value(&sin) - rounded.sin()).abs() < tolerance,
                    "sin {angle}"
                );
                assert!(
                    (value(&cos) - rounded.cos()).abs() < tolerance,
                    "cos {angle}"
                );
                assert!(
                    (slope(false) - rounded.cos()).abs() < tolerance,
                    "sin' {angle}"
                );
                assert!(
                    (slope(true) + rounded.sin()).abs() < tolerance,
                    "cos' {angle}"
                );
            }
        }
    }
}
