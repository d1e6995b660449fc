//! Copies scenes and cameras to the host in one transfer: each wait for a GPU costs more than the bytes. An untracked
//! tensor is read once, as long as it stays the same tensor.

use std::collections::{HashMap, VecDeque};

use burn::tensor::{Device, Tensor, TensorData};

use super::parameters::{Visit, visit_camera, visit_scene};
use super::{Camera, Scene};
use crate::device::is_cpu;
use crate::error::Result;
use crate::geometry::{Context, detached};
use softray_kernels::host::ParameterId;

/// Distinguishes the tensors of a device while they are alive: memory, offset in it, and length.
pub(crate) type Identity = [u64; 3];

/// Constants that were read: each with its tensors on the device and on the host. The tensor on the device is kept so
/// that its memory is not reused.
#[derive(Default)]
pub(crate) struct Constants(HashMap<Identity, [Tensor<1>; 2]>);

/// All tensors of some scenes and cameras, and further tensors.
pub(crate) struct Transfer<'a> {
    pub scenes: &'a mut [Scene],
    pub cameras: &'a mut [Camera],
    pub more: &'a mut [Tensor<3>],
}

impl Transfer<'_> {
    fn visit(&mut self, visit: &mut impl Visit) {
        self.scenes.iter_mut().for_each(|s| visit_scene(s, visit));
        self.cameras.iter_mut().for_each(|c| visit_camera(c, visit));
        let vertices = ParameterId::Vertices(0);
        self.more.iter_mut().for_each(|t| visit.visit(vertices, t));
    }

    /// Replaces the tensors by copies on the host, outside of their graph. Copies of tracked tensors are leaf tensors
    /// of other graphs, so that `is_tracked` stays true for checks. The tensors must be on the context's device or on
    /// the host. Constants that have an identity and were read before are not read again. Nothing happens if the
    /// context's device is a CPU or no backend for the host is built in. `read` returns the values of a tensor.
    ///
    /// # Errors
    /// If the tensors can't be read back.
    pub async fn fetch(
        mut self,
        context: &Context,
        constants: &mut Constants,
        identity: fn(&Tensor<1>) -> Option<Identity>,
        read: impl AsyncFnOnce(Tensor<1>) -> Result<Vec<f64>>,
    ) -> Result<()> {
        let Some(device) = host_device().filter(|_| !is_cpu(&context.device)) else {
            return Ok(());
        };
        let mut gather = Gather {
            identity,
            rows: Vec::new(),
            known: HashMap::new(),
            of_tensors: Vec::new(),
        };
        self.visit(&mut gather);
        let of_row = |row: &Row| Some(constants.0.get(&row.identity?)?[1].clone());
        let mut on_host: Vec<Option<Tensor<1>>> = gather.rows.iter().map(of_row).collect();
        let new = gather
            .rows
            .iter()
            .zip(&on_host)
            .filter(|row| row.1.is_none());
        let new: Vec<Tensor<1>> = new.map(|(row, _)| row.tensor.clone()).collect();
        if !new.is_empty() {
            let lengths: Vec<usize> = new.iter().map(|t| t.dims()[0]).collect();
            let mut values = &read(Tensor::cat(new, 0)).await?[..];
            let rows = on_host.iter_mut().filter(|row| row.is_none());
            for (row, length) in rows.zip(lengths) {
                let data = TensorData::new(values[..length].to_vec(), [length]);
                *row = Some(Tensor::from_data(data, (&device, context.dtype)));
                values = &values[length..];
            }
        }
        let on_host: Vec<Tensor<1>> = on_host.into_iter().flatten().collect();
        constants.0.clear();
        for (row, values) in gather.rows.into_iter().zip(&on_host) {
            if let Some(identity) = row.identity {
                constants.0.insert(identity, [row.tensor, values.clone()]);
            }
        }
        let rows = gather.of_tensors.iter().map(|&row| on_host[row].clone());
        self.visit(&mut Scatter(rows.collect()));
        Ok(())
    }
}

/// Returns the device of a backend that computes on the host, if one is built in.
#[allow(unreachable_code)] // Only one of the returns is reached.
pub(crate) fn host_device() -> Option<Device> {
    #[cfg(feature = "flex")]
    return Some(Device::flex());
    #[cfg(feature = "ndarray")]
    #[allow(deprecated)] // burn deprecates ndarray; softray still supports it
    return Some(Device::ndarray());
    None
}

/// A flat tensor outside of its graph, and its identity if it was untracked.
struct Row {
    tensor: Tensor<1>,
    identity: Option<Identity>,
}

/// Collects all tensors. Tensors of the same identity are collected once.
struct Gather {
    identity: fn(&Tensor<1>) -> Option<Identity>,
    rows: Vec<Row>,
    known: HashMap<Identity, usize>,
    /// The row of each tensor.
    of_tensors: Vec<usize>,
}

impl Visit for Gather {
    fn visit<const D: usize>(&mut self, _: ParameterId, tensor: &mut Tensor<D>) {
        if is_cpu(&tensor.device()) {
            return;
        }
        let count: usize = tensor.dims().iter().product();
        let flat = detached(tensor).reshape([count]);
        let identity = (!tensor.is_tracked()).then(|| (self.identity)(&flat));
        let identity = identity.flatten();
        let mut row = self.rows.len();
        if let Some(identity) = identity {
            row = *self.known.entry(identity).or_insert(row);
        }
        self.of_tensors.push(row);
        if row == self.rows.len() {
            self.rows.push(Row {
                tensor: flat,
                identity,
            });
        }
    }
}

/// Replaces all tensors by these rows, in order.
struct Scatter(VecDeque<Tensor<1>>);

impl Visit for Scatter {
    fn visit<const D: usize>(&mut self, _: ParameterId, tensor: &mut Tensor<D>) {
        if is_cpu(&tensor.device()) {
            return;
        }
        let row = self.0.pop_front().expect("a row for each tensor");
        let on_host = row.reshape(tensor.dims());
        *tensor = if tensor.is_tracked() {
            on_host.autodiff().require_grad()
        } else {
            on_host
        };
    }
}
