//! Boxes over triangles: how they are built, and fitted to triangles that moved.

use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use super::build::{Spare, tree};
use super::triangle::HostTriangle;
use super::wide::{FEW, Wide};
use glam::DVec3;
use rayon::prelude::*;

/// Boxes over triangles, swept over the shutter. Without boxes where there are so few triangles that
/// testing each is faster.
pub(crate) struct Hierarchy {
    /// The triangles, in the scene's order.
    pub triangles: Vec<HostTriangle>,
    pub(super) wide: Wide,
    /// Whether all triangles are in it; of many that are the same some are left out.
    complete: bool,
    /// The binary tree that the nodes were gathered from, with boxes about the triangles of then.
    #[cfg(feature = "wgpu")]
    pub(super) built: Option<Arc<obvhs::bvh2::Bvh2>>,
    /// Σ half areas of the boxes, now and when they were built.
    cost: [f64; 2],
}

impl Hierarchy {
    /// Builds boxes over triangles.
    pub fn new(triangles: Vec<HostTriangle>, spare: Spare) -> Self {
        let (nodes, complete) = match triangles.len() > FEW {
            true => {
                let (nodes, complete) = tree(&triangles, spare);
                (Some(nodes), complete)
            }
            false => (None, true),
        };
        let wide = Wide::new(&triangles, nodes.as_ref(), extent(&triangles));
        Self {
            cost: [wide.cost(); 2],
            wide,
            triangles,
            complete,
            #[cfg(feature = "wgpu")]
            built: nodes.map(Arc::new),
        }
    }

    /// Boxes over triangles, and whether they are those of another hierarchy, of triangles that are not far from
    /// these, fitted to them: as long as these have not grown by half.
    pub(crate) fn like(
        triangles: Vec<HostTriangle>,
        other: Option<&Self>,
        spare: Spare,
    ) -> (Self, bool) {
        let alike = |other: &&Self| {
            let same = other.complete && other.triangles.len() == triangles.len();
            same && !other.wide.nodes.is_empty()
        };
        let fitted = other.filter(alike).and_then(|other| {
            let wide = other.wide.fit(&triangles, extent(&triangles));
            let cost = wide.cost();
            (cost <= 1.5 * other.cost[1]).then_some((wide, cost, other))
        });
        match fitted {
            Some((wide, cost, other)) => {
                let fitted = Self {
                    wide,
                    triangles,
                    complete: true,
                    #[cfg(feature = "wgpu")]
                    built: other.built.clone(),
                    cost: [cost, other.cost[1]],
                };
                (fitted, true)
            }
            None => (Self::new(triangles, spare), false),
        }
    }

    /// Whether these are its triangles, all in it: corners, and displacement over the shutter.
    pub(crate) fn is_of(
        &self,
        count: usize,
        triangle: impl Fn(usize) -> ([DVec3; 3], DVec3) + Sync,
    ) -> bool {
        let same = |(k, t): (usize, &HostTriangle)| triangle(k) == (t.corners, t.velocity);
        let alike = self.complete && self.triangles.len() == count;
        alike && self.triangles.par_iter().enumerate().all(same)
    }
}

fn extent(triangles: &[HostTriangle]) -> f64 {
    let reach = |t: &HostTriangle| {
        let far = |c: DVec3| c.length().max((c + t.velocity).length());
        t.corners.map(far).into_iter().fold(0.0, f64::max)
    };
    triangles.par_iter().map(reach).reduce(|| 0.0, f64::max)
}

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

    /// The hierarchy of the last render.
    pub(crate) fn last(&self) -> Option<Arc<Hierarchy>> {
        let cached = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        cached.last.clone()
    }

    /// A hierarchy of these triangles, some of which may be spare.
    pub(crate) fn take(&self, triangles: Vec<HostTriangle>, spare: Spare) -> Arc<Hierarchy> {
        let mut cached = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let (hierarchy, fitted) = Hierarchy::like(triangles, cached.last.as_deref(), spare);
        if fitted {
            cached.fits += 1;
        } else {
            cached.builds += 1;
        }
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
