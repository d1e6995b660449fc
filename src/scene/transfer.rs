//! Scenes and cameras copied to the host in one transfer: each that waits for a GPU costs more than its bytes.

use std::ops::Range;

use burn::tensor::{Device, Tensor, TensorData};

use super::parameters::{ParameterId, Visit, visit_camera, visit_scene};
use super::{Camera, Scene};
use crate::device::is_cpu;
use crate::error::Result;
use crate::geometry::{Context, detached, host_values};

/// Puts tensors of scenes and cameras on the host, out of their graph; those that were in it are leaves of others, so
/// that checks know them. They must be of the context's device.
///
/// # Errors
/// If they can't be read back.
pub(crate) fn to_host(
    scenes: &mut [Scene],
    cameras: &mut [Camera],
    context: &Context,
) -> Result<()> {
    let Some(host) = host_device().filter(|_| !is_cpu(&context.device)) else {
        return Ok(());
    };
    let mut gather = Gather::default();
    scenes.iter_mut().for_each(|s| visit_scene(s, &mut gather));
    cameras
        .iter_mut()
        .for_each(|c| visit_camera(c, &mut gather));
    let mut scatter = Scatter {
        values: host_values(&Tensor::cat(gather.0, 0))?,
        next: 0,
        context: Context {
            device: host,
            dtype: context.dtype,
        },
    };
    scenes.iter_mut().for_each(|s| visit_scene(s, &mut scatter));
    cameras
        .iter_mut()
        .for_each(|c| visit_camera(c, &mut scatter));
    Ok(())
}

/// The device of a backend that computes on the host, if one is built in.
#[allow(unreachable_code)] // One of several ways serves.
fn host_device() -> Option<Device> {
    #[cfg(feature = "flex")]
    return Some(Device::flex());
    #[cfg(feature = "ndarray")]
    #[allow(deprecated)] // burn deprecates ndarray; it is offered all the same
    return Some(Device::ndarray());
    None
}

/// All tensors, flat.
#[derive(Default)]
struct Gather(Vec<Tensor<1>>);

impl Visit for Gather {
    fn visit<const D: usize>(&mut self, _: ParameterId, tensor: &mut Tensor<D>) {
        let count: usize = tensor.dims().iter().product();
        self.0.push(detached(tensor).reshape([count]));
    }
}

/// Replaces all tensors by parts of a list.
struct Scatter {
    values: Vec<f64>,
    next: usize,
    context: Context,
}

impl Visit for Scatter {
    fn visit<const D: usize>(&mut self, _: ParameterId, tensor: &mut Tensor<D>) {
        let shape: [usize; D] = tensor.dims();
        let count = shape.iter().product::<usize>();
        let range: Range<usize> = self.next..self.next + count;
        self.next = range.end;
        let data = TensorData::new(self.values[range].to_vec(), shape);
        let on_host = Tensor::from_data(data, (&self.context.device, self.context.dtype));
        *tensor = if tensor.is_tracked() {
            on_host.autodiff().require_grad()
        } else {
            on_host
        };
    }
}
