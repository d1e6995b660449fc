//! The tree with eight boxes per node: made from a binary tree, and refitted to triangles that moved.

use glam::DVec3;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use rayon::prelude::*;

use super::simd::{LANES, Lanes};
use super::triangle::HostTriangle;
use super::wide::{Boxes, Leaf, Node, Wide};

impl Wide {
    pub fn new(triangles: &[HostTriangle], tree: Option<&Bvh2>) -> Self {
        let (extent, moves) = reach(triangles);
        let mut wide = Self {
            nodes: Vec::new(),
            leaves: Vec::new(),
            boxes: Vec::new(),
            grain: f32::INFINITY,
            velocities: moves.then(Vec::new),
            extent,
        };
        match tree {
            Some(tree) => {
                let mut counts = vec![0; tree.nodes.len()];
                count(tree, &mut counts);
                wide.collapse(triangles, tree, &counts, 0);
                wide.grain = grain(&wide.boxes);
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
        self.boxes.push(Boxes::new(triangles, list));
        if let Some(all) = &mut self.velocities {
            all.push(velocities(triangles, list));
        }
        2 * (self.leaves.len() as u32 - 1) + 1
    }

    /// Refits the tree to the triangles that `moved`.
    pub fn fit(&mut self, triangles: &[HostTriangle], moved: &[bool]) {
        let of_leaves = self.leaves.par_iter_mut().zip(&mut self.boxes);
        of_leaves.for_each(|(leaf, boxes)| {
            if leaf.list().iter().any(|&k| moved[k as usize]) {
                *leaf = Leaf::new(triangles, leaf.list());
                *boxes = Boxes::new(triangles, leaf.list());
            }
        });
        let (extent, moves) = reach(triangles);
        self.velocities = moves.then(|| {
            let leaves = self.leaves.par_iter();
            leaves.map(|l| velocities(triangles, l.list())).collect()
        });
        let mut of_nodes = vec![Aabb::INVALID; self.nodes.len()];
        // Children come after their parents.
        for (at, node) in self.nodes.iter_mut().enumerate().rev() {
            for slot in 0..node.count as usize {
                let child = node.child[slot] as usize;
                let own = if child % 2 == 1 {
                    self.boxes[child / 2].around()
                } else {
                    of_nodes[child / 2]
                };
                node.boxes.set(slot, &own);
                of_nodes[at] = of_nodes[at].union(&own);
            }
        }
        self.grain = grain(&self.boxes);
        self.extent = extent;
    }

    /// Returns Σ half areas of the boxes.
    pub fn cost(&self) -> f64 {
        let of_node = |n: &Node| {
            let half = |i: usize| {
                let [x, y, z] =
                    [0, 1, 2].map(|axis| f64::from(n.boxes.max[axis][i] - n.boxes.min[axis][i]));
                x * y + y * z + z * x
            };
            (0..n.count as usize).map(half).sum::<f64>()
        };
        self.nodes.iter().map(of_node).sum()
    }

    /// Adds the subtree of a node of a binary tree, and returns it as a child.
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
                // A leaf with more triangles than lanes cannot be opened.
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
            boxes: Boxes::NONE,
            child: [u32::MAX; LANES],
            count: children.len() as u32,
        });
        for (slot, child) in children.into_iter().enumerate() {
            let index = self.collapse(triangles, tree, counts, child);
            let node = &mut self.nodes[at];
            node.boxes.set(slot, tree.nodes[child].aabb());
            node.child[slot] = index;
        }
        2 * at as u32
    }
}

/// Returns the largest distance of a corner from the origin of coordinates, and whether any triangle moves over the
/// shutter.
fn reach(triangles: &[HostTriangle]) -> (f64, bool) {
    let of_triangle = |t: &HostTriangle| {
        let far = |c: DVec3| c.length_squared().max((c + t.velocity).length_squared());
        let far = t.corners.map(far).into_iter().fold(0.0, f64::max);
        (far, t.velocity != DVec3::ZERO)
    };
    let both = |a: (f64, bool), b: (f64, bool)| (a.0.max(b.0), a.1 || b.1);
    let (far, moves) = (triangles.par_iter().map(of_triangle)).reduce(|| (0.0, false), both);
    (far.sqrt(), moves)
}

/// Returns the median size of leaves, where a size is the root of half the area.
fn grain(boxes: &[Boxes]) -> f32 {
    let mut sizes: Vec<f32> = boxes
        .par_iter()
        .map(|b| b.around().half_area().sqrt())
        .collect();
    let middle = sizes.len() / 2;
    *sizes.select_nth_unstable_by(middle, f32::total_cmp).1
}

/// Returns the displacements of the triangles of a leaf.
fn velocities(triangles: &[HostTriangle], list: &[u32]) -> [Lanes; 3] {
    let mut all = [[0.0; LANES]; 3];
    for (i, &k) in list.iter().enumerate() {
        for (axis, lanes) in all.iter_mut().enumerate() {
            lanes[i] = triangles[k as usize].velocity[axis] as f32;
        }
    }
    all
}

/// Counts the triangles below each node.
fn count(tree: &Bvh2, counts: &mut [u32]) {
    // Children may come before their parents, so this uses a stack.
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

/// Collects the triangles below a node.
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
