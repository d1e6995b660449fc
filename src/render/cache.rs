//! What renders leave for the next.

use std::fmt;

use crate::accel::LastHierarchy;
use crate::kernel::LastEdges;

/// What is kept from render to render, as in the steps of a fit: boxes over triangles, which edges meshes have, and how
/// these are divided. Boxes are fitted to triangles that moved, and built anew when they have grown by half, or there are
/// other triangles.
#[derive(Clone, Default)]
pub struct HierarchyCache {
    pub(super) boxes: LastHierarchy,
    pub(super) edges: LastEdges,
}

impl HierarchyCache {
    /// The numbers of times that boxes were built and fitted.
    pub fn counts(&self) -> [u64; 2] {
        self.boxes.counts()
    }
}

impl fmt::Debug for HierarchyCache {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "HierarchyCache({:?})", self.counts())
    }
}
