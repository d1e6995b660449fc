//! What renders leave for the next.

use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::accel::LastHierarchy;
use crate::kernel::LastEdges;
use crate::scene::Constants;

/// What is kept from render to render, as in the steps of a fit: boxes over triangles, which edges meshes have, and how
/// these are divided, for each scene of a batch by its number. Boxes are fitted to triangles that moved, and built anew
/// when they have grown by half, or there are other triangles.
///
/// Of GPUs the numbers of tensors that are not in a graph are kept, so that each is read back once, and the lists of scenes,
/// on the device and on the host: the next render sends what has changed. They are freed with the cache. All is sent again
/// where lists take another room, while a graph needs the last lists, after a failure, on another device and from another
/// thread.
#[derive(Clone, Default)]
pub struct HierarchyCache {
    scenes: Arc<Mutex<Vec<LastScene>>>,
    constants: Arc<Mutex<Constants>>,
    #[cfg(feature = "wgpu")]
    pub(super) buffers: crate::gpu::LastBuffers,
}

/// What a scene leaves for the next render.
#[derive(Clone, Default)]
pub(super) struct LastScene {
    pub boxes: LastHierarchy,
    pub edges: LastEdges,
}

impl HierarchyCache {
    /// The numbers of times that boxes were built and fitted.
    pub fn counts(&self) -> [u64; 2] {
        let scenes = self.scenes.lock().unwrap_or_else(PoisonError::into_inner);
        let counts = scenes.iter().map(|scene| scene.boxes.counts());
        counts.fold([0; 2], |[a, b], [builds, fits]| [a + builds, b + fits])
    }

    /// Constants that were read back.
    pub(super) fn constants(&self) -> MutexGuard<'_, Constants> {
        self.constants
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    /// What so many scenes of a batch left.
    pub(super) fn scenes(&self, count: usize) -> Vec<LastScene> {
        let mut scenes = self.scenes.lock().unwrap_or_else(PoisonError::into_inner);
        let most = scenes.len().max(count);
        scenes.resize_with(most, LastScene::default);
        scenes[..count].to_vec()
    }
}

impl fmt::Debug for HierarchyCache {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "HierarchyCache({:?})", self.counts())
    }
}
