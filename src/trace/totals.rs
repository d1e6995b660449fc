//! Sums of derivatives in kernels, by atomic additions of whole numbers, so that they are the same whatever the
//! order: few GPUs add floats, and none in an order that repeats. Threads of a launch add to 64 bits in two words, of
//! several replicas; after it these are added to sums of 96 bits.
//!
//! A derivative is multiplied by a power of two and rounded. The powers are one for each part of a scene, and
//! come from the largest derivatives of some of the paths. One that is so much larger that 64 bits might not hold all
//! of a launch is added to the sums of 96 bits.

#![allow(dead_code, reason = "kernels alone read and call what is here")]

use crate::cube::*;

use super::Derivatives;
use super::parts::PARTS;
use crate::model::choice::INFINITY;
use crate::model::integers::total;
use crate::model::numbers::{is_nonzero, magnitude};
use crate::model::{V3, component};

/// Words before the sums, one a part: the bits of the largest derivative while these are measured; then those of
/// infinity, if one was not finite or too large for any sum.
pub(crate) const FIRST_SUM: usize = 16;
const _: () = assert!(PARTS <= FIRST_SUM);

/// Behind the scales of all parts: how large a derivative may be, times its scale, to be added to 64 bits; at least
/// [`LEAST_LIMIT`], above which f32 has no fractions.
pub(crate) const LIMIT: usize = PARTS;
pub(crate) const LEAST_LIMIT: i32 = 24;

/// Derivatives, times their scale, that are added to sums of 96 bits are less than 2⁷⁸, so that 2¹⁷ of the largest have
/// room; by its bits.
const MOST: u32 = (78 + 127) << 23;

/// The least size, by its bits, of numbers without fractions.
const OF_WHOLES: u32 = (24 + 127) << 23;

/// The scale of parts of whose derivatives only the sizes are looked at.
pub(crate) const MEASURE: f32 = 0.0;

/// The sums that a thread adds to, the scales of their parts, and the derivatives that are summed.
#[derive(CubeType, Clone, Copy)]
pub(crate) struct Totals<'a> {
    /// Of all launches, three words a number, behind those of parts; then those of replicas.
    pub sums: &'a [Atomic<u32>],
    /// The first word of the replica for this launch, which has two words a number.
    pub replica: u32,
    pub scales: &'a [f32],
    /// The first sum of each part.
    pub first: &'a [u32],
    #[cube(comptime)]
    pub of: Derivatives,
}

/// 1 if a sum of two words, of which one is given, has wrapped.
#[cube]
pub(crate) fn carry(sum: u32, word: u32) -> u32 {
    select(sum < word, 1u32, 0u32)
}

#[cube]
impl<'a> Totals<'a> {
    /// Adds a derivative to a sum of a part, or looks at its size alone ([`MEASURE`]).
    pub fn add(&self, at: u32, value: f32, part: u32) {
        if is_nonzero(value) {
            let scale = self.scales[part as usize];
            let scaled = value * scale;
            let size = magnitude(scaled);
            if scale == MEASURE {
                self.look_at(part, magnitude(value));
            } else if size < MOST {
                self.add_whole(self.first[part as usize] + at, scaled, size);
            } else {
                // What is infinite or NaN is above every limit.
                self.look_at(part, INFINITY.runtime());
            }
        }
    }

    /// Keeps the largest derivative of a part, by its bits.
    fn look_at(&self, part: u32, bits: u32) {
        let largest = &self.sums[part as usize];
        // Few are larger than those before.
        if largest.load() < bits {
            largest.fetch_max(bits);
        }
    }

    /// Adds a number, rounded, to one of 64 bits, or of 96 bits if its size, by its bits, is over the limit.
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
        // The two's complement of negative numbers.
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

    /// Adds three derivatives.
    pub fn add_vector(&self, at: u32, value: V3, part: u32) {
        let mut k = 0u32;
        while k < 3 {
            self.add(at + k, component(value, k), part);
            k += 1;
        }
    }
}
