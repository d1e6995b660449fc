//! A hierarchy that is kept from render to render.

use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use super::hierarchy::Hierarchy;
use super::triangle::HostTriangle;

/// A hierarchy kept from render to render: its boxes are fitted to triangles that moved, and built
/// anew when they have grown by half, or there are other triangles.
#[derive(Clone, Default)]
pub struct HierarchyCache(Arc<Mutex<Cached>>);

#[derive(Default)]
struct Cached {
    last: Option<Arc<Hierarchy>>,
    builds: u64,
    fits: u64,
}

impl HierarchyCache {
    /// The numbers of times that boxes were built and fitted.
    pub fn counts(&self) -> [u64; 2] {
        let cached = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        [cached.builds, cached.fits]
    }

    /// A hierarchy of these triangles.
    pub(crate) fn take(&self, triangles: Vec<HostTriangle>) -> Arc<Hierarchy> {
        let mut cached = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let fitted = cached.last.as_ref().and_then(|old| old.fit(&triangles));
        let hierarchy = match fitted {
            Some((nodes, cost)) => {
                cached.fits += 1;
                Hierarchy::of_nodes(triangles, nodes, cost)
            }
            None => {
                cached.builds += 1;
                Hierarchy::new(triangles)
            }
        };
        let hierarchy = Arc::new(hierarchy);
        cached.last = Some(hierarchy.clone());
        hierarchy
    }
}

impl fmt::Debug for HierarchyCache {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "HierarchyCache({:?})", self.counts())
    }
}
