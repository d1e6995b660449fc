//! The choice of an emitter that a point is connected to.

use crate::cube::*;

use super::edge_layout::{GROUP_OF_EMITTERS, OF_GROUP, OF_GROUPS};
use super::layout::{EMISSIVE_COUNT, EMITTER_COUNT, EMITTERS, FIXED, NONE};
use super::light::{
    EmitterHit, Site, delta_light, emitter, hits_emitter, is_light, no_emitter_hit,
};
use super::light_tree::{fixed_of, light_tree_of, next_hit_in_tree};
use super::reading::Scene;
use crate::model::V3;
use crate::model::choice::{MOST, is_positive};
use crate::model::triangle::solid_angle;
use crate::sampling::{BY_POWER, Chosen};

/// A point with a normal.
#[cube]
pub(super) fn site(scene: &Scene, position: V3, normal: V3, time: f32) -> Site {
    let mut sum = 0.0f32;
    if comptime!(scene.features.by_solid_angle) {
        let mut k = 0u32;
        while k < scene.header[EMITTER_COUNT] {
            sum += seen_from(scene, k, position, time);
            k += 1;
        }
    }
    if comptime!(scene.features.by_tree) {
        sum = light_tree_of(scene).share_of_distant(position, normal);
    }
    Site {
        position,
        normal,
        time,
        sum,
    }
}

/// Radiance times the solid angle under which a point sees an emitter; about the irradiance by a light without extent.
#[cube]
fn seen_from(scene: &Scene, k: u32, x: V3, time: f32) -> f32 {
    let brightness = scene.floats[(scene.header[EMITTERS] + k) as usize];
    let mut seen = 0.0f32;
    if is_light(scene, k) {
        if comptime!(scene.features.lights) {
            seen = delta_light(scene, k).seen_from(x).scale;
        }
    } else {
        let e = emitter(scene, k, time);
        seen = solid_angle(e.a, e.b, e.c, x).max(0.0);
    }
    brightness * seen
}

#[cube]
fn fixed(scene: &Scene, k: u32) -> f32 {
    scene.floats[(scene.header[FIXED] + k) as usize]
}

/// The probability of an emitter.
#[cube]
pub(super) fn chance(scene: &Scene, k: u32, at: &Site) -> f32 {
    let fixed = fixed(scene, k);
    let mut p = fixed;
    if comptime!(scene.features.by_solid_angle) {
        if is_positive(at.sum) {
            let own = seen_from(scene, k, at.position, at.time);
            p = (1.0 - BY_POWER) * own / at.sum + BY_POWER * fixed;
        }
    }
    if comptime!(scene.features.by_tree) {
        let mut room = Array::<u32>::new(8usize);
        let room = room.as_mut_slice();
        p = light_tree_of(scene).chance(k, at.sum, at.position, at.normal, room);
    }
    p
}

/// A group of emitters, and its probability.
#[apply(record!)]
pub(super) struct GroupChoice {
    pub group: u32,
    pub chance: f32,
}

/// Chooses a group.
#[cube]
pub(super) fn choose_group(scene: &Scene, u: f32, at: &Site) -> GroupChoice {
    let choice: Chosen = choose(scene, u, at);
    let group = scene.words[(scene.header[GROUP_OF_EMITTERS] + choice.emitter) as usize];
    let row = (scene.header[OF_GROUPS] + OF_GROUP * group) as usize;
    let mut k = scene.words[row];
    let past = k + scene.words[row + 1];
    let mut p = 0.0f32;
    if comptime!(scene.features.by_tree) {
        let mut room = Array::<u32>::new(8usize);
        let room = room.as_mut_slice();
        let tree = light_tree_of(scene);
        let by_place = tree.chance_by_place(k, true, at.sum, at.position, at.normal, room);
        p = (1.0 - BY_POWER) * by_place;
    }
    while k < past {
        if comptime!(scene.features.by_tree) {
            p += BY_POWER * fixed(scene, k);
        } else {
            p += chance(scene, k, at);
        }
        k += 1;
    }
    GroupChoice { group, chance: p }
}

/// Chooses an emitter.
#[cube]
pub(super) fn choose(scene: &Scene, u: f32, at: &Site) -> Chosen {
    let mut choice = Chosen {
        emitter: 0u32,
        chance: 1.0f32,
        rest: u,
    };
    if comptime!(scene.features.by_tree) {
        let mut room = Array::<u32>::new(8usize);
        let room = room.as_mut_slice();
        choice = light_tree_of(scene).choose(u, at.sum, at.position, at.normal, room);
    } else if comptime!(scene.features.by_sums) {
        choice = fixed_of(scene).choose(u);
    } else {
        choice = choose_of_few(scene, u, at);
    }
    choice
}

/// One of so few that all are looked at.
#[cube]
fn choose_of_few(scene: &Scene, u: f32, at: &Site) -> Chosen {
    let count = scene.header[EMITTER_COUNT];
    let mut k = 0u32;
    let mut passed = 0.0f32;
    // Rounding may leave the sum a little under 1: then the last that can be is taken.
    let mut emitter = 0u32;
    let mut own = 1.0f32;
    let mut before = 0.0f32;
    while k < count {
        let p = chance(scene, k, at);
        if p > 0.0 {
            emitter = k;
            own = p;
            before = passed;
            if u < passed + p {
                k = count;
            }
        }
        passed += p;
        k += 1;
    }
    Chosen {
        emitter,
        chance: own,
        rest: ((u - before) / own).max(0.0).min(MOST),
    }
}

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
    if comptime!(scene.features.by_tree) {
        found = next_hit_in_tree(scene, from, x, direction, time);
    } else {
        let mut k = from;
        while k < scene.header[EMISSIVE_COUNT] && found.emitter == NONE {
            found = hits_emitter(scene, k, x, direction, time);
            k += 1;
        }
    }
    found
}
