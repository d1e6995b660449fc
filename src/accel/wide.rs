//! A tree of nodes with eight boxes and leaves with eight triangles.

use glam::DVec3;
use obvhs::bvh2::Bvh2;

use super::leaf::Leaf;
use super::simd::{LANES, Lanes};
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
