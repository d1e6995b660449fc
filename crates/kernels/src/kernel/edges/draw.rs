//! Draws an edge from a tree, in proportion to an estimate of its contribution.

#![allow(
    clippy::needless_range_loop,
    reason = "the language of kernels has no other form"
)]

use super::blocks::{Blocks, block_at, four_of, next_of, place_of};
use crate::accel::LANES;
use crate::accel::eights::{sum_of, weight};
use crate::cube::*;
use crate::model::choice::{Uniform, is_positive};
use crate::model::edge_weight::{Jumps, Query, SeenEdge, Subtree, is_outside};
use crate::model::{Four, Pair, V3, v3};

/// A tree over edges, the part of a tree below a node, or a list of leaves.
#[cfg_attr(feature = "gpu", derive(CubeType))]
#[derive(Clone, Copy)]
pub struct Root<'a> {
    /// The bounds of branches, with [`NODE`] numbers each, and (in `children`) the child of each branch: 2 × the index of
    /// a node, or 2 × the index of a leaf + 1. Missing branches have no weight.
    pub nodes: Blocks<'a>,
    pub children: &'a [u32],
    /// The edges of leaves, with [`LEAF`] numbers each, and (in `edges`) the indices of these edges.
    pub leaves: Blocks<'a>,
    pub edges: &'a [u32],
    /// The child at which a draw starts, and the number of such children. If they are leaves, they are consecutive.
    pub start: u32,
    pub count: u32,
    /// Whether there may be nodes.
    #[cfg_attr(feature = "gpu", cube(comptime))]
    pub has_nodes: bool,
    /// Whether edges may move while the shutter is open.
    #[cfg_attr(feature = "gpu", cube(comptime))]
    pub moves: bool,
}

/// A drawn edge, and 1 over its probability.
#[apply(record!)]
pub struct DrawnEdge {
    /// [`NO_EDGE`] if no edge contributes.
    pub edge: u32,
    pub per_chance: f32,
}

pub const NO_EDGE: u32 = u32::MAX;

/// The numbers of a branch of a node, in fours: center and radius, axis and cosine, sine and jumps.
pub const NODE: usize = 16;
/// The numbers of an edge of a leaf, in fours: middle and half the length, both normals, each with a jump, the other jumps,
/// the vector along the edge, and its velocity.
pub const LEAF: usize = 24;
const FRONT: usize = 4;
const FOLD: usize = FRONT + 3;
const BACK: usize = 8;
const OTHERS: usize = 12;
const ALONG: usize = 16;
const VELOCITY: usize = 20;
const AXIS: usize = 4;
const SINE: usize = 8;

/// The largest number of nodes of which several children may be entered, and the sine of the viewing angle above which
/// a subtree is entered.
const BUDGET: u32 = 64;
const LARGE: f32 = 0.25;
/// The same for the light of emitters. It fills a narrow cone that contains few edges, so they are examined more
/// closely.
const BUDGET_OF_LIGHT: u32 = 1024;
const LARGE_OF_LIGHT: f32 = 0.06;

/// The memory of a draw, in words: eight weights, which are negative for branches to be entered, the weights of the kept
/// leaf, and the stack of nodes to be entered, each with 1 over its probability.
pub const ROOM: usize = STACK + 2 * ENTERED as usize;
const KEPT: usize = 8;
const STACK: usize = 16;
const ENTERED: u32 = 64;

#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn subtree(block: &Blocks, branch: usize) -> Subtree {
    let of_place: Four = four_of(block, NODE, branch, 0usize);
    let of_axis: Four = four_of(block, NODE, branch, AXIS / 4);
    let of_folds: Four = four_of(block, NODE, branch, SINE / 4);
    let others: Four = four_of(block, NODE, branch, OTHERS / 4);
    Subtree {
        center: of_place.vector(),
        radius: of_place.w,
        axis: of_axis.vector(),
        cos: of_axis.w,
        sin: of_folds.x,
        jumps: Jumps {
            seen_always: others.x,
            passes_always: others.y,
            fold: of_folds.y,
            crease: of_folds.z,
            followed: others.z,
            closed: of_folds.w,
        },
    }
}

#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn seen_edge(tree: &Root, block: &Blocks, branch: usize, q: &Query) -> SeenEdge {
    let of_place: Four = four_of(block, LEAF, branch, 0usize);
    let front: Four = four_of(block, LEAF, branch, FRONT / 4);
    let back: Four = four_of(block, LEAF, branch, BACK / 4);
    let others: Four = four_of(block, LEAF, branch, OTHERS / 4);
    let along: Four = four_of(block, LEAF, branch, ALONG / 4);
    let mut to = of_place.vector() - q.x;
    if comptime!(tree.moves) {
        let velocity: Four = four_of(block, LEAF, branch, VELOCITY / 4);
        to += velocity.vector() * q.time;
    }
    SeenEdge {
        to,
        half: of_place.w,
        along: along.vector(),
        front: front.vector(),
        back: back.vector(),
        jumps: Jumps {
            seen_always: others.x,
            passes_always: others.y,
            fold: front.w,
            crease: back.w,
            followed: others.w,
            closed: others.z,
        },
    }
}

/// Stores four numbers of an edge, or of a branch, from number `k` on. `first` is the place of its first number.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn put(list: &mut [f32], first: usize, k: usize, v: V3, w: f32) {
    list[place_of(first, k)] = v.x;
    list[place_of(first, k + 1)] = v.y;
    list[place_of(first, k + 2)] = v.z;
    list[place_of(first, k + 3)] = w;
}

/// Stores an edge: as seen from the origin at the start of the shutter, with its displacement over the shutter.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn put_edge(list: &mut [f32], first: usize, e: &SeenEdge, velocity: V3) {
    let jumps = e.jumps;
    let others = v3(jumps.seen_always, jumps.passes_always, jumps.closed);
    put(list, first, 0usize, e.to, e.half);
    put(list, first, FRONT, e.front, jumps.fold);
    put(list, first, BACK, e.back, jumps.crease);
    put(list, first, OTHERS, others, jumps.followed);
    put(list, first, ALONG, e.along, 0.0);
    put(list, first, VELOCITY, velocity, 0.0);
}

/// Stores the bounds of a branch.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn put_subtree(list: &mut [f32], first: usize, s: &Subtree) {
    let jumps = s.jumps;
    let of_folds = v3(s.sin, jumps.fold, jumps.crease);
    put(list, first, 0usize, s.center, s.radius);
    put(list, first, AXIS, s.axis, s.cos);
    put(list, first, SINE, of_folds, jumps.closed);
    let others = v3(jumps.seen_always, jumps.passes_always, jumps.followed);
    put(list, first, OTHERS, others, 0.0);
}

/// Returns a vector of an edge, from number `k` on.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn stored(list: &mut [f32], first: usize, k: usize) -> V3 {
    v3(
        list[place_of(first, k)],
        list[place_of(first, k + 1)],
        list[place_of(first, k + 2)],
    )
}

/// Returns the normals of the faces of an edge that was stored.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn stored_normals(list: &mut [f32], first: usize) -> Pair {
    Pair {
        first: stored(list, first, FRONT),
        second: stored(list, first, BACK),
    }
}

/// Returns the jump as a silhouette of an edge that was stored.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn stored_fold(list: &mut [f32], first: usize) -> f32 {
    list[place_of(first, FOLD)]
}

/// Computes the weights of the branches of a node, and makes those negative that are to be entered. Returns bits of the
/// branches that GPUs examine, for [`next_of`]: those that are not outside of the cone.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn weigh_node(tree: &Root, node: usize, q: &Query, large: f32, room: &mut [u32]) -> u32 {
    let block: Blocks = block_at(&tree.nodes, NODE, node);
    let lanes = repeated(LANES, tree.count);
    let mut near = 0u32;
    for i in 0..lanes {
        let of_place: Four = four_of(&block, NODE, i, 0usize);
        let is_out = is_outside(of_place.vector(), of_place.w, q);
        near |= select(is_out, 0u32, 1u32 << i as u32);
    }
    let mut i = next_of(near, 0usize);
    while i < lanes {
        let found = subtree(&block, i).estimate(q, large);
        room[i] = select(found.enter, -found.weight, found.weight).to_bits();
        i = next_of(near, i + 1);
    }
    near
}

/// Computes the weights of the edges of a leaf and returns their sum. In most leaves nothing jumps, and the rest is
/// skipped. GPUs skip edges at which nothing jumps.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn weigh_leaf(tree: &Root, leaf: usize, q: &Query, room: &mut [u32]) -> f32 {
    let block: Blocks = block_at(&tree.leaves, LEAF, leaf);
    let lanes = repeated(LANES, tree.count);
    let mut jumping = 0u32;
    for i in 0..lanes {
        let jump = seen_edge(tree, &block, i, q).jump(q);
        jumping |= select(jump > 0.0, 1u32 << i as u32, 0u32);
        room[i] = jump.to_bits();
    }
    let mut sum = 0.0f32;
    if jumping > 0 {
        let mut i = next_of(jumping, 0usize);
        if q.cos > 0.0 {
            while i < lanes {
                let edge = seen_edge(tree, &block, i, q);
                let jump = f32::from_bits(room[i]);
                room[i] = edge.weight_in_cone(jump, q).to_bits();
                i = next_of(jumping, i + 1);
            }
        } else {
            while i < lanes {
                let edge = seen_edge(tree, &block, i, q);
                let jump = f32::from_bits(room[i]);
                room[i] = edge.weight_over_horizon(jump, q).to_bits();
                i = next_of(jumping, i + 1);
            }
        }
        sum = sum_of(&room[..LANES]);
    }
    sum
}

/// Returns the weight of a branch, or 0 if it is entered. Only if `all`, branches of negative weight are entered.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn left_of(own: f32, all: bool) -> f32 {
    let weight = own.abs();
    select(weight > 0.0 && !(own < 0.0 && all), weight, 0.0)
}

/// Pushes a child on the stack, with the inverse of the probability of reaching it.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn push(room: &mut [u32], length: u32, child: u32, inverse: f32) {
    let top = STACK + 2 * length as usize;
    room[top] = child;
    room[top + 1] = inverse.to_bits();
}

/// Draws an edge in proportion to its weight.
///
/// All subtrees that are near, or only partly in the cone, are entered, within a budget. Of the other subtrees of a
/// node, one is drawn. Of all leaves that are reached, one is kept (weighted reservoir sampling), so that no list is
/// stored.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn draw_edge(tree: &Root, room: &mut [u32], q: &Query, u: Uniform) -> DrawnEdge {
    let mut random = u;
    let mut total = 0.0f32;
    let mut kept = 0usize;
    let mut budget = BUDGET.runtime();
    let mut large = LARGE.runtime();
    if q.shadows {
        budget = BUDGET_OF_LIGHT;
        large = LARGE_OF_LIGHT;
    }
    let mut length = 0u32;
    while length < tree.count {
        let child = tree.start + 2 * (tree.count - 1 - length);
        push(room, length, child, 1.0);
        length += 1;
    }
    while length > 0 {
        length -= 1;
        let top = STACK + 2 * length as usize;
        let child = room[top];
        let inverse = f32::from_bits(room[top + 1]);
        let index = (child / 2) as usize;
        if child & 1 == 1 {
            let sum = weigh_leaf(tree, index, q, room);
            if sum > 0.0 {
                let share = sum * inverse;
                total += share;
                let decision = random.decide(share / total);
                random = decision.rest;
                if decision.happens {
                    kept = index;
                    for i in 0..LANES {
                        room[KEPT + i] = room[i];
                    }
                }
            }
        } else if comptime!(tree.has_nodes) {
            let near = weigh_node(tree, index, q, large, room);
            budget -= select(budget > 0, 1u32, 0u32);
            let all = budget > 0 && length + LANES as u32 <= ENTERED;
            let mut far = 0.0f32;
            let mut i = next_of(near, 0usize);
            while i < LANES {
                let own = f32::from_bits(room[i]);
                far += left_of(own, all);
                if own < 0.0 && all {
                    push(room, length, tree.children[LANES * index + i], inverse);
                    length += 1;
                }
                i = next_of(near, i + 1);
            }
            if far > 0.0 {
                let target = random.number * far;
                let mut branch = 0usize;
                let mut passed = 0.0f32;
                let mut before = 0.0f32;
                i = next_of(near, 0usize);
                while i < LANES {
                    let own = left_of(f32::from_bits(room[i]), all);
                    let is_last = own > 0.0 && passed <= target;
                    branch = select(is_last, i, branch);
                    before = select(is_last, passed, before);
                    passed += own;
                    i = next_of(near, i + 1);
                }
                let taken = f32::from_bits(room[branch]).abs();
                random = random.within(before / far, taken / far);
                let child = tree.children[LANES * index + branch];
                push(room, length, child, inverse * far / taken);
                length += 1;
            }
        }
    }
    edge_of_leaf(tree, &room[KEPT..STACK], kept, total, random.number)
}

/// Returns an edge of the kept leaf, drawn in proportion to its weight.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn edge_of_leaf(tree: &Root, weights: &[u32], leaf: usize, total: f32, u: f32) -> DrawnEdge {
    let mut drawn = DrawnEdge {
        edge: NO_EDGE.runtime(),
        per_chance: 0.0f32.runtime(),
    };
    if is_positive(total) {
        let mut sum = 0.0f32;
        for i in 0..LANES {
            sum += weight(weights, i);
        }
        let target = u * sum;
        let mut passed = 0.0f32;
        let mut i = 0usize;
        while i < LANES {
            let own = weight(weights, i);
            if own > 0.0 {
                drawn.edge = tree.edges[LANES * leaf + i];
                drawn.per_chance = total / own;
                passed += own;
                if target < passed {
                    i = LANES;
                }
            }
            i += 1;
        }
    }
    drawn
}
