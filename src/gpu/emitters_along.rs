//! The emitters that a ray hits, one after another.

use crate::cube::*;

use crate::accel::LANES;
use crate::model::V3;
use crate::sampling::{EmitterHit, no_emitter_hit};
use crate::trace::{NONE, Scene, emitters_of};

/// The first emitter from a number on whose front a ray hits, as if nothing were in between.
#[cube]
pub(super) fn next_emitter_hit(
    scene: &Scene,
    from: u32,
    x: V3,
    direction: V3,
    time: f32,
) -> EmitterHit {
    let mut found = no_emitter_hit();
    if comptime!(scene.features.of_emitters.by_tree) {
        found = next_hit_in_tree(scene, from, x, direction, time);
    } else {
        let mut k = from;
        while k < scene.emissive_count && found.emitter == NONE {
            found = emitters_of(scene).hit(k, x, direction, time);
            k += 1;
        }
    }
    found
}

/// The first emitter from a number on whose front a ray hits, as if nothing were in between.
#[cube]
fn next_hit_in_tree(scene: &Scene, from: u32, x: V3, direction: V3, time: f32) -> EmitterHit {
    let tree = emitters_of(scene).tree;
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
                } else if child >= from && child < found.emitter && child < scene.emissive_count {
                    let hit = emitters_of(scene).hit(child, x, direction, time);
                    if hit.emitter != NONE {
                        found = hit;
                    }
                }
            }
        }
    }
    found
}
