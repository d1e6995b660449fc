//! The tree as GPUs traverse it: nodes of two boxes.

use std::ops::Range;

use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use rayon::prelude::*;

use super::triangle::HostTriangle;

/// A tree of nodes with both children's boxes. A child is a node, or the bit 2³¹ and a leaf.
#[derive(Clone, Default)]
pub(crate) struct GpuTree {
    pub root: u32,
    /// Corners of the first and of the second child's box.
    pub boxes: Vec<[f32; 12]>,
    pub children: Vec<[u32; 2]>,
    /// First and number of triangles of each leaf.
    pub leaves: Vec<[u32; 2]>,
    /// Numbers of triangles, leaf by leaf.
    pub triangles: Vec<u32>,
    /// Nodes that a traversal has to remember at most.
    pub depth: usize,
}

/// Triangles of a leaf at most: a thread meets them one by one.
const OF_LEAF: usize = 4;
/// A child that is a leaf.
pub(crate) const LEAF: u32 = 1 << 31;
/// Numbers of a triangle as rays meet it.
pub(crate) const HIT_STRIDE: u32 = 20;

impl GpuTree {
    /// Of triangles, with the nodes of a binary tree over them; without nodes where they are few.
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

    /// Fits boxes to triangles.
    pub(super) fn fit(&mut self, triangles: &[HostTriangle]) {
        let of_leaf = |&[first, count]: &[u32; 2]| {
            let list = &self.triangles[first as usize..][..count as usize];
            let boxes = list.iter().map(|&k| triangles[k as usize].swept());
            numbers(boxes.fold(Aabb::INVALID, |a, b| a.union(&b)))
        };
        let of_leaves: Vec<[f32; 6]> = self.leaves.par_iter().map(of_leaf).collect();
        // Children of a node come behind it.
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

    /// Adds triangles of a leaf, which is divided where it has many.
    fn add_leaf(&mut self, triangles: &[HostTriangle], list: Range<usize>, depth: usize) -> u32 {
        self.depth = self.depth.max(depth);
        if list.len() <= OF_LEAF {
            self.leaves.push([list.start as u32, list.len() as u32]);
            return LEAF | (self.leaves.len() as u32 - 1);
        }
        let of = |k: &u32| triangles[*k as usize].swept();
        let all = &mut self.triangles[list.clone()];
        let centres = all.iter().map(|k| of(k).center());
        let centres = centres.fold(Aabb::INVALID, |mut all, centre| *all.extend(centre));
        let axis = centres.diagonal().max_position();
        all.sort_by(|a, b| of(a).center()[axis].total_cmp(&of(b).center()[axis]));
        let middle = list.start + list.len() / 2;
        let halves = [list.start..middle, middle..list.end];
        let index = self.add_node();
        self.children[index] = halves.map(|half| self.add_leaf(triangles, half, depth + 1));
        index as u32
    }

    /// Adds a node without its children and their boxes.
    fn add_node(&mut self) -> usize {
        self.boxes.push([0.0; 12]);
        self.children.push([0; 2]);
        self.boxes.len() - 1
    }
}

/// The corners of a box.
fn numbers(aabb: Aabb) -> [f32; 6] {
    let corners = [aabb.min.to_array(), aabb.max.to_array()];
    std::array::from_fn(|i| corners.as_flattened()[i])
}
