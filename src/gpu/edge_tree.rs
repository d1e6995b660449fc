//! An edge drawn as a point sees it: `kernel/edges` in a kernel of a GPU, lane by lane.

use crate::cube::*;

use super::edge_layout::{
    CHILDREN, LEAF_COUNT, LEAF_EDGES, LEAF_STRIDE, LEAVES, NODE_COUNT, NODE_STRIDE, NODES,
};
use super::edge_weights::{Query, subtree, weight_of_edge};
use super::finite::is_positive;
use super::layout::NONE;
use super::reading::Scene;
use crate::model::choice::decided_by;

/// An edge that was drawn, or [`NONE`], and 1 over its probability.
#[apply(record!)]
pub(super) struct DrawnEdge {
    pub edge: u32,
    pub per_chance: f32,
}

/// Nodes whose children are all entered, at most, and subtrees that are: those seen under a larger angle (its
/// sine); for reflected light, and for that of emitters.
const BUDGET: u32 = 64;
const LARGE: f32 = 0.25;
const BUDGET_OF_LIGHT: u32 = 1024;
const LARGE_OF_LIGHT: f32 = 0.015;

/// Room that a draw needs, in words: weights of a leaf, those of the leaf that is kept, and nodes that are to be
/// entered with 1 over their probabilities.
pub(super) const ROOM: usize = 16 + 2 * ENTERED as usize;
const KEPT: usize = 8;
const STACK: usize = 16;
const ENTERED: u32 = 64;

/// The sum of eight weights, in the order of the host.
#[cube]
fn sum_of(room: &mut [u32]) -> f32 {
    let a = f32::from_bits(room[0]) + f32::from_bits(room[4]);
    let b = f32::from_bits(room[2]) + f32::from_bits(room[6]);
    let c = f32::from_bits(room[1]) + f32::from_bits(room[5]);
    let d = f32::from_bits(room[3]) + f32::from_bits(room[7]);
    (a + b) + (c + d)
}

/// Draws an edge of a tree, which begins at a word of the header, in proportion to its weight. See
/// `Root::sample`.
#[cube]
pub(super) fn draw_edge(
    scene: &Scene,
    room: &mut [u32],
    tree: usize,
    q: &Query,
    u: f32,
    other: f32,
    #[comptime] nodes: bool,
) -> DrawnEdge {
    let mut random = decided_by(u, other);
    let mut total = 0.0f32;
    let mut leaf = 0u32;
    let leaves = scene.header[tree + LEAF_COUNT];
    let is_list = scene.header[tree + NODE_COUNT] == 0;
    let mut budget = BUDGET.runtime();
    let mut large = LARGE.runtime();
    if q.shadows {
        budget = BUDGET_OF_LIGHT;
        large = LARGE_OF_LIGHT;
    }
    let mut length = 1u32;
    let mut listed = 0u32;
    room[STACK] = 0;
    room[STACK + 1] = (1.0f32).to_bits();
    while length > 0 {
        let mut at = 2 * listed + 1;
        let mut inverse = 1.0f32;
        if is_list {
            listed += 1;
            if listed >= leaves {
                length = 0;
            }
        } else {
            length -= 1;
            let top = STACK + 2 * length as usize;
            at = room[top];
            inverse = f32::from_bits(room[top + 1]);
        }
        let lanes = at / 2 * 8;
        if at & 1 == 1 {
            let mut i = 0u32;
            while i < 8 {
                let mut weight = 0.0f32;
                if scene.words[(scene.header[tree + LEAF_EDGES] + lanes + i) as usize] != NONE {
                    let lane = scene.header[tree + LEAVES] + LEAF_STRIDE * (lanes + i);
                    weight = weight_of_edge(scene, lane, q);
                }
                room[i as usize] = weight.to_bits();
                i += 1;
            }
            let sum = sum_of(room);
            if sum > 0.0 {
                let share = sum * inverse;
                total += share;
                let decision = random.decide(share / total);
                random = decision.rest;
                if decision.happens {
                    leaf = lanes;
                    let mut k = 0usize;
                    while k < 8 {
                        room[KEPT + k] = room[k];
                        k += 1;
                    }
                }
            }
        } else if comptime!(nodes) {
            if budget > 0 {
                budget -= 1;
            }
            let all = budget > 0 && length + 8 <= ENTERED;
            let mut far = 0.0f32;
            let mut taken = NONE.runtime();
            let mut taken_weight = 1.0f32;
            let mut i = 0u32;
            while i < 8 {
                let child = scene.words[(scene.header[tree + CHILDREN] + lanes + i) as usize];
                if child != NONE {
                    let lane = scene.header[tree + NODES] + NODE_STRIDE * (lanes + i);
                    let found = subtree(scene, lane, q, large);
                    if found.weight > 0.0 {
                        if all && found.enter {
                            let top = STACK + 2 * length as usize;
                            room[top] = child;
                            room[top + 1] = inverse.to_bits();
                            length += 1;
                        } else {
                            far += found.weight;
                            let decision = random.decide(found.weight / far);
                            random = decision.rest;
                            if decision.happens {
                                taken = child;
                                taken_weight = found.weight;
                            }
                        }
                    }
                }
                i += 1;
            }
            if taken != NONE {
                let top = STACK + 2 * length as usize;
                room[top] = taken;
                room[top + 1] = (inverse * far / taken_weight).to_bits();
                length += 1;
            }
        }
    }
    let mut drawn = DrawnEdge {
        edge: NONE,
        per_chance: 0.0f32,
    };
    if is_positive(total) {
        let mut sum = 0.0f32;
        let mut k = 0usize;
        while k < 8 {
            sum += f32::from_bits(room[KEPT + k]);
            k += 1;
        }
        let target = random.number * sum;
        let mut passed = 0.0f32;
        let mut lane = 0u32;
        while lane < 8 {
            let weight = f32::from_bits(room[KEPT + lane as usize]);
            if weight > 0.0 {
                drawn.edge = scene.words[(scene.header[tree + LEAF_EDGES] + leaf + lane) as usize];
                drawn.per_chance = total / weight;
                passed += weight;
                if target < passed {
                    lane = 8;
                }
            }
            lane += 1;
        }
    }
    drawn
}
