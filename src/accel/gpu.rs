//! The tree that GPUs traverse: nodes with two boxes each.

use std::ops::Range;

use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use rayon::prelude::*;

use super::triangle::HostTriangle;

/// A tree of nodes that store the boxes of both children. A child is the index of a node, or the bit 2³¹ with the index
/// of a leaf.
#[derive(Clone, Default)]
pub(crate) struct GpuTree {
    pub root: u32,
    /// The corners of the first and of the second child's box.
    pub boxes: Vec<[f32; 12]>,
    pub children: Vec<[u32; 2]>,
    /// The first triangle and the number of triangles of each leaf.
    pub leaves: Vec<[u32; 2]>,
    /// The indices of triangles, leaf by leaf.
    pub triangles: Vec<u32>,
    /// The largest number of nodes that a traversal must store.
    pub depth: usize,
}

/// The largest number of triangles in a leaf. A thread tests them one by one.
const OF_LEAF: usize = 4;
/// Marks a child that is a leaf.
pub(crate) const LEAF: u32 = 1 << 31;
/// The number of values of a triangle for intersection with rays.
pub(crate) const HIT_STRIDE: u32 = 20;

impl GpuTree {
    /// Builds the tree from the nodes of a binary tree over triangles. Without a binary tree, for few triangles, there
    /// are no nodes.
    pub(super) fn new(built: Option<&Bvh2>, triangles: &[HostTriangle]) -> Self {
        let mut tree = Self::default();
        match built {
            Some(built) => {
                tree.triangles = built.primitive_indices.clone();
                tree.root = tree.add(built, triangles, 0, 1);
            }
            None => tree.triangles = (0..triangles.len() as u32).collect(),
        }
        tree.fit(triangles);
        tree
    }

    /// Refits the boxes to triangles.
    pub(super) fn fit(&mut self, triangles: &[HostTriangle]) {
        let of_leaf = |&[first, count]: &[u32; 2]| {
            let list = &self.triangles[first as usize..][..count as usize];
            let boxes = list.iter().map(|&k| triangles[k as usize].swept());
            numbers(boxes.fold(Aabb::INVALID, |a, b| a.union(&b)))
        };
        let of_leaves: Vec<[f32; 6]> = self.leaves.par_iter().map(of_leaf).collect();
        // The children of a node come after it.
        for index in (0..self.boxes.len()).rev() {
            let of_child = self.children[index].map(|child| match child {
                LEAF.. => of_leaves[(child - LEAF) as usize],
                node => {
                    let both = &self.boxes[node as usize];
                    std::array::from_fn(|i| match i {
                        0..3 => both[i].min(both[i + 6]),
                        _ => both[i].max(both[i + 6]),
                    })
                }
            });
            self.boxes[index].copy_from_slice(of_child.as_flattened());
        }
    }

    fn add(&mut self, nodes: &Bvh2, triangles: &[HostTriangle], at: usize, depth: usize) -> u32 {
        let node = &nodes.nodes[at];
        let first = node.first_index as usize;
        if node.is_leaf() {
            return self.add_leaf(triangles, first..first + node.prim_count as usize, depth);
        }
        let children = [first, first + 1];
        let index = self.add_node();
        self.children[index] = children.map(|child| self.add(nodes, triangles, child, depth + 1));
        index as u32
    }

    /// Adds a leaf of triangles. It is divided if it has too many.
    fn add_leaf(&mut self, triangles: &[HostTriangle], list: Range<usize>, depth: usize) -> u32 {
        self.depth = self.depth.max(depth);
        if list.len() <= OF_LEAF {
            self.leaves.push([list.start as u32, list.len() as u32]);
            return LEAF | (self.leaves.len() as u32 - 1);
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
        self.children[index] = halves.map(|half| self.add_leaf(triangles, half, depth + 1));
        index as u32
    }

    /// Adds a node; its children and their boxes are set later.
    fn add_node(&mut self) -> usize {
        self.boxes.push([0.0; 12]);
        self.children.push([0; 2]);
        self.boxes.len() - 1
    }
}

/// Returns the corners of a box.
fn numbers(aabb: Aabb) -> [f32; 6] {
    let corners = [aabb.min.to_array(), aabb.max.to_array()];
    std::array::from_fn(|i| corners.as_flattened()[i])
}
