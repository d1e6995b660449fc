//! What a render leaves to the next one, and where tensors are in the row.

use std::ops::Range;
#[cfg(feature = "gpu")]
use std::panic::resume_unwind;
#[cfg(feature = "gpu")]
use std::sync::Arc;
#[cfg(feature = "gpu")]
use std::thread::{self, JoinHandle};

#[cfg(feature = "gpu")]
use burn::tensor::Tensor;
#[cfg(feature = "gpu")]
use rayon::ThreadPoolBuilder;

#[cfg(feature = "gpu")]
use crate::error::Result;
#[cfg(feature = "gpu")]
use crate::geometry::Context;
#[cfg(feature = "gpu")]
use crate::gpu::{Packed, Reading};
#[cfg(feature = "gpu")]
use crate::scene::{Camera, Scene};
use softray_kernels::host::ParameterId;
#[cfg(feature = "gpu")]
use softray_kernels::kernel::View;

/// The ranges of tensors in the row.
pub(super) type TensorPlaces = Vec<(ParameterId, Range<usize>)>;

/// The ranges of a view's derivatives in the row.
#[derive(Clone, Default)]
pub(super) struct Places {
    pub scene: TensorPlaces,
    pub camera: TensorPlaces,
}

/// A group of views that kernels trace together, with the indices of its views.
#[cfg(feature = "gpu")]
pub(super) type Group = (Vec<usize>, Arc<Packed>);

/// Everything by which a render may differ from another one, except the random numbers and the values of tensors that
/// a device places: a hash of numbers and of the places of tensors in memory, and lists of integers.
#[cfg(feature = "gpu")]
pub(super) struct Look {
    pub hash: u64,
    pub faces: Vec<Arc<Vec<[u32; 3]>>>,
    pub indices: Vec<Arc<Vec<u32>>>,
    /// The tensors without graph, which keep these places from being taken by others.
    pub _scenes: Vec<Scene>,
    pub _cameras: Vec<Camera>,
    pub _vertices: Vec<Tensor<3>>,
}

#[cfg(feature = "gpu")]
impl PartialEq for Look {
    fn eq(&self, other: &Self) -> bool {
        let hash = self.hash == other.hash;
        hash && self.faces == other.faces && self.indices == other.indices
    }
}

/// A render whose data serves the next one, if that looks the same.
#[cfg(feature = "gpu")]
pub(super) struct Standing {
    pub look: Look,
    pub views: Arc<Vec<(View, Places)>>,
    /// The groups without their buffers.
    pub groups: Vec<Group>,
    pub context: Context,
    pub lit: bool,
    /// The number of renders since values of tensors last arrived.
    pub age: u32,
    /// The sum of the longest moves of vertices since the values in use, and since the values that are being prepared,
    /// divided by typical lengths of edges.
    pub moved: f32,
    pub newer: f32,
    /// The longest moves of vertices in the render, one for each group.
    pub moves: Vec<Reading>,
    /// The values of the row, if the host is to prepare views from them.
    pub values: Option<Reading>,
    pub preparing: Option<Preparing>,
}

/// Views that another thread prepares, from values of an earlier render, while renders go on without them.
#[cfg(feature = "gpu")]
pub(super) struct Preparing(Option<JoinHandle<Result<Views>>>);

/// The views of a batch, and whether all scenes have light.
#[cfg(feature = "gpu")]
pub(super) type Views = (Vec<(View, Places)>, bool);

#[cfg(feature = "gpu")]
impl Preparing {
    /// Starts a thread, or returns `None` if the system has none left. Its loops run in threads of their own, since those of
    /// the program may all wait for it.
    pub fn new(prepare: impl FnOnce() -> Result<Views> + Send + 'static) -> Option<Self> {
        let thread = thread::Builder::new().spawn(|| match ThreadPoolBuilder::new().build() {
            Ok(pool) => pool.install(prepare),
            Err(_) => prepare(),
        });
        Some(Self(Some(thread.ok()?)))
    }

    /// Waits for the views.
    pub fn finish(mut self) -> Option<Result<Views>> {
        let thread = self.0.take()?;
        Some(thread.join().unwrap_or_else(|panic| resume_unwind(panic)))
    }
}

#[cfg(feature = "gpu")]
impl Drop for Preparing {
    /// Waits for the thread, which changes what the cache keeps.
    fn drop(&mut self) {
        self.0.take().map(JoinHandle::join);
    }
}
