//! Boxes over triangles: how they are built, and fitted to triangles that moved.

use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use super::simd::LANES;
use super::triangle::HostTriangle;
use super::wide::{FEW, Wide};
use glam::{DVec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::{Boundable, BvhBuildParams};
use rayon::prelude::*;

/// Boxes over triangles, swept over the shutter. Without boxes where there are so few triangles that
/// testing each is faster.
pub(crate) struct Hierarchy {
    /// The triangles, in the scene's order.
    pub triangles: Vec<HostTriangle>,
    pub(super) wide: Wide,
    /// The binary tree that the nodes were gathered from, with boxes about the triangles of then.
    #[cfg(feature = "wgpu")]
    pub(super) built: Option<Arc<obvhs::bvh2::Bvh2>>,
    /// Σ half areas of the boxes, now and when they were built.
    cost: [f64; 2],
}

struct Swept(Aabb);

impl Boundable for Swept {
    fn aabb(&self) -> Aabb {
        self.0
    }
}

impl Hierarchy {
    /// Builds boxes over the triangles that have area.
    pub fn new(triangles: Vec<HostTriangle>) -> Self {
        let nodes = (triangles.len() > FEW).then(|| {
            let boxes: Vec<Swept> = triangles.iter().enumerate().map(apart).collect();
            let mut time = std::time::Duration::ZERO;
            let parameters = BvhBuildParams {
                max_prims_per_leaf: LANES as u32,
                ..BvhBuildParams::medium_build()
            };
            build_bvh2(&boxes, parameters, &mut time)
        });
        let wide = Wide::new(&triangles, nodes.as_ref(), extent(&triangles));
        Self {
            cost: [wide.cost(); 2],
            wide,
            triangles,
            #[cfg(feature = "wgpu")]
            built: nodes.map(Arc::new),
        }
    }

    /// Boxes over triangles, and whether they are those of another hierarchy, of triangles that are not far from
    /// these, fitted to them: as long as these have not grown by half.
    pub(crate) fn like(triangles: Vec<HostTriangle>, other: Option<&Self>) -> (Self, bool) {
        let alike = |other: &&Self| {
            other.triangles.len() == triangles.len() && !other.wide.nodes.is_empty()
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
                    #[cfg(feature = "wgpu")]
                    built: other.built.clone(),
                    cost: [cost, other.cost[1]],
                };
                (fitted, true)
            }
            None => (Self::new(triangles), false),
        }
    }

    /// Whether these are its triangles: corners, and displacement over the shutter.
    pub(crate) fn is_of(
        &self,
        count: usize,
        triangle: impl Fn(usize) -> ([DVec3; 3], DVec3) + Sync,
    ) -> bool {
        let same = |(k, t): (usize, &HostTriangle)| triangle(k) == (t.corners, t.velocity);
        self.triangles.len() == count && self.triangles.par_iter().enumerate().all(same)
    }
}

fn extent(triangles: &[HostTriangle]) -> f64 {
    let reach = |t: &HostTriangle| {
        let far = |c: DVec3| c.length().max((c + t.velocity).length());
        t.corners.map(far).into_iter().fold(0.0, f64::max)
    };
    triangles.par_iter().map(reach).reduce(|| 0.0, f64::max)
}

/// The box of a triangle, grown by next to nothing, each side by an amount of its own: among boxes that are
/// the same the builder would join one pair a round.
fn apart((i, t): (usize, &HostTriangle)) -> Swept {
    let own = t.swept();
    let size = own.min.abs().max(own.max.abs()).max_element();
    let most = if size.is_finite() {
        size * 4e-6 + 1e-12
    } else {
        0.0
    };
    let mut state = i as u32;
    let mut random = || {
        state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
        ((word >> 22) ^ word) as f32 / 4_294_967_296.0
    };
    let mut by = || Vec3A::new(random(), random(), random()) * most;
    Swept(Aabb::new(own.min - by(), own.max + by()))
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

    /// A hierarchy of these triangles.
    pub(crate) fn take(&self, triangles: Vec<HostTriangle>) -> Arc<Hierarchy> {
        let mut cached = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let (hierarchy, fitted) = Hierarchy::like(triangles, cached.last.as_deref());
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
