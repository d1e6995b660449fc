//! The emitters of a scene as lists, and the choice of an emitter, in one source for the host and GPUs.

#![allow(unused_assignments)] // Variables of a kernel require an initial value.
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
use crate::model::choice::{MAX_UNIFORM, is_positive};
use crate::model::delta_light::{DeltaLight, delta_light_at};
use crate::model::emitter::hit_front;
use crate::model::lists::vector;
use crate::model::triangle::solid_angle;
use crate::model::{V2, V3, v2};

/// The emitters that a scene has, and how one is chosen. GPU kernels are compiled for these values.
#[derive(Clone, Copy, Debug, Default, Hash, PartialEq, Eq)]
pub struct EmitterKinds {
    /// Whether there are delta lights, and whether triangles move.
    pub lights: bool,
    pub moves: bool,
    /// The choice by the solid angles of all emitters, by a tree, or by running sums of fixed probabilities. Otherwise,
    /// fixed probabilities are passed one after another.
    pub by_solid_angle: bool,
    pub by_tree: bool,
    pub by_sums: bool,
    /// The number of words of scratch space (`room`) that a choice requires.
    pub room: usize,
}

impl EmitterKinds {
    /// The largest number of words of scratch space that a choice requires.
    pub const MAX_ROOM: usize = MAX_SOLID_ANGLES;
}

/// The largest number of emitters for which solid angles are computed at every point.
pub(super) const MAX_SOLID_ANGLES: usize = 64;

/// The emitters of a scene as lists. Triangles are numbered first, then delta lights.
#[cfg_attr(feature = "gpu", derive(CubeType))]
#[derive(Clone, Copy)]
pub struct EmitterLists<'a> {
    /// [`OF_EMITTER`] numbers of each triangle: corners, normal, area and velocity.
    pub triangles: &'a [f32],
    pub triangle_count: u32,
    pub lights: &'a [f32],
    pub bits: &'a [u32],
    /// The factor of each emitter's light: mean radiance, intensity or irradiance.
    pub brightness: &'a [f32],
    /// The tree over many emitters, and the fixed probabilities of all emitters.
    pub tree: LightTree<'a>,
    #[cfg_attr(feature = "gpu", cube(comptime))]
    pub kinds: EmitterKinds,
}

pub const OF_EMITTER: usize = 16;

/// A surface point for which an emitter is chosen.
#[apply(record!)]
pub struct Receiver {
    pub position: V3,
    /// The geometric normal on the side that the path's ray came from.
    pub normal: V3,
    /// The shutter time.
    pub time: f32,
}

/// An emitting triangle at a shutter time.
#[apply(record!)]
pub struct EmitterTriangle {
    pub a: V3,
    pub b: V3,
    pub c: V3,
    pub normal: V3,
    pub area: f32,
}

#[cfg_attr(feature = "gpu", cube)]
impl EmitterTriangle {
    /// Returns the triangle, translated by a vector.
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

    /// Returns the solid angle under which a point sees the triangle's front.
    #[inline(always)]
    pub fn angle(&self, from: V3) -> f32 {
        max(solid_angle(self.a, self.b, self.c, from), 0.0)
    }
}

/// The point where a ray hits an emitter's front, regardless of occluders.
#[apply(record!)]
pub struct EmitterHit {
    /// The emitter, or [`NONE`] without a hit.
    pub emitter: u32,
    pub distance: f32,
    /// Weights of the corners b and c.
    pub weights: V2,
}

#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn no_emitter_hit() -> EmitterHit {
    EmitterHit {
        emitter: NONE.runtime(),
        distance: 0.0f32.runtime(),
        weights: v2(0.0, 0.0),
    }
}

/// A choice among few emitters, which passes them one after another.
#[apply(zeroed!)]
pub struct Choosing {
    emitter: u32,
    chance: f32,
    /// The sums of the probabilities before the chosen emitter, and before the next one.
    before: f32,
    passed: f32,
    /// The sum up to and including the chosen emitter. Once it exceeds the random number, the choice is final.
    past: f32,
}

#[cfg_attr(feature = "gpu", cube)]
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

    /// Passes an emitter, and chooses it if its probability is above 0 and the choice is not final. Rounding may leave
    /// the total a little under 1. Then the last emitter with a probability is chosen.
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
            rest: min(max((u - self.before) / self.chance, 0.0), MAX_UNIFORM),
        }
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl<'a> EmitterLists<'a> {
    /// Intersects a ray with the front of a triangle.
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

    /// Returns a triangle at a shutter time.
    #[inline(always)]
    pub fn triangle(&self, k: u32, time: f32) -> EmitterTriangle {
        let mut found = self.at_rest(k);
        if comptime!(self.kinds.moves) {
            found = found.moved(self.velocity(k) * time);
        }
        found
    }

    /// Returns a triangle at the start of the shutter time.
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

    /// Returns the displacement of a triangle over the shutter time.
    #[inline(always)]
    pub fn velocity(&self, k: u32) -> V3 {
        vector(self.triangles, OF_EMITTER as u32 * k + 13)
    }

    /// Returns whether an emitter is a delta light.
    #[inline(always)]
    pub fn is_light(&self, k: u32) -> bool {
        let mut found = false;
        if comptime!(self.kinds.lights) {
            found = k >= self.triangle_count;
        }
        found
    }

    /// Returns the delta light with an emitter's number.
    #[inline(always)]
    pub fn light(&self, k: u32) -> DeltaLight {
        delta_light_at(self.lights, self.bits, k - self.triangle_count)
    }

    /// Estimates the irradiance that an emitter brings to a point that faces it.
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

    /// Prepares choices at a point. For a choice by solid angle, it stores the bits of all probabilities in `room`. For
    /// a tree, it returns the probability of directional lights; otherwise it returns 0.
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

    /// Returns the probability of one of few emitters, from the light that it brings and the light that all bring.
    #[inline(always)]
    pub fn chance_of_few(&self, k: u32, brings: f32, total: f32) -> f32 {
        let mut chance = self.tree.fixed.chances[k as usize];
        if is_positive(total) {
            chance = (1.0 - BY_POWER) * brings / total + BY_POWER * chance;
        }
        chance
    }

    /// Returns the probability of an emitter. Requires a call of [`look`](Self::look) at the same point.
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

    /// Returns the probability of an emitter without a tree.
    #[inline(always)]
    fn known(&self, k: u32, room: &mut [u32]) -> f32 {
        let mut chance = self.tree.fixed.chances[k as usize];
        if comptime!(self.kinds.by_solid_angle) {
            chance = f32::from_bits(room[k as usize]);
        }
        chance
    }

    /// Chooses an emitter with a random number. Requires a call of [`look`](Self::look) at the same point.
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

    /// Chooses one of few emitters by passing them all.
    #[inline(always)]
    fn choose_of_few(&self, u: f32, room: &mut [u32]) -> Chosen {
        let mut choosing = Choosing::begin();
        for k in 0..self.tree.fixed.count {
            choosing.pass(k, self.known(k, room), u);
        }
        choosing.end(u)
    }

    /// Returns the probability of a group of emitters, whose numbers are `first..past`.
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
