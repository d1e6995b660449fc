//! A tree over edges built from the top: eight parts of edges that are near to each other, and so on.

use rayon::prelude::*;

use super::edge_list::EdgeList;
use super::leaf::Leaf;
use super::node::{Bounds, Node};
use crate::accel::LANES;
use crate::kernel::edges::edge::Edge;
use crate::kernel::scene::KernelScene;
use crate::model::V3;

/// Up to so many edges are a list, each of which is weighed.
const FEW: usize = 64;
/// The least number of edges whose subtrees are built on several threads.
const MANY: usize = 2048;

/// A tree over edges, or a list of few.
pub(in crate::kernel) struct EdgeTree {
    pub(super) nodes: Vec<Node>,
    pub(super) leaves: Vec<Leaf>,
}

impl EdgeTree {
    const EMPTY: Self = Self {
        nodes: Vec::new(),
        leaves: Vec::new(),
    };

    /// A tree over some edges of a list.
    pub fn new(edges: &[Edge], scene: &KernelScene, mut which: Vec<u32>) -> Self {
        let source = EdgeList { edges, scene };
        if which.len() > FEW {
            return Self::of_parts(&source, &mut which);
        }
        let leaves = which.chunks(LANES).map(|list| Leaf::new(&source, list));
        Self {
            leaves: leaves.collect(),
            ..Self::EMPTY
        }
    }

    /// Subtrees of many edges on several threads, put together.
    fn of_parts(source: &EdgeList, which: &mut [u32]) -> Self {
        let mut tree = Self::EMPTY;
        if which.len() < MANY {
            tree.build(source, which);
            return tree;
        }
        let parts = parts(source, which).into_par_iter();
        let parts: Vec<(Bounds, Self)> = parts
            .map(|part| (Bounds::new(source, part), Self::of_parts(source, part)))
            .collect();
        tree.nodes.push(Node::empty());
        for (slot, (bounds, mut part)) in parts.into_iter().enumerate() {
            // A child is twice an index, plus one for leaves.
            let first = [2 * tree.nodes.len() as u32, 2 * tree.leaves.len() as u32];
            for node in &mut part.nodes {
                for child in node.child.iter_mut().filter(|c| **c != u32::MAX) {
                    *child += first[*child as usize % 2];
                }
            }
            tree.nodes[0].set(slot, &bounds, first[0]);
            tree.nodes.append(&mut part.nodes);
            tree.leaves.append(&mut part.leaves);
        }
        tree
    }

    pub fn is_empty(&self) -> bool {
        self.leaves.is_empty()
    }

    fn build(&mut self, source: &EdgeList, which: &mut [u32]) -> u32 {
        if which.len() <= LANES {
            self.leaves.push(Leaf::new(source, which));
            return 2 * (self.leaves.len() as u32 - 1) + 1;
        }
        let at = self.nodes.len();
        self.nodes.push(Node::empty());
        for (slot, part) in parts(source, which).into_iter().enumerate() {
            let bounds = Bounds::new(source, part);
            let child = self.build(source, part);
            self.nodes[at].set(slot, &bounds, child);
        }
        2 * at as u32
    }
}

/// Splits edges into up to eight parts, each of edges that are near to each other.
fn parts<'a>(source: &EdgeList, which: &'a mut [u32]) -> Vec<&'a mut [u32]> {
    let mut parts = vec![which];
    while parts.len() < LANES {
        let largest = (0..parts.len())
            .max_by_key(|&i| parts[i].len())
            .unwrap_or(0);
        if parts[largest].len() < 2 {
            break;
        }
        let part = parts.swap_remove(largest);
        let (left, right) = split(source, part);
        parts.push(left);
        parts.push(right);
    }
    parts
}

/// Halves edges along the axis in which their middles spread the most.
fn split<'a>(source: &EdgeList, part: &'a mut [u32]) -> (&'a mut [u32], &'a mut [u32]) {
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
    part.split_at_mut(half)
}
