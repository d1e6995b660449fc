//! Boxes over triangles: how they are built, and fitted to triangles that moved.

use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use super::simd::LANES;
use super::triangle::HostTriangle;
use super::wide::{FEW, Wide};
use glam::{DVec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::{Boundable, BvhBuildParams};

/// Boxes over triangles, swept over the shutter. Without boxes where there are so few triangles that
/// testing each is faster.
pub(crate) struct Hierarchy {
    /// The triangles, in the scene's order.
    pub triangles: Vec<HostTriangle>,
    pub(super) nodes: Option<Bvh2>,
    pub(super) wide: Wide,
    /// Σ half areas of the boxes, now and when they were built.
    cost: [f64; 2],
}

fn cost(nodes: &Bvh2) -> f64 {
    nodes
        .nodes
        .iter()
        .map(|n| f64::from(n.aabb().half_area()))
        .sum()
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
        let cost = nodes.as_ref().map_or(0.0, cost);
        Self {
            wide: Wide::new(&triangles, nodes.as_ref(), extent(&triangles)),
            triangles,
            nodes,
            cost: [cost; 2],
        }
    }

    /// Boxes over triangles, and whether they are those of another hierarchy, of triangles that are not far from
    /// these, fitted to them: as long as these have not grown by half.
    pub(crate) fn like(triangles: Vec<HostTriangle>, other: Option<&Self>) -> (Self, bool) {
        match other.and_then(|other| other.fit(&triangles)) {
            Some((nodes, cost)) => {
                let fitted = Self {
                    wide: Wide::new(&triangles, Some(&nodes), extent(&triangles)),
                    triangles,
                    nodes: Some(nodes),
                    cost,
                };
                (fitted, true)
            }
            None => (Self::new(triangles), false),
        }
    }

    /// The same tree with boxes about other triangles, and its cost, unless it has grown by half.
    fn fit(&self, triangles: &[HostTriangle]) -> Option<(Bvh2, [f64; 2])> {
        if self.triangles.len() != triangles.len() {
            return None;
        }
        let mut nodes = self.nodes.clone()?;
        let primitives = std::mem::take(&mut nodes.primitive_indices);
        for node in nodes.nodes.iter_mut().filter(|n| n.is_leaf()) {
            let first = node.first_index as usize;
            let list = &primitives[first..first + node.prim_count as usize];
            let boxes = list.iter().map(|&k| swept(&triangles[k as usize]).0);
            node.set_aabb(boxes.fold(Aabb::INVALID, |a, b| a.union(&b)));
        }
        nodes.primitive_indices = primitives;
        nodes.refit_all();
        let cost = [cost(&nodes), self.cost[1]];
        (cost[0] <= 1.5 * cost[1]).then_some((nodes, cost))
    }

    /// Calls a function with the triangles whose boxes, swept over the shutter, overlap that of one: itself
    /// too, and all where there are no boxes. Ends when it returns false.
    pub(crate) fn overlapping(&self, triangle: u32, mut f: impl FnMut(u32) -> bool) {
        let Some(nodes) = &self.nodes else {
            let _ = (0..self.triangles.len() as u32).all(f);
            return;
        };
        let own = swept(&self.triangles[triangle as usize]).0;
        nodes.aabb_traverse(own, |nodes, at| {
            let leaf = &nodes.nodes[at as usize];
            let first = leaf.first_index as usize;
            let list = &nodes.primitive_indices[first..first + leaf.prim_count as usize];
            list.iter().all(|&k| f(k))
        });
    }
}

fn extent(triangles: &[HostTriangle]) -> f64 {
    let reach = |t: &HostTriangle| {
        let far = |c: DVec3| c.length().max((c + t.velocity).length());
        t.corners.map(far).into_iter().fold(0.0, f64::max)
    };
    triangles.iter().map(reach).fold(0.0, f64::max)
}

/// The box of a triangle, grown by next to nothing, each side by an amount of its own: among boxes that are
/// the same the builder would join one pair a round.
fn apart((i, t): (usize, &HostTriangle)) -> Swept {
    let Swept(own) = swept(t);
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

fn swept(t: &HostTriangle) -> Swept {
    let mut aabb = Aabb::INVALID;
    for corner in t.corners {
        aabb.extend(Vec3A::from(corner.as_vec3()));
        aabb.extend(Vec3A::from((corner + t.velocity).as_vec3()));
    }
    Swept(aabb)
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
