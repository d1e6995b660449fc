//! Boxes over triangles: how they are built, and refitted to triangles that moved.

#[cfg(feature = "gpu")]
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::build::{Spare, tree};
#[cfg(feature = "gpu")]
use super::gpu::GpuTree;
use super::triangle::HostTriangle;
use super::wide::{MAX_WITHOUT_BOXES, Wide};
use glam::DVec3;
use rayon::prelude::*;

/// The largest number of triangles without a binary tree: GPUs test them one by one, a CPU tests eight at once.
const MAX_WITHOUT_TREE: usize = if cfg!(feature = "gpu") {
    8
} else {
    MAX_WITHOUT_BOXES
};

/// Boxes over triangles, enclosing their motion over the shutter. There are no boxes if there are so few triangles that
/// testing each is faster.
#[derive(Clone)]
pub struct Hierarchy {
    /// The triangles, in the scene's order.
    pub triangles: Vec<HostTriangle>,
    pub(super) wide: Wide,
    /// Whether it contains all triangles. Of many identical triangles, some are left out.
    complete: bool,
    /// The binary tree from which the nodes were made. Its boxes are those of the triangles at that time.
    #[cfg(feature = "gpu")]
    built: Option<Arc<obvhs::bvh2::Bvh2>>,
    /// The shape of the tree for GPUs, made when it is first needed.
    #[cfg(feature = "gpu")]
    for_gpu: OnceLock<Arc<GpuTree>>,
    /// Σ half areas of the boxes when they were built.
    cost: f64,
    /// Distinguishes the triangles from those of all other hierarchies, but for copies.
    version: u64,
    /// The version of which it is a refit, and which triangles have moved since.
    before: Option<(u64, Vec<bool>)>,
}

/// Returns a version that no hierarchy has.
fn next_version() -> u64 {
    static LAST: AtomicU64 = AtomicU64::new(0);
    1 + LAST.fetch_add(1, Ordering::Relaxed)
}

impl Hierarchy {
    /// Builds boxes over triangles.
    pub fn new(triangles: Vec<HostTriangle>, spare: Spare) -> Self {
        let (nodes, complete) = match triangles.len() > MAX_WITHOUT_TREE {
            true => {
                let (nodes, complete) = tree(&triangles, spare);
                (Some(nodes), complete)
            }
            false => (None, true),
        };
        let gathered = nodes
            .as_ref()
            .filter(|_| triangles.len() > MAX_WITHOUT_BOXES);
        let wide = Wide::new(&triangles, gathered);
        Self {
            cost: wide.cost(),
            version: next_version(),
            before: None,
            wide,
            triangles,
            complete,
            #[cfg(feature = "gpu")]
            built: nodes.map(Arc::new),
            #[cfg(feature = "gpu")]
            for_gpu: OnceLock::new(),
        }
    }

    /// Replaces its triangles, and returns whether its boxes were refitted to the new ones. They are refitted if the
    /// number of triangles is the same and boxes have not grown by half. Otherwise they are built again.
    pub fn update(
        &mut self,
        triangles: impl IndexedParallelIterator<Item = HostTriangle>,
        spare: Spare,
    ) -> bool {
        let alike = self.complete && !self.wide.nodes.is_empty();
        let alike = alike && self.triangles.len() == triangles.len();
        if !alike {
            triangles.collect_into_vec(&mut self.triangles);
        } else {
            let replaced = triangles.zip(&mut self.triangles).map(|(new, old)| {
                let moved = (new.corners, new.velocity) != (old.corners, old.velocity);
                *old = new;
                moved
            });
            let moved: Vec<bool> = replaced.collect();
            self.wide.fit(&self.triangles, &moved);
            self.before = Some((self.version, moved));
            self.version = next_version();
            if self.wide.cost() <= 1.5 * self.cost {
                return true;
            }
        }
        *self = Self::new(std::mem::take(&mut self.triangles), spare);
        false
    }

    /// Whether it contains all triangles.
    #[cfg(feature = "gpu")]
    pub fn is_complete(&self) -> bool {
        self.complete
    }

    /// Returns the shape of the tree that GPUs traverse. It has no nodes if there are few triangles.
    #[cfg(feature = "gpu")]
    pub fn for_gpu(&self) -> Arc<GpuTree> {
        if let Some(tree) = self.for_gpu.get() {
            return tree.clone();
        }
        // Several threads may make it, so that none holds the lock meanwhile.
        let tree = Arc::new(GpuTree::new(self.built.as_deref(), &self.triangles));
        self.for_gpu.get_or_init(|| tree).clone()
    }

    pub fn version(&self) -> u64 {
        self.version
    }

    /// Returns which triangles have moved since a version: none of the same one (an empty list). It returns `None` if that
    /// is unknown.
    pub fn moved_since(&self, version: u64) -> Option<&[bool]> {
        if version == self.version {
            return Some(&[]);
        }
        let before = self.before.as_ref();
        before.filter(|b| b.0 == version).map(|b| &*b.1)
    }

    /// Returns whether it contains exactly these triangles, given by corners and displacement over the shutter.
    pub fn is_of(
        &self,
        count: usize,
        triangle: impl Fn(usize) -> ([DVec3; 3], DVec3) + Sync,
    ) -> bool {
        let same = |(k, t): (usize, &HostTriangle)| triangle(k) == (t.corners, t.velocity);
        let alike = self.complete && self.triangles.len() == count;
        alike && self.triangles.par_iter().enumerate().all(same)
    }
}

/// The hierarchy of the last render. Its boxes are refitted to triangles that moved. They are built again if they have
/// grown by half or if the number of triangles changed.
#[derive(Clone, Default)]
pub struct LastHierarchy(Arc<Mutex<Cached>>);

#[derive(Default)]
struct Cached {
    last: Option<Arc<Hierarchy>>,
    builds: u64,
    fits: u64,
}

impl LastHierarchy {
    fn lock(&self) -> MutexGuard<'_, Cached> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns how many times boxes were built, and how many times they were refitted.
    pub fn counts(&self) -> [u64; 2] {
        let cached = self.lock();
        [cached.builds, cached.fits]
    }

    pub fn last(&self) -> Option<Arc<Hierarchy>> {
        self.lock().last.clone()
    }

    /// Returns a hierarchy of these triangles, some of which may be `spare`. It refits the last one, or `like` if the
    /// last one has another number of triangles, and builds a new one if that fails. The last one is overwritten unless
    /// another render holds it.
    pub fn take(
        &self,
        like: Option<&Arc<Hierarchy>>,
        triangles: impl IndexedParallelIterator<Item = HostTriangle>,
        spare: Spare,
    ) -> Arc<Hierarchy> {
        let last = self.lock().last.take();
        let last = last.filter(|last| last.triangles.len() == triangles.len());
        let own = last.or_else(|| like.cloned());
        let mut own = own.unwrap_or_else(|| Arc::new(Hierarchy::new(Vec::new(), None)));
        let fitted = Arc::make_mut(&mut own).update(triangles, spare);
        let mut cached = self.lock();
        if fitted {
            cached.fits += 1;
        } else {
            cached.builds += 1;
        }
        cached.last = Some(own.clone());
        own
    }
}
