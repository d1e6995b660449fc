//! Lists on a device.

use burn::backend::wgpu::CubeTensor;
use burn::cubecl::prelude::*;
use burn::cubecl::server::Handle;
use burn::tensor::{DType, Shape};

/// A list on a device.
#[derive(Clone)]
pub(crate) struct List {
    pub handle: Handle,
    pub length: usize,
}

impl List {
    pub fn new<T: CubeElement>(client: &Client, list: &[T]) -> Self {
        Self {
            handle: client.create_from_slice(T::as_bytes(list)),
            length: list.len(),
        }
    }

    pub fn room(client: &Client, length: usize) -> Self {
        Self {
            handle: client.empty(4 * length),
            length,
        }
    }

    #[allow(unsafe_code)]
    pub fn argument(&self) -> BufferArg {
        // The handle was made with this length.
        unsafe { BufferArg::from_raw_parts(self.handle.clone(), self.length) }
    }

    pub fn into_tensor(self, like: CubeTensor, shape: Vec<usize>, dtype: DType) -> CubeTensor {
        let (client, device) = (like.client.clone(), like.device.clone());
        CubeTensor::new_contiguous(client, device, Shape::from(shape), self.handle, dtype)
    }
}
