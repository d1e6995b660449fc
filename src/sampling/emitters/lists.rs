//! The emitters of a scene as lists, and the choice of one, in one source for the host and GPUs.

#![allow(unused_assignments)] // Variables of a kernel need a first value.
#![allow(
    clippy::collapsible_if,
    clippy::manual_clamp,
    clippy::needless_range_loop,
    reason = "the language of kernels has no other form"
)]

use super::BY_POWER;
use super::fixed::Chosen;
use super::tree::LightTree;
use crate::accel::eights::NONE;
use crate::cube::*;
use crate::model::choice::{MOST, is_positive};
use crate::model::delta_light::{DeltaLight, delta_light_at};
use crate::model::emitter::hit_front;
use crate::model::lists::vector;
use crate::model::triangle::solid_angle;
use crate::model::{V2, V3, v2};

/// How emitters are chosen, and what they are; kernels on GPUs know it when they are compiled.
#[derive(Clone, Copy, Debug, Default, Hash, PartialEq, Eq)]
pub(crate) struct EmitterKinds {
    /// Whether there are delta lights, and whether triangles move.
    pub lights: bool,
    pub moves: bool,
    /// By the solid angles of all, by a tree, or by sums of fixed probabilities; else by these probabilities, one after
    /// another.
    pub by_solid_angle: bool,
    pub by_tree: bool,
    pub by_sums: bool,
    /// Words of room that a choice needs.
    pub room: usize,
}

impl EmitterKinds {
    /// Words of room that any choice needs.
    pub const MOST_ROOM: usize = FEW;
}

/// Up to so many emitters have their solid angles computed at every point.
pub(super) const FEW: usize = 64;

/// Emitters: triangles, then delta lights, in one count.
#[cfg_attr(feature = "wgpu", derive(CubeType))]
#[derive(Clone, Copy)]
pub(crate) struct EmitterLists<'a> {
    /// [`OF_EMITTER`] numbers of each triangle: corners, normal, area and velocity.
    pub triangles: &'a [f32],
    pub triangle_count: u32,
    pub lights: &'a [f32],
    pub bits: &'a [u32],
    /// What each brings is multiplied by: mean radiance, intensity or irradiance.
    pub brightness: &'a [f32],
    /// Many, and the probabilities of all that do not depend on the point.
    pub tree: LightTree<'a>,
    #[cfg_attr(feature = "wgpu", cube(comptime))]
    pub kinds: EmitterKinds,
}

pub(crate) const OF_EMITTER: usize = 16;

/// A surface point that emitters are chosen for.
#[apply(record!)]
pub(crate) struct Receiver {
    pub position: V3,
    /// The side's normal.
    pub normal: V3,
    /// Time in the shutter.
    pub time: f32,
}

/// A triangle that emits, at a time in the shutter.
#[apply(record!)]
pub(crate) struct EmitterTriangle {
    pub a: V3,
    pub b: V3,
    pub c: V3,
    pub normal: V3,
    pub area: f32,
}

#[cfg_attr(feature = "wgpu", cube)]
impl EmitterTriangle {
    /// It moved by a vector.
    #[inline(always)]
    pub fn moved(&self, shift: V3) -> EmitterTriangle {
        EmitterTriangle {
            a: self.a + shift,
            b: self.b + shift,
            c: self.c + shift,
            normal: self.normal,
            area: self.area,
        }
    }

    /// The solid angle under which a point sees its front.
    #[inline(always)]
    pub fn angle(&self, from: V3) -> f32 {
        solid_angle(self.a, self.b, self.c, from).max(0.0)
    }
}

/// A point of an emitter's front that a ray hits, as if nothing were in between.
#[apply(record!)]
pub(crate) struct EmitterHit {
    /// [`NONE`] where there is none.
    pub emitter: u32,
    pub distance: f32,
    /// Weights of the corners b and c.
    pub weights: V2,
}

#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn no_emitter_hit() -> EmitterHit {
    EmitterHit {
        emitter: NONE.runtime(),
        distance: 0.0f32.runtime(),
        weights: v2(0.0, 0.0),
    }
}

/// A choice among few emitters, which passes one after another.
#[apply(zeroed!)]
pub(crate) struct Choosing {
    emitter: u32,
    chance: f32,
    /// The sums of the probabilities before it and before the next.
    before: f32,
    passed: f32,
    /// The sum with it: it is the one where this is over the random number.
    past: f32,
}

#[cfg_attr(feature = "wgpu", cube)]
impl Choosing {
    #[inline(always)]
    pub fn begin() -> Choosing {
        Choosing {
            emitter: 0u32.runtime(),
            chance: 1.0f32.runtime(),
            before: 0.0f32.runtime(),
            passed: 0.0f32.runtime(),
            past: 0.0f32.runtime(),
        }
    }

    /// Passes an emitter with a probability, which is chosen where it takes the sum over a random number. Rounding may
    /// leave the sum of all a little under 1: then the last that can be is taken.
    #[inline(always)]
    pub fn pass(&mut self, k: u32, chance: f32, u: f32) {
        if u >= self.past && chance > 0.0 {
            self.emitter = k;
            self.chance = chance;
            self.before = self.passed;
            self.past = self.passed + chance;
        }
        self.passed += chance;
    }

    #[inline(always)]
    pub fn end(&self, u: f32) -> Chosen {
        Chosen {
            emitter: self.emitter,
            chance: self.chance,
            rest: ((u - self.before) / self.chance).max(0.0).min(MOST),
        }
    }
}

#[cfg_attr(feature = "wgpu", cube)]
impl<'a> EmitterLists<'a> {
    /// A triangle if a ray hits it.
    #[inline(always)]
    pub fn hit(&self, k: u32, x: V3, direction: V3, time: f32) -> EmitterHit {
        let on = self.triangle(k, time);
        let hit = hit_front(on.a, on.b, on.c, on.normal, on.area, x, direction);
        let mut found = no_emitter_hit();
        if hit.distance > 0.0 {
            found.emitter = k;
            found.distance = hit.distance;
            found.weights = hit.weights;
        }
        found
    }

    /// A triangle.
    #[inline(always)]
    pub fn triangle(&self, k: u32, time: f32) -> EmitterTriangle {
        let mut found = self.at_rest(k);
        if comptime!(self.kinds.moves) {
            found = found.moved(self.velocity(k) * time);
        }
        found
    }

    /// A triangle at the start of the shutter.
    #[inline(always)]
    pub fn at_rest(&self, k: u32) -> EmitterTriangle {
        let list = &self.triangles[OF_EMITTER * k as usize..];
        EmitterTriangle {
            a: vector(list, 0u32),
            b: vector(list, 3u32),
            c: vector(list, 6u32),
            normal: vector(list, 9u32),
            area: list[12],
        }
    }

    /// The displacement of a triangle over the shutter.
    #[inline(always)]
    pub fn velocity(&self, k: u32) -> V3 {
        vector(self.triangles, OF_EMITTER as u32 * k + 13)
    }

    /// Whether an emitter is a delta light.
    #[inline(always)]
    pub fn is_light(&self, k: u32) -> bool {
        let mut found = false;
        if comptime!(self.kinds.lights) {
            found = k >= self.triangle_count;
        }
        found
    }

    /// The delta light that an emitter is.
    #[inline(always)]
    pub fn light(&self, k: u32) -> DeltaLight {
        delta_light_at(self.lights, self.bits, k - self.triangle_count)
    }

    /// About the irradiance of a point that faces an emitter.
    #[inline(always)]
    pub fn brings(&self, k: u32, at: &Receiver) -> f32 {
        let mut seen = 0.0f32;
        if self.is_light(k) {
            if comptime!(self.kinds.lights) {
                seen = self.light(k).seen_from(at.position).scale;
            }
        } else {
            seen = self.triangle(k, at.time).angle(at.position);
        }
        self.brightness[k as usize] * seen
    }

    /// Looks at emitters from a point, for choices there: leaves the bits of the probabilities of few in `room`, and
    /// returns the probability of directional lights among many.
    #[inline(always)]
    pub fn look(&self, at: &Receiver, room: &mut [u32]) -> f32 {
        let mut share = 0.0f32;
        if comptime!(self.kinds.by_solid_angle) {
            let mut total = 0.0f32;
            for k in 0..self.tree.fixed.count {
                let brings = self.brings(k, at);
                total += brings;
                room[k as usize] = brings.to_bits();
            }
            for k in 0..self.tree.fixed.count {
                let brings = f32::from_bits(room[k as usize]);
                room[k as usize] = self.chance_of_few(k, brings, total).to_bits();
            }
        }
        if comptime!(self.kinds.by_tree) {
            share = self.tree.share_of_distant(at.position, at.normal);
        }
        share
    }

    /// The probability of one of few, of what it brings and of what all bring.
    #[inline(always)]
    pub fn chance_of_few(&self, k: u32, brings: f32, total: f32) -> f32 {
        let mut chance = self.tree.fixed.chances[k as usize];
        if is_positive(total) {
            chance = (1.0 - BY_POWER) * brings / total + BY_POWER * chance;
        }
        chance
    }

    /// The probability of an emitter, after [`look`](Self::look) from the same point.
    #[inline(always)]
    pub fn chance(&self, k: u32, at: &Receiver, share: f32, room: &mut [u32]) -> f32 {
        let mut chance = 0.0f32;
        if comptime!(self.kinds.by_tree) {
            chance = self.tree.chance(k, share, at.position, at.normal, room);
        } else {
            chance = self.known(k, room);
        }
        chance
    }

    /// That of one of few.
    #[inline(always)]
    fn known(&self, k: u32, room: &mut [u32]) -> f32 {
        let mut chance = self.tree.fixed.chances[k as usize];
        if comptime!(self.kinds.by_solid_angle) {
            chance = f32::from_bits(room[k as usize]);
        }
        chance
    }

    /// An emitter for a random number, after [`look`](Self::look) from the same point.
    #[inline(always)]
    pub fn choose(&self, u: f32, at: &Receiver, share: f32, room: &mut [u32]) -> Chosen {
        let mut choice = Chosen {
            emitter: 0u32,
            chance: 1.0f32,
            rest: u,
        };
        if comptime!(self.kinds.by_tree) {
            choice = self.tree.choose(u, share, at.position, at.normal, room);
        } else if comptime!(self.kinds.by_sums) {
            choice = self.tree.fixed.choose(u);
        } else {
            choice = self.choose_of_few(u, room);
        }
        choice
    }

    /// One of so few that all are looked at.
    #[inline(always)]
    fn choose_of_few(&self, u: f32, room: &mut [u32]) -> Chosen {
        let mut choosing = Choosing::begin();
        for k in 0..self.tree.fixed.count {
            choosing.pass(k, self.known(k, room), u);
        }
        choosing.end(u)
    }

    /// The probability of a group of emitters, which follow each other from the first on.
    #[inline(always)]
    pub fn chance_of_group(
        &self,
        first: u32,
        past: u32,
        at: &Receiver,
        share: f32,
        room: &mut [u32],
    ) -> f32 {
        let mut chance = 0.0f32;
        if comptime!(self.kinds.by_tree) {
            let x = at.position;
            let by_place = self
                .tree
                .chance_by_place(first, true, share, x, at.normal, room);
            chance = (1.0 - BY_POWER) * by_place;
        }
        for k in first..past {
            if comptime!(self.kinds.by_tree) {
                chance += BY_POWER * self.tree.fixed.chances[k as usize];
            } else {
                chance += self.known(k, room);
            }
        }
        chance
    }
}
