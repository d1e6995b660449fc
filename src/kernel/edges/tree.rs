//! A tree over edges, from which one is drawn in proportion to an estimate of what it contributes: jump
//! times angle over distance times lobe. It is built from the top: eight parts of edges that are near to each
//! other, and so on.

use rayon::prelude::*;

use super::Edge;
use super::node::{Bounds, Leaf, Node};
use super::query::{EdgeList, Query, Query8};
use crate::accel::{F8, LANES, Lanes, Machine, Task, dispatch};
use crate::kernel::scene::KernelScene;
use crate::model::V3;
use crate::model::choice::Uniform;

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

impl EdgeTree {
    /// An edge, drawn in proportion to its weight, and one over its probability. None where there is none.
    ///
    /// Subtrees that are near or lie in the cone in part are entered, all of them; of those that are far
    /// and lie in it whole one is taken at random. Of all edges that it comes to one stays, so that no list
    /// is kept.
    pub fn sample(&self, arch: pulp::Arch, query: &Query, random: Uniform) -> Option<(u32, f32)> {
        dispatch(
            arch,
            Sample {
                tree: self,
                query,
                random,
            },
        )
    }

    #[inline(always)]
    fn draw<M: Machine>(
        &self,
        machine: M,
        query: &Query,
        mut random: Uniform,
    ) -> Option<(u32, f32)> {
        let query = &Query8::new(machine, query);
        let mut kept = Reservoir {
            total: 0.0,
            leaf: 0,
            weights: [0.0; LANES],
        };
        if self.nodes.is_empty() {
            for (i, leaf) in self.leaves.iter().enumerate() {
                kept.offer(i, leaf.weights(machine, query), 1.0, &mut random);
            }
        } else {
            let mut stack = [(0u32, 1.0f32); 64];
            let mut len = 1;
            let mut budget = BUDGET[usize::from(query.is_of_light)];
            let large = LARGE[usize::from(query.is_of_light)];
            while len > 0 {
                len -= 1;
                let (at, inverse) = stack[len];
                let index = at as usize / 2;
                if at % 2 == 1 {
                    let weights = self.leaves[index].weights(machine, query);
                    kept.offer(index, weights, inverse, &mut random);
                    continue;
                }
                let node = &self.nodes[index];
                let (weights, enter) = node.weights(machine, query, large);
                budget = budget.saturating_sub(1);
                let all = budget > 0 && len + LANES <= stack.len();
                let mut far = 0.0;
                let mut taken = None;
                #[allow(clippy::needless_range_loop)] // an iterator is not compiled for the machine
                for i in 0..LANES {
                    if weights[i] <= 0.0 {
                        continue;
                    }
                    if all && enter & (1 << i) != 0 {
                        stack[len] = (node.child[i], inverse);
                        len += 1;
                    } else {
                        far += weights[i];
                        let decision = random.decide(weights[i] / far);
                        random = decision.rest;
                        if decision.happens {
                            taken = Some(i);
                        }
                    }
                }
                if let Some(i) = taken {
                    stack[len] = (node.child[i], inverse * far / weights[i]);
                    len += 1;
                }
            }
        }
        kept.take(&self.leaves, random.number)
    }
}

/// [`EdgeTree::sample`] as a task.
struct Sample<'a> {
    tree: &'a EdgeTree,
    query: &'a Query,
    random: Uniform,
}

impl Task for Sample<'_> {
    type Output = Option<(u32, f32)>;

    #[inline(always)]
    fn run<M: Machine>(self, machine: M) -> Self::Output {
        self.tree.draw(machine, self.query, self.random)
    }
}

/// Nodes whose children are all entered, at most, and subtrees that are: those seen under a larger angle
/// (its sine). A light fills a narrow cone, in which few edges lie: they are looked at closely.
const BUDGET: [u32; 2] = [64, 1024];
const LARGE: [f32; 2] = [0.25, 0.015];

/// The leaf that stays, of all that were offered so far (weighted reservoir sampling).
struct Reservoir {
    total: f32,
    leaf: usize,
    weights: Lanes,
}

impl Reservoir {
    /// Offers a leaf that is come to with a probability, given by its inverse.
    #[inline(always)]
    fn offer<M: Machine>(
        &mut self,
        leaf: usize,
        weights: F8<M>,
        inverse: f32,
        random: &mut Uniform,
    ) {
        let sum = weights.sum();
        if sum <= 0.0 {
            return;
        }
        let share = sum * inverse;
        self.total += share;
        let decision = random.decide(share / self.total);
        *random = decision.rest;
        if decision.happens {
            self.leaf = leaf;
            self.weights = weights.lanes();
        }
    }

    #[inline(always)]
    fn take(self, leaves: &[Leaf], random: f32) -> Option<(u32, f32)> {
        if !(self.total > 0.0 && self.total.is_finite()) {
            return None;
        }
        let sum: f32 = self.weights.iter().sum();
        let target = random * sum;
        let (mut passed, mut found) = (0.0, None);
        for (i, &w) in self.weights.iter().enumerate() {
            if w > 0.0 {
                found = Some((leaves[self.leaf].edge[i], self.total / w));
                passed += w;
                if target < passed {
                    break;
                }
            }
        }
        found
    }
}
