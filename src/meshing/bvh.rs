//! A hierarchy of bounding boxes over triangles in double precision.

use glam::DVec3;

use super::mesh::{SurfacePoint, TriangleMesh};

/// The most triangles of a leaf.
const LEAF: usize = 4;

/// A node. The left child of an inner node follows it.
#[derive(Clone, Debug)]
pub(super) struct Node {
    pub min: DVec3,
    pub max: DVec3,
    /// The index of the right child, or of a leaf's first triangle.
    pub next: u32,
    /// The number of a leaf's triangles, 0 for an inner node.
    pub count: u32,
}

impl Node {
    /// The squared distance of a point to the box.
    fn squared_distance(&self, point: DVec3) -> f64 {
        point.distance_squared(point.clamp(self.min, self.max))
    }
}

/// A binary tree over the triangles of a mesh, divided at the median of the longest axis: its depth is logarithmic for
/// any input.
#[derive(Clone, Debug)]
pub(crate) struct Bvh {
    pub(super) nodes: Vec<Node>,
    /// The triangles in the order of the leaves.
    pub order: Vec<u32>,
    pub corners: Vec<[DVec3; 3]>,
}

/// The nearest point of a surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Nearest {
    pub on: SurfacePoint,
    pub point: DVec3,
    pub squared_distance: f64,
}

impl Bvh {
    pub fn new(mesh: &TriangleMesh) -> Self {
        let count = mesh.faces.len();
        let mut order: Vec<u32> = (0..count as u32).collect();
        let boxes: Vec<[DVec3; 2]> = (0..count as u32)
            .map(|k| {
                let [a, b, c] = mesh.corners(k);
                [a.min(b).min(c), a.max(b).max(c)]
            })
            .collect();
        let mut nodes = Vec::with_capacity(count);
        if count > 0 {
            build(&boxes, &mut order, 0, &mut nodes);
        }
        let corners = order.iter().map(|&k| mesh.corners(k)).collect();
        Self {
            nodes,
            order,
            corners,
        }
    }

    /// The nearest point among the faces that `accept` takes, nearer than the root of `limit`.
    pub fn nearest(
        &self,
        point: DVec3,
        limit: f64,
        accept: impl Fn(u32) -> bool,
    ) -> Option<Nearest> {
        let (mut best, mut found) = (limit, None);
        let mut open = Vec::with_capacity(64);
        if let Some(root) = self.nodes.first() {
            open.push((0u32, root.squared_distance(point)));
        }
        while let Some((at, distance)) = open.pop() {
            if distance >= best {
                continue;
            }
            let node = &self.nodes[at as usize];
            if node.count == 0 {
                let near = |child: u32| (child, self.nodes[child as usize].squared_distance(point));
                let (left, right) = (near(at + 1), near(node.next));
                let (first, second) = if left.1 <= right.1 {
                    (left, right)
                } else {
                    (right, left)
                };
                open.push(second);
                open.push(first);
                continue;
            }
            for i in node.next as usize..(node.next + node.count) as usize {
                let barycentric = nearest_on_triangle(point, self.corners[i]);
                let [a, b, c] = self.corners[i];
                let on = a * barycentric[0] + b * barycentric[1] + c * barycentric[2];
                let squared_distance = on.distance_squared(point);
                if squared_distance < best && accept(self.order[i]) {
                    best = squared_distance;
                    found = Some(Nearest {
                        on: SurfacePoint {
                            face: self.order[i],
                            barycentric,
                        },
                        point: on,
                        squared_distance,
                    });
                }
            }
        }
        found
    }

    /// Calls `visit` with each triangle whose box overlaps a box.
    pub fn overlapping(&self, min: DVec3, max: DVec3, mut visit: impl FnMut(u32)) {
        let mut open = Vec::with_capacity(64);
        if !self.nodes.is_empty() {
            open.push(0u32);
        }
        while let Some(at) = open.pop() {
            let node = &self.nodes[at as usize];
            if node.min.cmpgt(max).any() || min.cmpgt(node.max).any() {
                continue;
            }
            if node.count == 0 {
                open.push(node.next);
                open.push(at + 1);
                continue;
            }
            for i in node.next as usize..(node.next + node.count) as usize {
                let [a, b, c] = self.corners[i];
                let apart = a.min(b).min(c).cmpgt(max) | min.cmpgt(a.max(b).max(c));
                if !apart.any() {
                    visit(self.order[i]);
                }
            }
        }
    }
}

/// Adds the nodes over some triangles, whose first one is at index `start` of the whole order.
fn build(boxes: &[[DVec3; 2]], order: &mut [u32], start: usize, nodes: &mut Vec<Node>) {
    let around = |list: &[u32]| {
        let empty = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        list.iter().fold(empty, |[low, high], &k| {
            let [min, max] = boxes[k as usize];
            [low.min(min), high.max(max)]
        })
    };
    let [min, max] = around(order);
    let at = nodes.len();
    nodes.push(Node {
        min,
        max,
        next: start as u32,
        count: order.len() as u32,
    });
    if order.len() <= LEAF {
        return;
    }
    let axis = (max - min).max_position();
    let middle = order.len() / 2;
    let center = |k: &u32| boxes[*k as usize][0][axis] + boxes[*k as usize][1][axis];
    order.select_nth_unstable_by(middle, |a, b| center(a).total_cmp(&center(b)));
    let (left, right) = order.split_at_mut(middle);
    build(boxes, left, start, nodes);
    let next = nodes.len() as u32;
    build(boxes, right, start + middle, nodes);
    (nodes[at].next, nodes[at].count) = (next, 0);
}

/// The barycentric coordinates of the point of a triangle that is nearest to a point (Ericson, *Real-Time Collision
/// Detection*, 5.1.5). Triangles without area have a nearest point too.
pub(super) fn nearest_on_triangle(point: DVec3, [a, b, c]: [DVec3; 3]) -> [f64; 3] {
    let (ab, ac, ap) = (b - a, c - a, point - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let bp = point - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let vc = d1 * d4 - d3 * d2;
    // d1 − d3 = |ab|², 0 where a and b are one point.
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 && d1 > d3 {
        let v = d1 / (d1 - d3);
        return [1.0 - v, v, 0.0];
    }
    let cp = point - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let w = d2 / (d2 - d6);
        return [1.0 - w, 0.0, w];
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return [0.0, 1.0 - w, w];
    }
    let sum = va + vb + vc;
    let (v, w) = (vb / sum, vc / sum);
    [1.0 - v - w, v, w]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn point() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1.0..1.0f64).prop_map(DVec3::from)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        /// The tree finds what a search of all triangles finds, and no sampled point of a triangle is nearer.
        #[test]
        fn nearest_points_are_nearest(
            corners in prop::collection::vec(prop::array::uniform3(point()), 1..40),
            from in point(),
        ) {
            let positions = corners.iter().flatten().map(|p| p.to_array()).collect();
            let faces = (0..corners.len() as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
            let mesh = TriangleMesh { positions, faces };
            let found = Bvh::new(&mesh).nearest(from, f64::INFINITY, |_| true).expect("a point");
            for [a, b, c] in corners {
                for i in 0..=8 {
                    for j in 0..=8 - i {
                        let (v, w) = (f64::from(i) / 8.0, f64::from(j) / 8.0);
                        let on = a * (1.0 - v - w) + b * v + c * w;
                        prop_assert!(found.squared_distance <= on.distance_squared(from) + 1e-12);
                    }
                }
            }
        }
    }
}
