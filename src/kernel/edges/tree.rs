//! A tree over edges, from which one is drawn in proportion to an estimate of what it contributes: jump
//! times angle over distance times lobe. It is built from the top: eight parts of edges that are near to each
//! other, and so on.

use rayon::prelude::*;

use super::bounds::Bounds;
use super::node::{Leaf, Node};
use super::query::{EdgeList, Query, Query8};
use crate::accel::{F8, LANES, Lanes, Machine, Task, dispatch};
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
    pub(super) fn new(source: &EdgeList, mut which: Vec<u32>) -> Self {
        if !Self::is_list(&which) {
            let shape = Shape::of(source, &mut which);
            return Self::shaped(source, &which, shape);
        }
        let leaves = which.chunks(LANES).map(|list| Leaf::new(source, list));
        Self {
            leaves: leaves.collect(),
            ..Self::EMPTY
        }
    }

    /// Whether so few edges are a list, not a tree.
    pub(super) fn is_list(which: &[u32]) -> bool {
        which.len() <= FEW
    }

    /// A tree over some edges, not a list, and others, in which the tree over the first alone begins at node 1 and leaf
    /// 0; and the nodes and leaves of that.
    pub(super) fn joint(
        source: &EdgeList,
        mut first: Vec<u32>,
        mut others: Vec<u32>,
    ) -> (Self, [usize; 2]) {
        let parts = [
            Shape::of(source, &mut first),
            Shape::of(source, &mut others),
        ];
        let size = [parts[0].nodes.len(), parts[0].leaves.len()];
        first.append(&mut others);
        (Self::shaped(source, &first, Shape::join(parts)), size)
    }

    /// A tree of a shape, over edges in its order.
    fn shaped(source: &EdgeList, which: &[u32], shape: Shape) -> Self {
        let mut past = 0;
        let lists = shape.leaves.iter().map(|&count| {
            past += count;
            &which[past - count..past]
        });
        let lists: Vec<&[u32]> = lists.collect();
        let leaf = |list: &&[u32]| (Leaf::new(source, list), Bounds::new(source, list));
        let (leaves, of_leaves): (Vec<Leaf>, Vec<Bounds>) = lists.par_iter().map(leaf).unzip();
        let mut of_nodes: Vec<Option<Bounds>> = vec![None; shape.nodes.len()];
        let mut nodes = shape.nodes;
        let mut parts = Vec::with_capacity(LANES);
        // Children come after their parents.
        for (at, node) in nodes.iter_mut().enumerate().rev() {
            parts.clear();
            for slot in 0..LANES {
                let child = node.child[slot];
                if child == u32::MAX {
                    continue;
                }
                let index = child as usize / 2;
                let own = if child % 2 == 1 {
                    of_leaves.get(index)
                } else {
                    of_nodes[index].as_ref()
                };
                if let Some(own) = own {
                    node.set(slot, own);
                    parts.push(*own);
                }
            }
            of_nodes[at] = Some(Bounds::joined(&parts));
        }
        Self { nodes, leaves }
    }

    pub fn is_empty(&self) -> bool {
        self.leaves.is_empty()
    }
}

/// Which nodes have which children, in a tree over edges that were put in the order of its leaves.
struct Shape {
    /// Without bounds.
    nodes: Vec<Node>,
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
        shape.nodes.push(Node::empty());
        for (slot, mut part) in parts.into_iter().enumerate() {
            // A child is twice an index, plus one for leaves.
            let first = [2 * shape.nodes.len() as u32, 2 * shape.leaves.len() as u32];
            for node in &mut part.nodes {
                for child in node.child.iter_mut().filter(|c| **c != u32::MAX) {
                    *child += first[*child as usize % 2];
                }
            }
            shape.nodes[0].child[slot] = if part.nodes.is_empty() {
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
        self.nodes.push(Node::empty());
        for (slot, part) in parts(source, which).into_iter().enumerate() {
            self.nodes[at].child[slot] = self.build(source, part);
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

/// A tree, or the part of it under a node.
#[derive(Clone, Copy)]
pub(in crate::kernel) struct Root<'a> {
    pub tree: &'a EdgeTree,
    pub node: u32,
}

impl Root<'_> {
    pub fn is_empty(&self) -> bool {
        self.tree.is_empty()
    }

    /// An edge, drawn in proportion to its weight, and one over its probability. None where there is none.
    ///
    /// Subtrees that are near or lie in the cone in part are entered, all of them; of those that are far
    /// and lie in it whole one is taken at random. Of all edges that it comes to one stays, so that no list
    /// is kept.
    pub fn sample(&self, arch: pulp::Arch, query: &Query, random: Uniform) -> Option<(u32, f32)> {
        dispatch(
            arch,
            Sample {
                root: *self,
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
        let EdgeTree { nodes, leaves } = self.tree;
        let mut kept = Reservoir {
            total: 0.0,
            leaf: 0,
            weights: [0.0; LANES],
        };
        if nodes.is_empty() {
            for (i, leaf) in leaves.iter().enumerate() {
                kept.offer(i, leaf.weights(machine, query), 1.0, &mut random);
            }
        } else {
            let mut stack = [(2 * self.node, 1.0f32); 64];
            let mut len = 1;
            let mut budget = BUDGET[usize::from(query.is_of_light)];
            let large = LARGE[usize::from(query.is_of_light)];
            while len > 0 {
                len -= 1;
                let (at, inverse) = stack[len];
                let index = at as usize / 2;
                if at % 2 == 1 {
                    let weights = leaves[index].weights(machine, query);
                    kept.offer(index, weights, inverse, &mut random);
                    continue;
                }
                let node = &nodes[index];
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
        kept.take(leaves, random.number)
    }
}

/// [`Root::sample`] as a task.
struct Sample<'a> {
    root: Root<'a>,
    query: &'a Query,
    random: Uniform,
}

impl Task for Sample<'_> {
    type Output = Option<(u32, f32)>;

    #[inline(always)]
    fn run<M: Machine>(self, machine: M) -> Self::Output {
        self.root.draw(machine, self.query, self.random)
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
