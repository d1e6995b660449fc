use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use glam::{DVec3, Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::{Boundable, BvhBuildParams};

use super::HostTriangle;

/// Boxes over triangles, swept over the shutter. Without boxes where there are so few triangles that
/// asking each is faster.
pub struct Hierarchy {
    /// The triangles, in the scene's order.
    pub triangles: Vec<HostTriangle>,
    nodes: Option<Bvh2>,
    /// Σ half areas of the boxes, now and when they were built.
    cost: [f64; 2],
    /// The largest distance of a corner from the origin of coordinates.
    extent: f64,
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
    /// How often boxes were built and fitted.
    pub fn counts(&self) -> [u64; 2] {
        let cached = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        [cached.builds, cached.fits]
    }

    /// A hierarchy of these triangles.
    pub(crate) fn take(&self, triangles: Vec<HostTriangle>) -> Arc<Hierarchy> {
        let mut cached = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let old = cached.last.as_ref();
        let old = old.filter(|h| h.has_boxes() && h.triangles.len() == triangles.len());
        let fitted = old.map(|h| h.fitted(&triangles));
        let hierarchy = match fitted {
            Some((nodes, cost)) if cost[0] <= 1.5 * cost[1] => {
                cached.fits += 1;
                Hierarchy {
                    extent: extent(&triangles),
                    triangles,
                    nodes: Some(nodes),
                    cost,
                }
            }
            _ => {
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

fn cost(nodes: &Bvh2) -> f64 {
    nodes
        .nodes
        .iter()
        .map(|n| f64::from(n.aabb().half_area()))
        .sum()
}

/// Up to here each triangle is asked (`benches/RESULTS.md`).
const FEW: usize = 4;

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
            let boxes: Vec<Swept> = triangles.iter().map(swept).collect();
            let mut time = std::time::Duration::ZERO;
            build_bvh2(&boxes, BvhBuildParams::medium_build(), &mut time)
        });
        let cost = nodes.as_ref().map_or(0.0, cost);
        Self {
            extent: extent(&triangles),
            triangles,
            nodes,
            cost: [cost; 2],
        }
    }

    /// The same tree with boxes about other triangles, and its cost.
    fn fitted(&self, triangles: &[HostTriangle]) -> (Bvh2, [f64; 2]) {
        let mut nodes = self.nodes.clone().unwrap_or_default();
        let primitives = std::mem::take(&mut nodes.primitive_indices);
        for node in nodes.nodes.iter_mut().filter(|n| n.is_leaf()) {
            let first = node.first_index as usize;
            let list = &primitives[first..first + node.prim_count as usize];
            let boxes = list.iter().map(|&k| swept(&triangles[k as usize]).0);
            node.set_aabb(boxes.fold(Aabb::INVALID, |a, b| a.union(&b)));
        }
        nodes.primitive_indices = primitives;
        nodes.refit_all();
        let now = cost(&nodes);
        (nodes, [now, self.cost[1]])
    }

    /// Whether boxes were built.
    pub fn has_boxes(&self) -> bool {
        self.nodes.is_some()
    }

    /// Calls a function with every triangle whose box, grown by `reach`, a ray may meet before
    /// `limit`; the function returns the limit from there on. Returns how many triangles were
    /// offered.
    pub fn visit(
        &self,
        origin: DVec3,
        direction: DVec3,
        reach: f64,
        mut limit: f64,
        mut f: impl FnMut(u32) -> f64,
    ) -> u32 {
        let mut offered = 0;
        let Some(bvh) = &self.nodes else {
            for k in 0..self.triangles.len() as u32 {
                f(k);
            }
            return self.triangles.len() as u32;
        };
        // Boxes are in f32: grown by what that rounds, and met from a point of the ray near them,
        // since a distant origin would round by more than they are large.
        let grown = Vec3A::splat((reach + 1e-6 * self.extent) as f32);
        let skipped = (-origin.dot(direction) - 2.0 * self.extent).max(0.0);
        let o = Vec3A::from((origin + direction * skipped).as_vec3());
        let safe = |d: f64| {
            if d.abs() < 1e-12 {
                1e-12f64.copysign(d)
            } else {
                d
            }
        };
        let inverse = Vec3::new(
            safe(direction.x).recip() as f32,
            safe(direction.y).recip() as f32,
            safe(direction.z).recip() as f32,
        );
        let inverse = Vec3A::from(inverse);
        let enter = |aabb: &Aabb| {
            let t0 = (aabb.min - grown - o) * inverse;
            let t1 = (aabb.max + grown - o) * inverse;
            let near = t0.min(t1).max_element().max(0.0);
            let far = t0.max(t1).min_element();
            (near <= far).then_some(near)
        };
        let mut stack: Vec<(u32, f32)> = Vec::with_capacity(64);
        if let Some(near) = enter(bvh.nodes[0].aabb()) {
            stack.push((0, near));
        }
        while let Some((index, near)) = stack.pop() {
            if f64::from(near) + skipped > limit {
                continue;
            }
            let node = &bvh.nodes[index as usize];
            let first = node.first_index;
            if node.is_leaf() {
                for i in first..first + node.prim_count {
                    offered += 1;
                    limit = f(bvh.primitive_indices[i as usize]);
                }
                continue;
            }
            let [a, b] = [0, 1].map(|i| {
                let child = first + i;
                enter(bvh.nodes[child as usize].aabb()).map(|near| (child, near))
            });
            // The nearer child is taken first.
            match (a, b) {
                (Some(a), Some(b)) if a.1 <= b.1 => stack.extend([b, a]),
                (Some(a), Some(b)) => stack.extend([a, b]),
                (a, b) => stack.extend(a.or(b)),
            }
        }
        offered
    }
}

fn extent(triangles: &[HostTriangle]) -> f64 {
    let reach = |t: &HostTriangle| {
        let far = |c: DVec3| c.length().max((c + t.velocity).length());
        t.corners.map(far).into_iter().fold(0.0, f64::max)
    };
    triangles.iter().map(reach).fold(0.0, f64::max)
}

fn swept(t: &HostTriangle) -> Swept {
    let mut aabb = Aabb::INVALID;
    for corner in t.corners {
        aabb.extend(Vec3A::from(corner.as_vec3()));
        aabb.extend(Vec3A::from((corner + t.velocity).as_vec3()));
    }
    Swept(aabb)
}
