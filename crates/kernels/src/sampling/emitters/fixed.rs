//! The choice of an emitter with probabilities that do not depend on the point.

#![allow(
    clippy::manual_clamp,
    reason = "the language of kernels has no other form"
)]

use crate::cube::*;
use crate::model::choice::MAX_UNIFORM;
use crate::model::lists::first_over;

/// Probabilities that do not depend on the point, and their running sums.
#[cfg_attr(feature = "gpu", derive(CubeType))]
#[derive(Clone, Copy)]
pub struct Fixed<'a> {
    pub chances: &'a [f32],
    pub sums: &'a [f32],
    pub count: u32,
}

/// A chosen emitter, its probability, and the rest of the random number, which is uniform again.
#[apply(zeroed!)]
pub struct Chosen {
    pub emitter: u32,
    pub chance: f32,
    pub rest: f32,
}

#[cfg_attr(feature = "gpu", cube)]
impl<'a> Fixed<'a> {
    /// Chooses one of many emitters with a random number.
    #[inline(always)]
    pub fn choose(&self, u: f32) -> Chosen {
        let mut k = first_over(self.sums, 0u32, self.count, 1u32, u);
        // Rounding may leave the total a little under 1. Then the last emitter with a probability is chosen.
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
            rest: min(max((u - before) / chance, 0.0), MAX_UNIFORM),
        }
    }
}
