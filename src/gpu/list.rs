//! Lists on a device.

use burn::cubecl::prelude::*;
use burn::cubecl::server::Handle;

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
}
