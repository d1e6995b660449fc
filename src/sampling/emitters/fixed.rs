//! The choice of an emitter with probabilities that are known.

#![allow(
    clippy::manual_clamp,
    reason = "the language of kernels has no other form"
)]

use crate::cube::*;
use crate::model::choice::MOST;
use crate::model::lists::first_over;

/// Probabilities that do not depend on the point, and sums of these up to each emitter.
#[cfg_attr(feature = "wgpu", derive(CubeType))]
#[derive(Clone, Copy)]
pub(crate) struct Fixed<'a> {
    pub chances: &'a [f32],
    pub sums: &'a [f32],
    pub count: u32,
}

/// A choice that was made, its probability, and what is left of the random number.
#[apply(record!)]
pub(crate) struct Chosen {
    pub emitter: u32,
    pub chance: f32,
    pub rest: f32,
}

#[cfg_attr(feature = "wgpu", cube)]
impl<'a> Fixed<'a> {
    /// One of many, for a random number.
    #[inline(always)]
    pub fn choose(&self, u: f32) -> Chosen {
        let mut k = first_over(self.sums, 0u32, self.count, 1u32, u);
        // Rounding may leave the sum a little under 1: then the last that can be is taken.
        while k > 0 && self.chances[k as usize] <= 0.0 {
            k -= 1;
        }
        let chance = self.chances[k as usize];
        let mut before = 0.0f32;
        if k > 0 {
            before = self.sums[(k - 1) as usize];
        }
        Chosen {
            emitter: k,
            chance,
            rest: ((u - before) / chance).max(0.0).min(MOST),
        }
    }
}

impl Chosen {
    /// The emitter, its probability, and what is left of the number.
    #[inline(always)]
    pub(super) fn parts(self) -> (usize, f32, f32) {
        (self.emitter as usize, self.chance, self.rest)
    }
}

/// An index drawn with its probability, that, and what is left of the number.
#[inline(always)]
pub(super) fn one_of(p: &[f32], u: f32) -> (usize, f32, f32) {
    let (mut k, mut passed) = (0, 0.0);
    // Rounding may leave the sum a little under 1: then the last that can be is taken.
    let mut taken = (0, 0.0);
    while k < p.len() {
        if p[k] > 0.0 {
            taken = (k, passed);
            if u < passed + p[k] {
                break;
            }
        }
        passed += p[k];
        k += 1;
    }
    let (k, before) = taken;
    let rest = (u - before) / p[k];
    (k, p[k], rest.clamp(0.0, 1.0 - f32::EPSILON))
}
