//! Data that renders keep for the next one.

use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

#[cfg(feature = "gpu")]
use super::standing::Standing;
use crate::scene::Constants;
use softray_kernels::accel::LastHierarchy;
use softray_kernels::kernel::LastEdges;

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
    #[cfg(feature = "gpu")]
    standing: Arc<Mutex<Option<Standing>>>,
    /// The number of renders for which the values of tensors are kept that a GPU places. 0 stands for 1.
    #[cfg_attr(
        not(feature = "gpu"),
        allow(dead_code, reason = "it is for GPUs alone")
    )]
    pub(super) every: u32,
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

    /// Reads tracked values back from a GPU only in one of `renders` renders, and without waiting. This is for training steps
    /// that change materials, lights or the environment, or move vertices by little; 8 is a good number. With 1, the default,
    /// each render waits for its own values.
    ///
    /// In the other renders the device takes tracked values from their tensors, and computes triangles, boxes, edges and their
    /// bounds from them. The host reuses what it has prepared from earlier values: which
    /// edges meshes have, the shapes of trees, and how many samples an edge on the film has. When values arrive, another
    /// thread prepares the same from them. The render that makes the next request begins to use it, or an earlier one if
    /// vertices have moved far. So the values in use are at most 2 × `renders` renders old.
    ///
    /// Images are those of renders that read, unless emission, lights or an environment map change: then images differ by
    /// noise, since emitters and directions to the map are chosen by the values in use. Gradients differ by noise, since edges
    /// are drawn in another order. They miss edges that did not count with the values in use: between faces in one plane whose
    /// colors, texture coordinates and normals were the same on both sides, and at faces that had no area. They also miss lines
    /// in which bodies have come to intersect since.
    ///
    /// A render reads and waits, as without this setting, unless
    /// - it is made by [`render`](crate::render::render) or [`render_batch`](crate::render::render_batch) on a GPU of this
    ///   machine, in f32, and by the thread of the render before it,
    /// - the render before it had the same options except the seed, and the same scenes and cameras except the values of
    ///   tracked tensors,
    /// - the graph of the render before it was dropped, and its backward pass has not failed,
    /// - tracked tensors are those of meshes (vertices, texture coordinates, normals, colors, tangents), of materials
    ///   (constants, textures and normal maps), of delta lights (positions, intensities, irradiances) and of the environment,
    /// - meshes with normal maps have tangents,
    /// - objects with tracked vertices or texture coordinates do not emit light, those with tracked texture coordinates
    ///   have no alpha mask, and with the values in use those with tracked vertices intersected no other object,
    /// - no vertex has moved by more than a quarter of a typical edge of its object since the values in use, and no emission,
    ///   strength of a light or radiance of the environment has changed by more than the largest value of its tensor,
    /// - sampling is not adaptive, and diagnostics are off.
    ///
    /// How much has changed is known one render later, so a render after a large change reads. Values that are not
    /// finite are an error in the next render that has such values. Other mistakes in tracked values (normals of length 0)
    /// are an error in the render that would begin to use them, also if its own values are right. Renders on servers ignore
    /// this setting.
    ///
    /// ```
    /// use softray::prelude::*;
    /// let cache = HierarchyCache::new().reading_every(8);
    /// let options = RenderOptions::new(64, 64).with_cache(&cache);
    /// ```
    pub fn reading_every(mut self, renders: u32) -> Self {
        self.every = renders;
        self
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

    /// Takes the last render.
    #[cfg(feature = "gpu")]
    pub(super) fn take_standing(&self) -> Option<Standing> {
        let standing = self.standing.lock();
        standing.unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Returns a cache that shares boxes and edges with this one, and nothing else.
    #[cfg(feature = "gpu")]
    pub(super) fn of_scenes(&self) -> Self {
        Self {
            scenes: self.scenes.clone(),
            ..Self::default()
        }
    }

    /// Keeps a render for the next one.
    #[cfg(feature = "gpu")]
    pub(super) fn set_standing(&self, render: Standing) {
        let standing = self.standing.lock();
        *standing.unwrap_or_else(PoisonError::into_inner) = Some(render);
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
