//! The tree that GPUs traverse: nodes with two boxes each. The device computes the boxes from vertices.

use std::ops::Range;

use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;

use super::triangle::HostTriangle;

/// The shape of a tree of nodes that store the boxes of both children. It stays the same while triangles move.
#[derive(Default)]
pub struct GpuTree {
    /// The children of each node. The root comes first, and a node is directly followed by all nodes below it.
    pub nodes: Vec<[Child; 2]>,
    /// The indices of triangles, leaf by leaf.
    pub triangles: Vec<u32>,
    /// The largest number of nodes that a traversal must store.
    pub depth: usize,
    pub parts: Parts,
}

/// The number of numbers of a node, which a GPU loads by four. For each axis, these are the centers of both boxes and
/// then half their extents. The bits of the next two numbers are the children, and the last two are unused.
pub const OF_NODE: u32 = 16;

/// Connected parts of a tree, for each of which one thread computes the nodes. They are ordered by levels: nodes of a
/// level depend only on nodes of the same part and of earlier levels.
#[derive(Default)]
pub struct Parts {
    /// All nodes, part by part, children before their parents.
    pub nodes: Vec<u32>,
    /// The place in `nodes` at which each part begins, and the end.
    pub starts: Vec<u32>,
    /// The first part of each level, and the end.
    pub levels: Vec<u32>,
}

/// The largest number of nodes in a part.
const OF_PART: u32 = 64;

/// The largest number of triangles in a leaf. A thread tests them one by one.
const OF_LEAF: usize = 3;
/// The first quadruple of numbers of a child that is a node, with the bit [`CHILD`]. For a leaf, it is its first
/// triangle, with the bits [`CHILD`] and [`LEAF`], and the number of its other triangles from bit [`OTHERS`] on.
pub type Child = u32;
/// Marks a child. As a float it is then a normal number, whose bits no device changes.
pub const CHILD: u32 = 1 << 30;
/// Marks a child that is a leaf.
pub const LEAF: u32 = 1 << 31;
pub const OTHERS: u32 = 28;
/// The place of the first child among the numbers of a node.
pub const CHILDREN: u32 = 12;

/// Returns the number of values of a triangle for intersection with rays.
pub const fn hit_stride(moves: bool) -> u32 {
    if moves { 20 } else { 16 }
}

impl GpuTree {
    /// Builds the tree from the nodes of a binary tree over triangles. Without a binary tree, for few triangles, there
    /// are no nodes.
    pub(super) fn new(built: Option<&Bvh2>, triangles: &[HostTriangle]) -> Self {
        let mut tree = Self::default();
        match built {
            Some(built) => {
                tree.triangles = built.primitive_indices.clone();
                tree.add(built, triangles, 0, 1);
            }
            None => tree.triangles = (0..triangles.len() as u32).collect(),
        }
        let node = |child: Child| (child & LEAF == 0).then_some((child - CHILD) as usize / 4);
        tree.parts = Parts::new(&tree.nodes, node);
        tree
    }

    fn add(&mut self, tree: &Bvh2, triangles: &[HostTriangle], at: usize, depth: usize) -> Child {
        let node = &tree.nodes[at];
        let first = node.first_index as usize;
        if node.is_leaf() {
            return self.add_leaf(triangles, first..first + node.prim_count as usize, depth);
        }
        let index = self.add_node();
        let children = [first, first + 1].map(|at| self.add(tree, triangles, at, depth + 1));
        self.set_children(index, children)
    }

    /// Adds a leaf of triangles. It is divided if it has too many.
    fn add_leaf(&mut self, triangles: &[HostTriangle], list: Range<usize>, depth: usize) -> Child {
        self.depth = self.depth.max(depth);
        if list.len() <= OF_LEAF {
            return LEAF | CHILD | ((list.len() as u32 - 1) << OTHERS) | list.start as u32;
        }
        let of = |k: &u32| triangles[*k as usize].swept();
        let all = &mut self.triangles[list.clone()];
        let centers = all.iter().map(|k| of(k).center());
        let centers = centers.fold(Aabb::INVALID, |mut all, center| *all.extend(center));
        let axis = centers.diagonal().max_position();
        all.sort_by(|a, b| of(a).center()[axis].total_cmp(&of(b).center()[axis]));
        let middle = list.start + list.len() / 2;
        let halves = [list.start..middle, middle..list.end];
        let index = self.add_node();
        let children = halves.map(|half| self.add_leaf(triangles, half, depth + 1));
        self.set_children(index, children)
    }

    /// Adds a node, whose children are set later.
    fn add_node(&mut self) -> usize {
        self.nodes.push([0; 2]);
        self.nodes.len() - 1
    }

    fn set_children(&mut self, index: usize, children: [Child; 2]) -> Child {
        self.nodes[index] = children;
        CHILD | (4 * index) as u32
    }
}

impl Parts {
    /// Divides a tree, given by the children of its nodes. A node is directly followed by all nodes below it. `node`
    /// returns the index of a child that is a node.
    pub fn new<const N: usize>(nodes: &[[u32; N]], node: impl Fn(u32) -> Option<usize>) -> Self {
        // Sums over each node and all nodes below it.
        let sums = |of_node: &dyn Fn(usize) -> u32| {
            let mut sums = vec![0; nodes.len()];
            for (at, children) in nodes.iter().enumerate().rev() {
                let inner = children.iter().filter_map(|&child| node(child));
                let below = inner.map(|child| sums[child]).sum::<u32>();
                sums[at] = of_node(at) + below;
            }
            sums
        };
        let sizes = sums(&|_| 1);
        let mut is_in_part = vec![false; nodes.len()];
        let mut this = Self {
            nodes: Vec::with_capacity(nodes.len()),
            starts: vec![0],
            levels: vec![0],
        };
        while this.nodes.len() < nodes.len() {
            let left = sums(&|at| u32::from(!is_in_part[at]));
            let mut at = 0;
            while at < nodes.len() {
                if left[at] > OF_PART {
                    at += 1;
                    continue;
                }
                let all = at..at + sizes[at] as usize;
                at = all.end;
                if left[all.start] > 0 {
                    let new = all.clone().rev().filter(|&k| !is_in_part[k]);
                    this.nodes.extend(new.map(|k| k as u32));
                    this.starts.push(this.nodes.len() as u32);
                    is_in_part[all].fill(true);
                }
            }
            this.levels.push(this.starts.len() as u32 - 1);
        }
        this
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::accel::Hierarchy;

    /// Each node is in one part, behind its children, or they are in a part of an earlier level.
    #[test]
    fn parts_have_all_nodes_after_their_children() {
        for count in [3, 200, 5000] {
            let triangle = |k: usize| {
                let at = DVec3::new((k as f64).sin(), (3.0 * k as f64).cos(), k as f64 / 1e3);
                let corners = [DVec3::ZERO, DVec3::X, DVec3::Y].map(|c| at + c * 0.01);
                HostTriangle::new(corners, DVec3::ZERO, true)
            };
            let tree = Hierarchy::new((0..count).map(triangle).collect(), None).for_gpu();
            let Parts {
                nodes,
                starts,
                levels,
            } = &tree.parts;
            let mut place = vec![None; tree.nodes.len()];
            for level in 0..levels.len() - 1 {
                for part in levels[level]..levels[level + 1] {
                    let of_part = starts[part as usize]..starts[part as usize + 1];
                    assert!(of_part.len() <= OF_PART as usize);
                    for k in of_part {
                        let node = nodes[k as usize] as usize;
                        for child in tree.nodes[node].iter().filter(|c| **c & LEAF == 0) {
                            let below = place[(child - CHILD) as usize / 4].expect("a place");
                            let (of_level, of_child): (usize, u32) = below;
                            assert!(of_level < level || of_child == part);
                        }
                        assert_eq!(place[node].replace((level, part)), None);
                    }
                }
            }
            assert!(place.iter().all(Option::is_some));
            assert_eq!(levels.len() > 2, tree.nodes.len() > OF_PART as usize);
        }
    }
}
