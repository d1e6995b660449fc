//! Many emitters in the buffers of a view, and the emitters that a ray hits.

use crate::cube::*;

use super::layout::{
    DISTANT, DISTANT_AXES, DISTANT_COUNT, DISTANT_SUMS, EMISSIVE_COUNT, EMITTER_COUNT, FIXED,
    FIXED_SUMS, LIGHT_BRANCHES, LIGHT_NODE_COUNT, LIGHT_NODES, LIGHT_PLACES, NONE,
};
use super::light::{EmitterHit, hits_emitter, no_emitter_hit};
use super::reading::Scene;
use crate::accel::LANES;
use crate::model::V3;
use crate::sampling::{Fixed, LightTree};

/// Probabilities of emitters that do not depend on the point.
#[cube]
pub(super) fn fixed_of<'a>(scene: &Scene<'a>) -> Fixed<'a> {
    Fixed::<'a> {
        chances: &scene.floats[scene.header[FIXED] as usize..],
        sums: &scene.floats[scene.header[FIXED_SUMS] as usize..],
        count: scene.header[EMITTER_COUNT],
    }
}

/// The tree over emitters.
#[cube]
pub(super) fn light_tree_of<'a>(scene: &Scene<'a>) -> LightTree<'a> {
    LightTree::<'a> {
        branches: &scene.floats[scene.header[LIGHT_BRANCHES] as usize..],
        nodes: &scene.words[scene.header[LIGHT_NODES] as usize..],
        count: scene.header[LIGHT_NODE_COUNT],
        places: &scene.words[scene.header[LIGHT_PLACES] as usize..],
        distant: &scene.words[scene.header[DISTANT] as usize..],
        distant_count: scene.header[DISTANT_COUNT],
        sums: &scene.floats[scene.header[DISTANT_SUMS] as usize..],
        axes: &scene.floats[scene.header[DISTANT_AXES] as usize..],
        fixed: fixed_of(scene),
    }
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
    let tree = light_tree_of(scene);
    let mut found: EmitterHit = no_emitter_hit();
    let mut node = 0u32;
    if tree.count == 0 {
        node = NONE;
    }
    let mut branch = 0u32;
    while node != NONE {
        if branch == LANES as u32 {
            branch = tree.branch_of_parent(node) + 1;
            node = tree.parent(node);
        } else {
            let meets = tree.is_met(node, branch, x, direction);
            let child = tree.word(node, branch as usize);
            branch += 1;
            if meets {
                if !tree.is_leaf(node) {
                    node = child;
                    branch = 0u32;
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
