//! The tree that GPUs traverse: nodes with two boxes each.

use std::ops::Range;

use glam::Vec3A;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use rayon::prelude::*;

use super::triangle::HostTriangle;

/// A tree of nodes that store the boxes of both children.
#[derive(Clone, Default)]
pub(crate) struct GpuTree {
    /// The root comes first, and children come after their parents.
    pub nodes: Vec<Node>,
    /// The indices of triangles, leaf by leaf.
    pub triangles: Vec<u32>,
    /// The largest number of nodes that a traversal must store.
    pub depth: usize,
}

/// Sixteen numbers, which a GPU loads by four. For each axis, these are the lower corners of both boxes and then the
/// upper ones. The bits of the next two numbers are the children, and the last two are unused.
type Node = [f32; 16];

/// The largest number of triangles in a leaf. A thread tests them one by one.
const OF_LEAF: usize = 4;
/// The first quadruple of numbers of a child that is a node, with the bit [`CHILD`]. For a leaf, it is its first
/// triangle, with the bits [`CHILD`] and [`LEAF`], and the number of its other triangles from bit [`OTHERS`] on.
type Child = u32;
/// Marks a child. As a float it is then a normal number, whose bits no device changes.
pub(crate) const CHILD: u32 = 1 << 30;
/// Marks a child that is a leaf.
pub(crate) const LEAF: u32 = 1 << 31;
pub(crate) const OTHERS: u32 = 28;
/// The place of the first child in a node.
const CHILDREN: usize = 12;

/// Returns the number of values of a triangle for intersection with rays.
pub(crate) const fn hit_stride(moves: bool) -> u32 {
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
        tree.fit(triangles, |_| true);
        tree
    }

    /// Refits the boxes to the triangles that `moved`.
    pub(super) fn fit(&mut self, triangles: &[HostTriangle], moved: impl Fn(u32) -> bool + Sync) {
        let list = &self.triangles;
        self.nodes.par_iter_mut().for_each(|node| {
            for side in 0..2 {
                let Some(range) = leaf(child(node, side)) else {
                    continue;
                };
                let leaf = &list[range];
                if leaf.iter().any(|&k| moved(k)) {
                    let boxes = leaf.iter().map(|&k| triangles[k as usize].swept());
                    set(node, side, boxes.fold(Aabb::INVALID, |a, b| a.union(&b)));
                }
            }
        });
        for index in (0..self.nodes.len()).rev() {
            for side in 0..2 {
                let below = child(&self.nodes[index], side);
                if below & LEAF == 0 {
                    let both = whole(&self.nodes[(below - CHILD) as usize / 4]);
                    set(&mut self.nodes[index], side, both);
                }
            }
        }
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

    /// Adds a node; its children and their boxes are set later.
    fn add_node(&mut self) -> usize {
        self.nodes.push([0.0; 16]);
        self.nodes.len() - 1
    }

    fn set_children(&mut self, index: usize, children: [Child; 2]) -> Child {
        let bits = children.map(f32::from_bits);
        self.nodes[index][CHILDREN..CHILDREN + 2].copy_from_slice(&bits);
        CHILD | (4 * index) as u32
    }
}

fn child(node: &Node, side: usize) -> Child {
    node[CHILDREN + side].to_bits()
}

/// Returns the triangles of a leaf, or `None` for a node.
fn leaf(child: Child) -> Option<Range<usize>> {
    let first = (child & ((1 << OTHERS) - 1)) as usize;
    let count = (child >> OTHERS & 3) as usize + 1;
    (child & LEAF != 0).then_some(first..first + count)
}

/// Sets the box of a node's child.
fn set(node: &mut Node, side: usize, aabb: Aabb) {
    for axis in 0..3 {
        node[4 * axis + side] = aabb.min[axis];
        node[4 * axis + 2 + side] = aabb.max[axis];
    }
}

/// Returns the box around both children of a node.
fn whole(node: &Node) -> Aabb {
    let corner = |at: usize| Vec3A::new(node[at], node[4 + at], node[8 + at]);
    Aabb::new(corner(0).min(corner(1)), corner(2).max(corner(3)))
}
