//! Accumulation of derivatives in kernels by integer atomics, so that sums do not depend on the order of additions.
//! Few GPUs support atomic addition of floats, and none in a repeatable order. Threads of a launch add to 64-bit sums
//! of two words, of which there are several replicas. After the launch these are added to 96-bit sums.
//!
//! A derivative is multiplied by a power of two and rounded. There is one power for each part of a scene, chosen from
//! the largest derivatives of some of the paths. A derivative so large that a launch might overflow 64 bits is added
//! to the 96-bit sums directly.

#![allow(dead_code, reason = "kernels alone read and call what is here")]

use crate::cube::*;

use super::Derivatives;
use super::parts::PARTS;
use crate::model::choice::INFINITY;
use crate::model::integers::total;
use crate::model::numbers::{is_nonzero, magnitude};
use crate::model::{V3, component};

/// Words before the sums, one per part. While the derivatives are measured, a word holds the bits of the largest one.
/// Afterwards it holds the bits of infinity if a derivative was not finite or too large for any sum.
pub(crate) const FIRST_SUM: usize = 16;
const _: () = assert!(PARTS <= FIRST_SUM);

/// Index, behind the scales of all parts, of the limit: scaled derivatives below it are added to 64 bits. It is at
/// least [`MIN_LIMIT`] (log₂), above which f32 has no fractions.
pub(crate) const LIMIT: usize = PARTS;
pub(crate) const MIN_LIMIT: i32 = 24;

/// Bits of 2⁷⁸: scaled derivatives added to 96-bit sums are smaller, so that 2¹⁷ of the largest fit.
const MAX_SCALED_BITS: u32 = (78 + 127) << 23;

/// Bits of the smallest magnitude at which floats have no fractions.
const OF_WHOLES: u32 = (24 + 127) << 23;

/// Scale of parts whose derivatives are only measured.
pub(crate) const MEASURE: f32 = 0.0;

/// The sums that a thread adds to, the scales of their parts, and the requested derivatives.
#[derive(CubeType, Clone, Copy)]
pub(crate) struct Totals<'a> {
    /// Sums of all launches, three words each, behind the words of the parts; then the sums of the replicas.
    pub sums: &'a [Atomic<u32>],
    /// First word of the replica for this launch, which has two words per sum.
    pub replica: u32,
    pub scales: &'a [f32],
    /// The first sum of each part.
    pub first: &'a [u32],
    #[cube(comptime)]
    pub of: Derivatives,
}

/// Returns 1 if the sum of two words wrapped; `word` is one of the two.
#[cube]
pub(crate) fn carry(sum: u32, word: u32) -> u32 {
    select(sum < word, 1u32, 0u32)
}

#[cube]
impl<'a> Totals<'a> {
    /// Adds a derivative to a sum of a part, or only measures it ([`MEASURE`]).
    pub fn add(&self, at: u32, value: f32, part: u32) {
        if is_nonzero(value) {
            let scale = self.scales[part as usize];
            let scaled = value * scale;
            let size = magnitude(scaled);
            if scale == MEASURE {
                self.look_at(part, magnitude(value));
            } else if size < MAX_SCALED_BITS {
                self.add_whole(self.first[part as usize] + at, scaled, size);
            } else {
                // Infinity and NaN are above every limit.
                self.look_at(part, INFINITY.runtime());
            }
        }
    }

    /// Stores the largest derivative of a part, as bits.
    fn look_at(&self, part: u32, bits: u32) {
        let largest = &self.sums[part as usize];
        // Few are larger than those before.
        if largest.load() < bits {
            largest.fetch_max(bits);
        }
    }

    /// Adds a rounded number to a 64-bit sum, or to a 96-bit sum if its magnitude `size`, as bits, reaches the limit.
    fn add_whole(&self, number: u32, scaled: f32, size: u32) {
        let mut words = 2u32;
        let mut first = self.replica + 2 * number;
        if size >= self.scales[LIMIT].to_bits() {
            words = 3u32;
            first = FIRST_SUM as u32 + 3 * number;
        }
        let mut digits = (scaled.abs() + 0.5).floor() as u32;
        let mut shift = 0u32;
        if size >= OF_WHOLES {
            digits = (size & 0x007f_ffff) | 0x0080_0000u32;
            shift = (size >> 23) - 150u32;
        }
        let by = shift % 32;
        // Two's complement of negative numbers.
        let flip = select(scaled < 0.0, 0xffff_ffffu32, 0u32);
        let mut carried = flip & 1;
        let mut k = 0u32;
        while k < words {
            let mut word = select(k == shift / 32, digits << by, 0u32);
            word = select(k == shift / 32 + 1, (digits >> 1) >> (31 - by), word);
            word = word ^ flip;
            let more = total(word, carried);
            carried = carry(more, carried);
            if more != 0 {
                let before = self.sums[(first + k) as usize].fetch_add(more);
                carried += carry(total(before, more), more);
            }
            k += 1;
        }
    }

    /// Adds a vector of three derivatives.
    pub fn add_vector(&self, at: u32, value: V3, part: u32) {
        let mut k = 0u32;
        while k < 3 {
            self.add(at + k, component(value, k), part);
            k += 1;
        }
    }
}
