//! A tree over many emitters: `sampling/emitters/tree` in a kernel of a GPU, branch by branch.

use burn::cubecl::{self, prelude::*};

use super::layout::{
    DISTANT, DISTANT_AXES, DISTANT_COUNT, DISTANT_SUMS, EMISSIVE_COUNT, LIGHT_BRANCHES,
    LIGHT_NODE_COUNT, LIGHT_NODES, LIGHT_PLACES, NONE, OF_LIGHT_NODE, OF_LIGHT_TREE,
};
use super::light::{Choice, Site};
use super::light::{EmitterHit, hits_emitter, no_emitter_hit};
use super::reading::{Scene, first_over};
use crate::model::V3;
use crate::model::choice::{MOST, is_positive};
use crate::sampling::{INSIDE, SPREAD};

/// Branches of a node.
const LANES: u32 = 8;

/// About twice the mean of max(n·d, 0) over axes n, by their mean and moments from a place on, before what is under 0
/// is cut off.
#[cube]
fn facing(scene: &Scene, axes: u32, d: V3, spread: f32) -> f32 {
    let i = axes as usize;
    let products = scene.floats[i + 3] * d.x * d.x
        + scene.floats[i + 4] * d.y * d.y
        + scene.floats[i + 5] * d.z * d.z;
    let crossed = scene.floats[i + 6] * d.x * d.y
        + scene.floats[i + 7] * d.x * d.z
        + scene.floats[i + 8] * d.y * d.z;
    let square = (products + 2.0 * crossed + spread).max(0.0);
    scene.vector(axes).dot(d) + square.sqrt()
}

/// About the irradiance of a point by a branch.
#[cube]
fn brings(scene: &Scene, branch: u32, x: V3, normal: V3) -> f32 {
    let i = branch as usize;
    let to = scene.vector(branch) - x;
    let radius = scene.floats[i + 3];
    let power = scene.floats[i + 13];
    let squared = to.length_squared().max(1e-30);
    let inverse = 1.0 / squared.sqrt();
    // The sine of the angle under which the sphere is seen.
    let seen = (radius * inverse).min(1.0).max(1e-6);
    let emits = facing(scene, branch + 4, to * -inverse, SPREAD * seen * seen).max(0.0);
    // The mean of cosines over the sphere, where the horizon divides it.
    let incident = to.dot(normal) * inverse;
    let above = (incident + seen).max(0.0);
    let mut receives = incident;
    if incident < seen {
        receives = above * above / (4.0 * seen);
    }
    0.5 * power * emits * receives / squared.max(INSIDE * radius * radius)
}

#[cube]
fn branch_of(scene: &Scene, node: u32, lane: u32) -> u32 {
    scene.header[LIGHT_BRANCHES] + OF_LIGHT_TREE as u32 * (LANES * node + lane)
}

#[cube]
fn power_of(scene: &Scene, branch: u32) -> f32 {
    scene.floats[branch as usize + 13]
}

/// Weights of a node's branches: about the irradiance of a point, or power where all are 0. Returns
/// their sum.
#[cube]
fn weigh(scene: &Scene, node: u32, at: &Site, weights: &mut [f32]) -> f32 {
    let mut total = 0.0f32;
    let mut lane = 0u32;
    while lane < LANES {
        let branch = branch_of(scene, node, lane);
        let mut weight = 0.0f32;
        if power_of(scene, branch) > 0.0 {
            weight = brings(scene, branch, at.position, at.normal);
        }
        weights[lane as usize] = weight;
        total += weight;
        lane += 1;
    }
    let known = is_positive(total);
    if !known {
        total = 0.0f32;
        lane = 0u32;
        while lane < LANES {
            let power = power_of(scene, branch_of(scene, node, lane));
            weights[lane as usize] = power;
            total += power;
            lane += 1;
        }
    }
    total
}

/// The probability of directional lights.
#[cube]
pub(super) fn share_of_distant(scene: &Scene, x: V3, normal: V3) -> f32 {
    let count = scene.header[DISTANT_COUNT];
    let nodes = scene.header[LIGHT_NODE_COUNT];
    let mut share = 1.0f32;
    if nodes > 0 {
        share = 0.0f32;
        if count > 0 {
            let strength = scene.floats[(scene.header[DISTANT_SUMS] + count - 1) as usize];
            let seen = facing(scene, scene.header[DISTANT_AXES], normal, 0.0f32.runtime());
            let distant = 0.5 * strength * seen.max(0.0);
            // All of the tree are behind its nodes.
            let near = brings(scene, branch_of(scene, nodes, 0u32), x, normal);
            // Neither, as far as this sees: then any.
            share = 0.5f32;
            if distant + near > 0.0 {
                share = distant / (distant + near);
            }
        }
    }
    share
}

/// Chooses one of the tree, or a directional light; its probability is left open.
#[cube]
pub(super) fn choose_in_tree(scene: &Scene, u: f32, at: &Site) -> Choice {
    let mut choice = Choice {
        emitter: 0u32,
        chance: 1.0f32,
        rest: 0.0f32,
    };
    let distant = at.sum;
    if scene.header[LIGHT_NODE_COUNT] > 0 && u >= distant {
        let mut room = Array::<f32>::new(8usize);
        let weights = room.as_mut_slice();
        let mut rest = ((u - distant) / (1.0 - distant)).min(MOST);
        let mut node = 0u32;
        let mut going = true;
        while going {
            let target = rest * weigh(scene, node, at, weights);
            let mut lane = 0u32;
            let mut before = 0.0f32;
            let mut passed = 0.0f32;
            let mut i = 0u32;
            while i < LANES {
                let weight = weights[i as usize];
                if weight > 0.0 {
                    lane = i;
                    before = passed;
                    passed += weight;
                    if target < passed {
                        i = LANES;
                    }
                }
                i += 1;
            }
            rest = ((target - before) / weights[lane as usize])
                .max(0.0)
                .min(MOST);
            let row = scene.header[LIGHT_NODES] + OF_LIGHT_NODE as u32 * node;
            node = scene.words[(row + lane) as usize];
            going = scene.words[(row + 10) as usize] == 0;
        }
        choice.emitter = node;
        choice.rest = rest;
    } else {
        let count = scene.header[DISTANT_COUNT];
        let sums = scene.header[DISTANT_SUMS];
        let place = u / distant * scene.floats[(sums + count - 1) as usize];
        let i = first_over(scene.floats, sums, count, 1u32, place);
        choice.emitter = scene.words[(scene.header[DISTANT] + i) as usize];
    }
    choice
}

/// The probability of an emitter, or of the leaf that it is in.
#[cube]
pub(super) fn chance_in_tree(scene: &Scene, k: u32, of_leaf: bool, at: &Site) -> f32 {
    let place = (scene.header[LIGHT_PLACES] + 2 * k) as usize;
    let mut node = scene.words[place];
    let mut lane = scene.words[place + 1];
    let mut chance = at.sum;
    if node == NONE {
        let sums = scene.header[DISTANT_SUMS];
        let mut before = 0.0f32;
        if lane > 0 {
            before = scene.floats[(sums + lane - 1) as usize];
        }
        let own = scene.floats[(sums + lane) as usize] - before;
        chance *= own / scene.floats[(sums + scene.header[DISTANT_COUNT] - 1) as usize];
    } else {
        chance = 1.0 - chance;
        let mut room = Array::<f32>::new(8usize);
        let weights = room.as_mut_slice();
        let mut skips = of_leaf;
        while node != NONE {
            if !skips {
                let total = weigh(scene, node, at, weights);
                chance *= weights[lane as usize] / total;
            }
            skips = false;
            let row = scene.header[LIGHT_NODES] + OF_LIGHT_NODE as u32 * node;
            node = scene.words[(row + 8) as usize];
            lane = scene.words[(row + 9) as usize];
        }
    }
    chance
}

/// The first emitter from a number on whose front a ray hits, as if nothing were in between.
#[cube]
pub(super) fn next_hit_in_tree(
    scene: &Scene,
    from: u32,
    x: V3,
    direction: V3,
    time: f32,
) -> EmitterHit {
    let mut found: EmitterHit = no_emitter_hit();
    let mut node = 0u32;
    if scene.header[LIGHT_NODE_COUNT] == 0 {
        node = NONE;
    }
    let mut lane = 0u32;
    while node != NONE {
        let row = (scene.header[LIGHT_NODES] + OF_LIGHT_NODE as u32 * node) as usize;
        if lane == LANES {
            node = scene.words[row + 8];
            lane = scene.words[row + 9] + 1;
        } else {
            let child = scene.words[row + lane as usize];
            let branch = branch_of(scene, node, lane);
            lane += 1;
            if power_of(scene, branch) > 0.0 && meets(scene, branch, x, direction) {
                if scene.words[row + 10] == 0 {
                    node = child;
                    lane = 0u32;
                } else if child >= from
                    && child < found.emitter
                    && child < scene.header[EMISSIVE_COUNT]
                {
                    let hit = hits_emitter(scene, child, x, direction, time);
                    if hit.emitter != NONE {
                        found = hit;
                    }
                }
            }
        }
    }
    found
}

/// Whether a ray meets the sphere around a branch.
#[cube]
fn meets(scene: &Scene, branch: u32, x: V3, direction: V3) -> bool {
    let to = scene.vector(branch) - x;
    let along = to.dot(direction);
    let across = to - direction * along;
    // With a margin for rounding far away.
    let reach = along.abs() * 1e-6 + scene.floats[branch as usize + 3];
    across.length_squared() < reach * reach && along + reach > 0.0
}
