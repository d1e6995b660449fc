//! A tree over edges, built from the top: eight parts of edges that are near to each other, and so on.

use rayon::prelude::*;

use super::bounds::{Bounds, EdgeList};
use super::draw::{LEAF, NODE, Root};
use crate::accel::LANES;
use crate::accel::eights::{Divide, NONE, Shape, set};
use crate::model::V3;

/// Up to so many edges are a list, each of which is weighed.
const FEW: usize = 64;

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
            let leaves = (0..which.len()).step_by(LANES);
            Shape {
                leaves: leaves.map(|i| i..which.len().min(i + LANES)).collect(),
                ..Shape::default()
            }
        } else {
            Shape::of(0, &mut which, source)
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
            Shape::of(0, &mut first, source),
            Shape::of(first.len(), &mut others, source),
        ];
        first.append(&mut others);
        Self::shaped(source, &first, &Shape::join(parts))
    }

    /// A tree of a shape, over edges in its order.
    fn shaped(source: &EdgeList, which: &[u32], shape: &Shape) -> Self {
        let mut leaves = vec![0.0; LANES * LEAF * shape.leaves.len()];
        let mut edges = vec![NONE; LANES * shape.leaves.len()];
        let blocks = leaves.par_chunks_mut(LANES * LEAF);
        let blocks = blocks.zip(edges.par_chunks_mut(LANES)).zip(&shape.leaves);
        let of_leaves = blocks.map(|((block, edges), list)| {
            let list = &which[list.clone()];
            edges[..list.len()].copy_from_slice(list);
            for (i, &index) in list.iter().enumerate() {
                let velocity = source.velocity(&source.edges[index as usize]);
                set(block, i, source.seen(index).numbers(velocity));
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
            for (i, &child) in children.iter().enumerate().filter(|(_, c)| **c != NONE) {
                let index = child as usize / 2;
                let own = if child % 2 == 1 {
                    Some(of_leaves[index])
                } else {
                    of_nodes[index]
                };
                if let Some(own) = own {
                    set(block, i, own.subtree().numbers());
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

impl Divide<u32> for EdgeList<'_> {
    fn is_leaf(&self, list: &[u32]) -> bool {
        list.len() <= LANES
    }

    fn cost(&self, list: &[u32]) -> f32 {
        list.len() as f32
    }

    /// Halves edges along the axis in which their middles spread the most.
    fn split<'a>(&self, part: &'a mut [u32]) -> [&'a mut [u32]; 2] {
        let (mut low, mut high) = (V3::ONE * f32::MAX, V3::ONE * f32::MIN);
        for &i in part.iter() {
            let m = self.middle(i);
            low = low.min(m);
            high = high.max(m);
        }
        let size = (high - low).to_array();
        let axis = (0..3)
            .max_by(|&a, &b| size[a].total_cmp(&size[b]))
            .unwrap_or(0);
        let half = part.len() / 2;
        part.select_nth_unstable_by(half, |&a, &b| {
            let (p, q) = (self.middle(a).to_array(), self.middle(b).to_array());
            p[axis].total_cmp(&q[axis]).then(a.cmp(&b))
        });
        part.split_at_mut(half).into()
    }
}
