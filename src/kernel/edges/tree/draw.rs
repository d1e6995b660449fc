//! An edge drawn from a tree in proportion to what it may contribute, seen from a point.

use super::build::EdgeTree;
use super::leaf::Leaf;
use super::query::{Query, Query8};
use crate::accel::{F8, LANES, Lanes, Machine, Task, dispatch};

impl EdgeTree {
    /// An edge, drawn in proportion to its weight, and one over its probability. None where there is none.
    ///
    /// Subtrees that are near or lie in the cone in part are entered, all of them; of those that are far
    /// and lie in it whole one is taken at random. Of all edges that it comes to one stays, so that no list
    /// is kept.
    pub fn sample(&self, arch: pulp::Arch, query: &Query, u: f32) -> Option<(u32, f32)> {
        dispatch(
            arch,
            Sample {
                tree: self,
                query,
                u,
            },
        )
    }

    #[inline(always)]
    fn draw<M: Machine>(&self, machine: M, query: &Query, u: f32) -> Option<(u32, f32)> {
        let query = &Query8::new(machine, query);
        let mut random = Uniform(u);
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
                        if random.decide(weights[i] / far) {
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
        kept.take(&self.leaves, &mut random)
    }
}

/// [`EdgeTree::sample`] as a task.
struct Sample<'a> {
    tree: &'a EdgeTree,
    query: &'a Query,
    u: f32,
}

impl Task for Sample<'_> {
    type Output = Option<(u32, f32)>;

    #[inline(always)]
    fn run<M: Machine>(self, machine: M) -> Self::Output {
        self.tree.draw(machine, self.query, self.u)
    }
}

/// Nodes whose children are all entered, at most, and subtrees that are: those seen under a larger angle
/// (its sine). A light fills a narrow cone, in which few edges lie: they are looked at closely.
const BUDGET: [u32; 2] = [64, 1024];
const LARGE: [f32; 2] = [0.25, 0.015];

/// A uniform number that decides several times: what is left of it after a decision is uniform again.
struct Uniform(f32);

impl Uniform {
    /// Decides whether something happens that has a probability.
    #[inline(always)]
    fn decide(&mut self, chance: f32) -> bool {
        let happens = self.0 < chance;
        let (from, to) = if happens {
            (0.0, chance)
        } else {
            (chance, 1.0)
        };
        self.0 = ((self.0 - from) / (to - from)).clamp(0.0, 1.0 - f32::EPSILON);
        happens
    }
}

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
        if random.decide(share / self.total) {
            self.leaf = leaf;
            self.weights = weights.lanes();
        }
    }

    #[inline(always)]
    fn take(self, leaves: &[Leaf], random: &mut Uniform) -> Option<(u32, f32)> {
        if !(self.total > 0.0 && self.total.is_finite()) {
            return None;
        }
        let sum: f32 = self.weights.iter().sum();
        let target = random.0 * sum;
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
