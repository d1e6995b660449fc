//! Points on emitters for next-event estimation: sampled points, and points along a direction.

#![allow(unused_assignments)] // Variables of a kernel require an initial value.
#![allow(
    clippy::collapsible_if,
    reason = "the language of kernels has no other form"
)]

use super::fixed::Chosen;
use super::lists::{EmitterHit, EmitterLists, EmitterListsExpand, Receiver, no_emitter_hit};
use crate::accel::LANES;
use crate::accel::eights::NONE;
use crate::cube::*;
use crate::model::triangle::uniform_point;
use crate::model::{V2, V3, v2};

/// A point on an emitter (or [`NONE`]), and the probability with which the emitter was chosen.
#[apply(record!)]
pub struct EmitterPlace {
    pub emitter: u32,
    /// Weights of the corners b and c.
    pub weights: V2,
    pub chance: f32,
}

#[cube]
impl EmitterPlace {
    pub fn none() -> EmitterPlace {
        EmitterPlace {
            emitter: NONE.runtime(),
            weights: v2(0.0, 0.0),
            chance: 1.0f32.runtime(),
        }
    }
}

#[cube]
impl<'a> EmitterLists<'a> {
    /// Samples a point on an emitter with two random numbers. Requires a call of [`look`](Self::look) at the same
    /// point.
    pub fn choose_place(
        &self,
        u: f32,
        v: f32,
        at: &Receiver,
        share: f32,
        room: &mut [u32],
    ) -> EmitterPlace {
        let chosen: Chosen = self.choose(u, at, share, room);
        EmitterPlace {
            emitter: chosen.emitter,
            weights: uniform_point(chosen.rest, v),
            chance: chosen.chance,
        }
    }

    /// Intersects a ray with the fronts of emitters, regardless of occluders. Returns the hit of the least emitter
    /// number that is at least `from`. Requires a call of [`look`](Self::look) at the ray's origin.
    pub fn place_along(
        &self,
        from: u32,
        direction: V3,
        at: &Receiver,
        share: f32,
        room: &mut [u32],
    ) -> EmitterPlace {
        let mut found = no_emitter_hit();
        if comptime!(self.kinds.by_tree) {
            found = self.first_hit_in_tree(from, at.position, direction, at.time);
        } else {
            found = self.first_hit_in_list(from, at.position, direction, at.time);
        }
        let mut place = EmitterPlace::none();
        if found.emitter != NONE {
            place.emitter = found.emitter;
            place.weights = found.weights;
            place.chance = self.chance(found.emitter, at, share, room);
        }
        place
    }

    fn first_hit_in_list(&self, from: u32, x: V3, direction: V3, time: f32) -> EmitterHit {
        let mut found = no_emitter_hit();
        let mut k = from;
        while k < self.triangle_count && found.emitter == NONE {
            found = self.hit(k, x, direction, time);
            k += 1;
        }
        found
    }

    fn first_hit_in_tree(&self, from: u32, x: V3, direction: V3, time: f32) -> EmitterHit {
        let mut found = no_emitter_hit();
        let mut node = 0u32;
        if self.tree.count == 0 {
            node = NONE;
        }
        let mut branch = 0u32;
        while node != NONE {
            if branch == LANES as u32 {
                branch = self.tree.branch_of_parent(node) + 1;
                node = self.tree.parent(node);
            } else {
                let meets = self.tree.is_met(node, branch, x, direction);
                let child = self.tree.word(node, branch as usize);
                branch += 1;
                if meets {
                    if !self.tree.is_leaf(node) {
                        node = child;
                        branch = 0u32;
                    } else if child >= from && child < found.emitter && child < self.triangle_count
                    {
                        let hit = self.hit(child, x, direction, time);
                        if hit.emitter != NONE {
                            found = hit;
                        }
                    }
                }
            }
        }
        found
    }
}
