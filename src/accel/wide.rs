//! A tree of nodes with eight boxes and leaves with eight triangles.

use glam::{DVec3, Vec3};
use obvhs::bvh2::Bvh2;

use super::simd::{LANES, Lanes, Machine};
use super::triangle::HostTriangle;

/// Up to so many triangles are tested without boxes.
pub(super) const FEW: usize = 64;

/// Boxes of up to eight children.
pub(super) struct Node {
    pub min: [Lanes; 3],
    pub max: [Lanes; 3],
    /// Twice the index of a node, or of a leaf plus one.
    pub child: [u32; LANES],
    /// The number of children.
    pub count: u32,
}

/// The tree.
pub(super) struct Wide {
    pub nodes: Vec<Node>,
    pub leaves: Vec<Leaf>,
    /// Displacements over the shutter of the triangles of each leaf, if any moves.
    pub velocities: Option<Vec<[Lanes; 3]>>,
    /// The largest distance of a corner from the origin of coordinates.
    pub extent: f64,
}

impl Wide {
    pub fn new(triangles: &[HostTriangle], tree: Option<&Bvh2>, extent: f64) -> Self {
        let moves = triangles.iter().any(|t| t.velocity != DVec3::ZERO);
        let mut wide = Self {
            nodes: Vec::new(),
            leaves: Vec::new(),
            velocities: moves.then(Vec::new),
            extent,
        };
        match tree {
            Some(tree) => {
                let mut counts = vec![0; tree.nodes.len()];
                count(tree, &mut counts);
                wide.collapse(triangles, tree, &counts, 0);
            }
            None => {
                for k in (0..triangles.len() as u32).step_by(LANES) {
                    let past = (k + LANES as u32).min(triangles.len() as u32);
                    let list: Vec<u32> = (k..past).collect();
                    wide.leaf(triangles, &list);
                }
            }
        }
        wide
    }

    fn leaf(&mut self, triangles: &[HostTriangle], list: &[u32]) -> u32 {
        self.leaves.push(Leaf::new(triangles, list));
        if let Some(velocities) = &mut self.velocities {
            let mut velocity = [[0.0; LANES]; 3];
            for (i, &k) in list.iter().enumerate() {
                for (axis, lanes) in velocity.iter_mut().enumerate() {
                    lanes[i] = triangles[k as usize].velocity[axis] as f32;
                }
            }
            velocities.push(velocity);
        }
        2 * (self.leaves.len() as u32 - 1) + 1
    }

    /// The subtree of a node of a binary tree.
    fn collapse(
        &mut self,
        triangles: &[HostTriangle],
        tree: &Bvh2,
        counts: &[u32],
        root: usize,
    ) -> u32 {
        if counts[root] <= LANES as u32 {
            let mut list = Vec::new();
            gather(tree, root, &mut list);
            return self.leaf(triangles, &list);
        }
        let mut children = vec![root];
        while children.len() < LANES {
            let area = |&i: &usize| tree.nodes[i].aabb().half_area();
            let inner = (0..children.len()).filter(|&c| {
                let i = children[c];
                // A leaf with more triangles than lanes can't be opened.
                !tree.nodes[i].is_leaf() && counts[i] > LANES as u32
            });
            let largest = inner.max_by(|&a, &b| area(&children[a]).total_cmp(&area(&children[b])));
            let Some(c) = largest else {
                break;
            };
            let first = tree.nodes[children[c]].first_index as usize;
            children[c] = first;
            children.push(first + 1);
        }
        let at = self.nodes.len();
        self.nodes.push(Node {
            min: [[0.0; LANES]; 3],
            max: [[0.0; LANES]; 3],
            child: [u32::MAX; LANES],
            count: children.len() as u32,
        });
        for (slot, child) in children.into_iter().enumerate() {
            let aabb = tree.nodes[child].aabb();
            let (min, max) = (aabb.min, aabb.max);
            let index = self.collapse(triangles, tree, counts, child);
            let node = &mut self.nodes[at];
            for axis in 0..3 {
                node.min[axis][slot] = min[axis];
                node.max[axis][slot] = max[axis];
            }
            node.child[slot] = index;
        }
        2 * at as u32
    }
}

impl Node {
    /// Puts some children (one bit each, at least one) on a stack with room for them: the nearest on top,
    /// the others below it in any order. Without jumps.
    #[inline(always)]
    pub fn stack_children(
        &self,
        mut mask: u32,
        nears: &Lanes,
        stack: &mut [(u32, f32)],
        len: &mut usize,
    ) {
        let child = |i: u32| {
            let i = i as usize % LANES;
            (self.child[i], nears[i])
        };
        let mut nearest = child(mask.trailing_zeros());
        mask &= mask - 1;
        while mask != 0 {
            let other = child(mask.trailing_zeros());
            mask &= mask - 1;
            let less = other.1 < nearest.1;
            stack[*len] = if less { nearest } else { other };
            nearest = if less { other } else { nearest };
            *len += 1;
        }
        stack[*len] = nearest;
        *len += 1;
    }
}

#[inline(always)]
pub(super) fn safe_inverse(d: f64) -> f32 {
    let d = if d.abs() < 1e-12 {
        1e-12f64.copysign(d)
    } else {
        d
    };
    1.0 / d as f32
}

/// Triangles under each node.
fn count(tree: &Bvh2, counts: &mut [u32]) {
    // Children come after their parents or not: by hand, from a stack.
    let mut stack = vec![(0usize, false)];
    while let Some((i, ready)) = stack.pop() {
        let node = &tree.nodes[i];
        if node.is_leaf() {
            counts[i] = node.prim_count;
            continue;
        }
        let first = node.first_index as usize;
        if ready {
            counts[i] = counts[first] + counts[first + 1];
        } else {
            stack.extend([(i, true), (first, false), (first + 1, false)]);
        }
    }
}

/// The triangles under a node.
fn gather(tree: &Bvh2, root: usize, list: &mut Vec<u32>) {
    let node = &tree.nodes[root];
    let first = node.first_index as usize;
    if node.is_leaf() {
        list.extend(&tree.primitive_indices[first..first + node.prim_count as usize]);
    } else {
        gather(tree, first, list);
        gather(tree, first + 1, list);
    }
}

/// Up to eight triangles: planes, and in each the lines of the borders as distances, positive inside.
pub(super) struct Leaf {
    pub(super) normal: [Lanes; 3],
    pub(super) plane: Lanes,
    /// a → b, b → c, c → a: directions, and what is added.
    pub(super) lines: [[Lanes; 3]; 3],
    pub(super) offsets: [Lanes; 3],
    pub triangle: [u32; LANES],
    /// The rounding of the lines, beyond that of points.
    pub(super) slack: Lanes,
    /// The triangles that there are, one bit each.
    used: u32,
}

/// Triangles are grown by this share of the largest coordinate near the ray.
pub(super) const ROUNDING: f32 = 4e-7;

/// Hits close to a ray's origin are rounded by this share of [`Ray::rounding`].
const NEAR: f32 = 0.4;

/// A ray in f32, from a point near the triangles.
pub(super) struct Ray {
    pub origin: Vec3,
    pub direction: Vec3,
    pub time: f32,
    /// The largest distance beside it at which triangles matter.
    pub reach: f32,
    /// The distance along it that a squared distance beside it counts as ([`Reach`](super::Reach)).
    pub distance_penalty: f32,
    /// The rounding of coordinates: 33 half units in the last place of the largest.
    pub rounding: f32,
    /// Hits nearer don't count.
    pub from: f32,
}

impl Leaf {
    pub fn new(triangles: &[HostTriangle], list: &[u32]) -> Self {
        let mut leaf = Self {
            normal: [[0.0; LANES]; 3],
            plane: [0.0; LANES],
            lines: [[[0.0; LANES]; 3]; 3],
            offsets: [[0.0; LANES]; 3],
            triangle: [u32::MAX; LANES],
            slack: [0.0; LANES],
            used: (1 << list.len()) - 1,
        };
        for (i, &k) in list.iter().enumerate() {
            let t = &triangles[k as usize];
            leaf.plane[i] = t.normal.dot(t.corners[0]) as f32;
            for (axis, lanes) in leaf.normal.iter_mut().enumerate() {
                lanes[i] = t.normal[axis] as f32;
            }
            for (line, (across, offset)) in t.lines_in_space().into_iter().enumerate() {
                leaf.offsets[line][i] = offset as f32;
                leaf.slack[i] = leaf.slack[i].max(ROUNDING * offset.abs() as f32);
                for (axis, lanes) in leaf.lines[line].iter_mut().enumerate() {
                    lanes[i] = across[axis] as f32;
                }
            }
            leaf.triangle[i] = k;
        }
        leaf
    }

    /// The triangles that a ray may hit before `limit`, one bit each, and distances before which it
    /// doesn't, with what it passes beside them.
    #[inline(always)]
    pub fn test<M: Machine>(
        &self,
        machine: M,
        velocity: Option<&[Lanes; 3]>,
        ray: &Ray,
        limit: f32,
    ) -> (u32, Lanes) {
        let add = |sum: f32, a: f32, b: f32| {
            if M::FUSED {
                a.mul_add(b, sum)
            } else {
                a * b + sum
            }
        };
        // Written out: the compiler does not see through closures over arrays in a loop over lanes.
        macro_rules! inside {
            ($line:literal, $i:ident, $p:ident) => {{
                let [x, y, z] = &self.lines[$line];
                let first = add(self.offsets[$line][$i], x[$i], $p[0]);
                add(add(first, y[$i], $p[1]), z[$i], $p[2])
            }};
        }
        let d = ray.direction.to_array();
        let mut o = ray.origin.to_array().map(|x| [x; LANES]);
        if let Some(velocity) = velocity {
            for (o, v) in o.iter_mut().zip(velocity) {
                for i in 0..LANES {
                    o[i] -= v[i] * ray.time;
                }
            }
        }
        let mut room = [0.0; LANES];
        let mut near = [0.0; LANES];
        for i in 0..LANES {
            let n = [self.normal[0][i], self.normal[1][i], self.normal[2][i]];
            let cosine = add(add(n[0] * d[0], n[1], d[1]), n[2], d[2]);
            let inverse = 1.0 / cosine;
            let above = add(self.plane[i], -n[0], o[0][i]);
            let t = add(add(above, -n[1], o[1][i]), -n[2], o[2][i]) * inverse;
            let p = [
                add(o[0][i], t, d[0]),
                add(o[1][i], t, d[1]),
                add(o[2][i], t, d[2]),
            ];
            let ab = inside!(0, i, p);
            let bc = inside!(1, i, p);
            let ca = inside!(2, i, p);
            let least = smaller(ab, smaller(bc, ca));
            let rounding = add(ray.rounding, ray.rounding, inverse.abs());
            let beside = smaller(least + rounding, 0.0);
            let counted = add(t - rounding, beside * ray.distance_penalty, beside);
            // Not a number is kept, and first: the exact test decides.
            near[i] = larger(counted, f32::MIN);
            let between = smaller(add(t, NEAR, rounding) - ray.from, limit - near[i]);
            room[i] = smaller(between, beside + ray.reach);
        }
        let mask = machine.not_negative(&room) & self.used;
        (mask, near)
    }
}

#[inline(always)]
pub(super) fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
pub(super) fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}
