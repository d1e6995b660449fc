//! Data that renders keep for the next one.

use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::accel::LastHierarchy;
use crate::kernel::LastEdges;
use crate::scene::Constants;

/// A cache of data from render to render, such as the steps of a fit.
///
/// For each scene of a batch, by its index, it keeps the BVH, the edges of meshes and the subdivision of the edges. A
/// BVH is refitted if triangles move. It is rebuilt if its boxes have grown by half or the number of triangles differs.
/// Lines in which triangles intersect, and on CPUs bounds of edges, are computed again only where a triangle has moved.
///
/// For renders on GPUs it also keeps the values of untracked tensors, so that each is read back once, and the lists of
/// scenes, on the device and on the host. The next render uploads only changes. The memory is freed with the cache. A
/// render uploads everything if lists change in size, if a graph still holds the last lists, after a failed render, on
/// another device, and from another thread.
///
/// For renders on a server, the server keeps the data.
///
/// ```
/// use softray::prelude::*;
/// let (room, camera) = cornell_box(&Device::flex());
/// let cache = HierarchyCache::new();
/// let options = RenderOptions::new(8, 8).with_samples(1).with_cache(&cache);
/// for seed in 0..3 {
///     render(&room, &camera, &options.clone().with_seed(seed))?;
/// }
/// assert_eq!(cache.counts()[0], 1);
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Clone, Default)]
pub struct HierarchyCache {
    scenes: Arc<Mutex<Vec<LastScene>>>,
    constants: Arc<Mutex<Constants>>,
    #[cfg(feature = "gpu")]
    pub(super) buffers: crate::gpu::LastBuffers,
    /// Names the cache of a server that stands for this one.
    #[cfg(feature = "remote")]
    id: Arc<std::sync::OnceLock<u64>>,
}

/// The data of one scene for the next render.
#[derive(Clone, Default)]
pub(super) struct LastScene {
    pub boxes: LastHierarchy,
    pub edges: LastEdges,
}

impl HierarchyCache {
    /// Creates an empty cache.
    pub fn new() -> Self {
        Self::default()
    }

    /// Returns how often a BVH was built and how often one was refitted, summed over all scenes.
    pub fn counts(&self) -> [u64; 2] {
        let scenes = self.scenes.lock().unwrap_or_else(PoisonError::into_inner);
        let counts = scenes.iter().map(|scene| scene.boxes.counts());
        counts.fold([0; 2], |[a, b], [builds, fits]| [a + builds, b + fits])
    }

    #[cfg(feature = "remote")]
    pub(super) fn id(&self) -> u64 {
        *self.id.get_or_init(crate::device::remote::unique)
    }

    /// Untracked tensors that were read back.
    pub(super) fn constants(&self) -> MutexGuard<'_, Constants> {
        self.constants
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    /// The data of the first `count` scenes of a batch.
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
