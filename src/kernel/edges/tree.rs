//! A tree over edges, built from the top: eight parts of edges that are near to each other, and so on.

use rayon::prelude::*;

use super::bounds::{Bounds, EdgeList};
use super::draw::{LEAF, NODE, Root};
use crate::accel::{LANES, eights};
use crate::model::V3;

/// Up to so many edges are a list, each of which is weighed.
const FEW: usize = 64;
/// The least number of edges whose subtrees are built on several threads.
const MANY: usize = 2048;

/// A tree over edges, or a list of few: what a [`Root`] reads.
pub(super) struct EdgeTree {
    nodes: Vec<f32>,
    children: Vec<u32>,
    leaves: Vec<f32>,
    edges: Vec<u32>,
    moves: bool,
}

impl EdgeTree {
    /// A tree over some edges of a list.
    pub fn new(source: &EdgeList, mut which: Vec<u32>) -> Self {
        let shape = if Self::is_list(&which) {
            Shape {
                leaves: which.chunks(LANES).map(<[u32]>::len).collect(),
                ..Shape::EMPTY
            }
        } else {
            Shape::of(source, &mut which)
        };
        Self::shaped(source, &which, &shape)
    }

    /// Whether so few edges are a list, not a tree.
    pub fn is_list(which: &[u32]) -> bool {
        which.len() <= FEW
    }

    /// A tree over some edges, not a list, and others, in which the tree over the first alone begins at node 1.
    pub fn joint(source: &EdgeList, mut first: Vec<u32>, mut others: Vec<u32>) -> Self {
        let parts = [
            Shape::of(source, &mut first),
            Shape::of(source, &mut others),
        ];
        first.append(&mut others);
        Self::shaped(source, &first, &Shape::join(parts))
    }

    /// A tree of a shape, over edges in its order.
    fn shaped(source: &EdgeList, which: &[u32], shape: &Shape) -> Self {
        let mut past = 0;
        let lists = shape.leaves.iter().map(|&count| {
            past += count;
            &which[past - count..past]
        });
        let lists: Vec<&[u32]> = lists.collect();
        let mut leaves = vec![0.0; LANES * LEAF * lists.len()];
        let mut edges = vec![u32::MAX; LANES * lists.len()];
        let blocks = leaves.par_chunks_mut(LANES * LEAF);
        let blocks = blocks.zip(edges.par_chunks_mut(LANES)).zip(&lists);
        let of_leaves = blocks.map(|((block, edges), list)| {
            edges[..list.len()].copy_from_slice(list);
            for (i, &index) in list.iter().enumerate() {
                let velocity = source.velocity(&source.edges[index as usize]);
                eights::set(block, i, source.seen(index).numbers(velocity));
            }
            Bounds::new(source, list)
        });
        let of_leaves: Vec<Bounds> = of_leaves.collect();
        let mut nodes = vec![0.0; LANES * NODE * shape.nodes.len()];
        let mut of_nodes: Vec<Option<Bounds>> = vec![None; shape.nodes.len()];
        let mut parts = Vec::with_capacity(LANES);
        // Children come after their parents.
        let blocks = nodes.chunks_mut(LANES * NODE).zip(&shape.nodes);
        for (at, (block, children)) in blocks.enumerate().rev() {
            parts.clear();
            for (i, &child) in children.iter().enumerate().filter(|(_, c)| **c != u32::MAX) {
                let index = child as usize / 2;
                let own = if child % 2 == 1 {
                    Some(of_leaves[index])
                } else {
                    of_nodes[index]
                };
                if let Some(own) = own {
                    eights::set(block, i, own.subtree().numbers());
                    parts.push(own);
                }
            }
            of_nodes[at] = Some(Bounds::joined(&parts));
        }
        Self {
            nodes,
            children: shape.nodes.concat(),
            leaves,
            edges,
            moves: source.scene.velocities.is_some(),
        }
    }

    pub fn is_empty(&self) -> bool {
        self.edges.is_empty()
    }

    /// The part of it under a node, or all of a list.
    pub fn root(&self, node: u32) -> Root<'_> {
        let is_list = self.nodes.is_empty();
        Root {
            nodes: &self.nodes,
            children: &self.children,
            leaves: &self.leaves,
            edges: &self.edges,
            start: if is_list { 1 } else { 2 * node },
            count: if is_list {
                (self.edges.len() / LANES) as u32
            } else {
                1
            },
            has_nodes: !is_list,
            moves: self.moves,
        }
    }
}

/// Which nodes have which children, in a tree over edges that were put in the order of its leaves.
struct Shape {
    /// Children: twice the index of a node, or of a leaf plus one.
    nodes: Vec<[u32; LANES]>,
    /// The numbers of edges of the leaves.
    leaves: Vec<usize>,
}

impl Shape {
    const EMPTY: Self = Self {
        nodes: Vec::new(),
        leaves: Vec::new(),
    };

    /// Puts edges in order; subtrees of many on several threads.
    fn of(source: &EdgeList, which: &mut [u32]) -> Self {
        if which.len() < MANY {
            let mut shape = Self::EMPTY;
            shape.build(source, which);
            return shape;
        }
        let parts = parts(source, which).into_par_iter();
        let parts: Vec<Self> = parts.map(|part| Self::of(source, part)).collect();
        Self::join(parts)
    }

    /// Up to eight under one node, which is the first.
    fn join(parts: impl IntoIterator<Item = Self>) -> Self {
        let mut shape = Self::EMPTY;
        shape.nodes.push([u32::MAX; LANES]);
        for (slot, mut part) in parts.into_iter().enumerate() {
            let first = [2 * shape.nodes.len() as u32, 2 * shape.leaves.len() as u32];
            let children = part.nodes.as_flattened_mut().iter_mut();
            for child in children.filter(|c| **c != u32::MAX) {
                *child += first[*child as usize % 2];
            }
            shape.nodes[0][slot] = if part.nodes.is_empty() {
                first[1] + 1
            } else {
                first[0]
            };
            shape.nodes.append(&mut part.nodes);
            shape.leaves.append(&mut part.leaves);
        }
        shape
    }

    fn build(&mut self, source: &EdgeList, which: &mut [u32]) -> u32 {
        if which.len() <= LANES {
            self.leaves.push(which.len());
            return 2 * (self.leaves.len() as u32 - 1) + 1;
        }
        let at = self.nodes.len();
        self.nodes.push([u32::MAX; LANES]);
        for (slot, part) in parts(source, which).into_iter().enumerate() {
            self.nodes[at][slot] = self.build(source, part);
        }
        2 * at as u32
    }
}

/// Splits edges into up to eight parts, each of edges that are near to each other.
fn parts<'a>(source: &EdgeList, which: &'a mut [u32]) -> Vec<&'a mut [u32]> {
    eights::parts(which, |part| part.len() as f32, |part| split(source, part))
}

/// Halves edges along the axis in which their middles spread the most.
fn split<'a>(source: &EdgeList, part: &'a mut [u32]) -> [&'a mut [u32]; 2] {
    let (mut low, mut high) = (V3::ONE * f32::MAX, V3::ONE * f32::MIN);
    for &i in part.iter() {
        let m = source.middle(i);
        low = low.min(m);
        high = high.max(m);
    }
    let size = (high - low).to_array();
    let axis = (0..3)
        .max_by(|&a, &b| size[a].total_cmp(&size[b]))
        .unwrap_or(0);
    let half = part.len() / 2;
    part.select_nth_unstable_by(half, |&a, &b| {
        let (p, q) = (source.middle(a).to_array(), source.middle(b).to_array());
        p[axis].total_cmp(&q[axis]).then(a.cmp(&b))
    });
    part.split_at_mut(half).into()
}
