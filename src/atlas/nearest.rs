//! The nearest points of triangles.

use glam::DVec3;

use super::surface::check;
use crate::error::{Error, Result};

/// The largest number of triangles in a leaf.
const LEAF: usize = 4;

/// The point of a mesh that is nearest to another point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// The face.
    pub face: u32,
    /// The barycentric coordinates of the point on the face.
    pub barycentric: [f64; 3],
    /// The distance.
    pub distance: f64,
}

/// Finds the nearest points of a mesh: a hierarchy of bounding boxes over its triangles, divided at the median
/// triangle along the longest side.
///
/// ```
/// use softray::atlas::NearestFaces;
/// let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
/// let faces = NearestFaces::new(&positions, &[[0, 1, 2]])?;
/// let nearest = faces.nearest([0.25, 0.25, 2.0]);
/// assert_eq!((nearest.face, nearest.distance), (0, 2.0));
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct NearestFaces {
    /// The triangles, in the order of the leaves.
    triangles: Vec<[DVec3; 3]>,
    /// The number of each triangle in the mesh.
    faces: Vec<u32>,
    nodes: Vec<Node>,
}

#[derive(Clone, Debug)]
struct Node {
    min: DVec3,
    max: DVec3,
    /// The range of the node's triangles.
    from: usize,
    to: usize,
    /// The index of the second child, 0 in a leaf; the first child follows its parent.
    second: usize,
}

impl NearestFaces {
    /// Builds the hierarchy.
    ///
    /// # Errors
    /// If there is no face, a position is not finite, or an index is out of range.
    pub fn new(positions: &[[f64; 3]], faces: &[[u32; 3]]) -> Result<Self> {
        check(positions, faces)?;
        Error::unless(!faces.is_empty(), "mesh", "faces", 0, "at least one")?;
        let triangle = |f: &[u32; 3]| f.map(|v| DVec3::from(positions[v as usize]));
        let triangles: Vec<[DVec3; 3]> = faces.iter().map(triangle).collect();
        let mut order: Vec<u32> = (0..faces.len() as u32).collect();
        let mut nodes = Vec::new();
        grow(&triangles, &mut order, 0, &mut nodes);
        Ok(Self {
            triangles: order.iter().map(|&f| triangles[f as usize]).collect(),
            faces: order,
            nodes,
        })
    }

    /// The point of the mesh nearest to `point`. If that is not finite, any point with an infinite distance.
    pub fn nearest(&self, point: [f64; 3]) -> Nearest {
        self.search(point, None)
    }

    /// The point nearest to `point` among faces whose normals are within 90° of `normal`, so that a point of one side
    /// of a thin wall finds none on the other. Among all faces if no face is.
    pub fn nearest_facing(&self, point: [f64; 3], normal: [f64; 3]) -> Nearest {
        let facing = self.search(point, Some(normal.into()));
        if facing.distance.is_finite() {
            facing
        } else {
            self.nearest(point)
        }
    }

    fn search(&self, point: [f64; 3], normal: Option<DVec3>) -> Nearest {
        let point = DVec3::from(point);
        let mut best = Nearest {
            face: self.faces[0],
            barycentric: [1.0, 0.0, 0.0],
            distance: f64::INFINITY,
        };
        self.visit(0, point, normal, &mut best);
        best
    }

    fn visit(&self, at: usize, point: DVec3, normal: Option<DVec3>, best: &mut Nearest) {
        let node = &self.nodes[at];
        if node.second == 0 {
            for k in node.from..node.to {
                let t = self.triangles[k];
                let front = normal.is_none_or(|n| (t[1] - t[0]).cross(t[2] - t[0]).dot(n) > 0.0);
                let (distance, barycentric) = nearest(t, point);
                if front && distance < best.distance {
                    *best = Nearest {
                        face: self.faces[k],
                        barycentric,
                        distance,
                    };
                }
            }
            return;
        }
        let to = |child: usize| (self.nodes[child].distance(point), child);
        let (first, second) = (to(at + 1), to(node.second));
        let ordered = if second.0 < first.0 {
            [second, first]
        } else {
            [first, second]
        };
        for (distance, child) in ordered {
            if distance < best.distance {
                self.visit(child, point, normal, best);
            }
        }
    }
}

impl Node {
    /// The distance of a point from the bounding box.
    fn distance(&self, p: DVec3) -> f64 {
        p.distance(p.clamp(self.min, self.max))
    }
}

/// Adds the nodes of the triangles `order`, whose first one is at place `from` in the order of the leaves.
fn grow(triangles: &[[DVec3; 3]], order: &mut [u32], from: usize, nodes: &mut Vec<Node>) {
    let at = nodes.len();
    let corners = order.iter().flat_map(|&f| triangles[f as usize]);
    let start = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (min, max) = corners.fold(start, |(min, max), p| (min.min(p), max.max(p)));
    nodes.push(Node {
        min,
        max,
        from,
        to: from + order.len(),
        second: 0,
    });
    if order.len() <= LEAF {
        return;
    }
    let axis = (max - min).max_position();
    let along = |f: u32| triangles[f as usize].iter().map(|p| p[axis]).sum::<f64>();
    let half = order.len() / 2;
    order.select_nth_unstable_by(half, |&a, &b| along(a).total_cmp(&along(b)));
    let (below, above) = order.split_at_mut(half);
    grow(triangles, below, from, nodes);
    nodes[at].second = nodes.len();
    grow(triangles, above, from + half, nodes);
}

/// The distance of a point from a triangle, and the barycentric coordinates of the nearest point: the point's
/// projection onto the plane, or the nearest point of an edge.
fn nearest(t: [DVec3; 3], p: DVec3) -> (f64, [f64; 3]) {
    let normal = (t[1] - t[0]).cross(t[2] - t[0]);
    let square = normal.length_squared();
    let part = |i: usize| {
        let (a, b) = (t[(i + 1) % 3], t[(i + 2) % 3]);
        (a - p).cross(b - p).dot(normal) / square
    };
    let inside = [0, 1, 2].map(part);
    if inside.iter().all(|b| *b >= 0.0) {
        let distance = (p - t[0]).dot(normal).abs() / square.sqrt();
        if distance.is_finite() {
            return (distance, inside);
        }
    }
    let mut best = (f64::INFINITY, [1.0, 0.0, 0.0]);
    for i in 0..3 {
        let (j, along) = ((i + 1) % 3, t[(i + 1) % 3] - t[i]);
        let part = (p - t[i]).dot(along) / along.length_squared();
        let part = if part.is_finite() {
            part.clamp(0.0, 1.0)
        } else {
            0.0
        };
        let distance = p.distance(t[i] + along * part);
        if distance < best.0 {
            let mut barycentric = [0.0; 3];
            barycentric[i] = 1.0 - part;
            barycentric[j] = part;
            best = (distance, barycentric);
        }
    }
    best
}
