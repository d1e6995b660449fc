//! Accumulation of derivatives in kernels by integer atomics, so that sums do not depend on the order of additions.
//! Few GPUs support atomic addition of floats, and none in a repeatable order. Threads of a launch add to 64-bit sums
//! of two words, of which there are several replicas. Before the next launch, or where sums become numbers, these are
//! added to 96-bit sums.
//!
//! A derivative is multiplied by a power of two and rounded. There is one power for each part of a scene, chosen from
//! the largest derivatives of some of the paths. A derivative so large that a launch might overflow 64 bits is added
//! to the 96-bit sums directly.
//!
//! In forward mode the sums are those of pixels: a derivative with respect to a parameter is multiplied by the
//! parameter's tangents as soon as it is added. A part then has the products of one channel and direction, of all pixels.

#![allow(dead_code, reason = "kernels alone read and call what is here")]

use crate::cube::*;

use super::Derivatives;
use crate::model::choice::INFINITY;
use crate::model::integers::total;
use crate::model::numbers::{is_nonzero, magnitude};
use crate::model::{V3, component};

/// The limit below which scaled derivatives are added to 64 bits is at least this (log₂): above it f32 has no fractions.
pub const MIN_LIMIT: i32 = 24;

/// Bits of 2⁷⁸: scaled derivatives added to 96-bit sums are smaller, so that 2¹⁵ of the largest fit.
const MAX_SCALED_BITS: u32 = (78 + 127) << 23;

/// The third word of a sum of derivatives of which one is not finite, or too large for any sum. Its three highest bits
/// are those of no sum that fits, also after some more additions.
const NOT_FINITE: u32 = 0x7000_0000;

/// Bits of the smallest magnitude at which floats have no fractions.
const OF_WHOLES: u32 = (24 + 127) << 23;

/// Scale of parts whose derivatives are only measured.
pub const MEASURE: f32 = 0.0;

/// The sums that a thread adds to, the scales of their parts, and the requested derivatives.
#[derive(CubeType, Clone, Copy)]
#[expand(derive(Clone, Copy))]
pub struct Totals<'a> {
    /// The first two words of the sums of all launches, then the sums of the replicas, two words each, then the third words
    /// of the sums of all launches. While the derivatives are measured, there is a word for each part instead, which holds
    /// the bits of the largest finite one.
    pub sums: &'a [Atomic<u32>],
    /// The same list by two words, if the device can add to both at once.
    pub pairs: Pairs<'static>,
    /// First word of the replica for this launch, and the first one of the third words.
    pub replica: u32,
    pub above: u32,
    /// The number of parts, the scale of each, and the limit of scaled derivatives that are added to 64 bits.
    pub parts: u32,
    pub scales: &'a [f32],
    /// The first sum of each part of a scene.
    pub first: &'a [u32],
    pub along: Along<'a>,
    /// Whether the sums are those of pixels.
    #[cube(comptime)]
    pub forward: bool,
    #[cube(comptime)]
    pub of: Derivatives,
}

/// A list by two words, if a device can bind it so.
pub type Pairs<'a> = ComptimeOption<&'a [Atomic<u64>]>;

/// What forward mode multiplies with derivatives, and the pixel and channel to which the products belong.
#[derive(CubeType, Clone, Copy)]
#[expand(derive(Clone, Copy))]
pub struct Along<'a> {
    /// The tangents of the parameters' sums, `[S, K]`, and the number K of directions.
    pub tangents: &'a [f32],
    pub directions: u32,
    /// The number of pixels, the current one, and its channel.
    pub pixels: u32,
    pub pixel: u32,
    pub channel: u32,
}

/// Returns whether the third word of a sum says that a derivative was not finite.
#[cube]
pub fn is_marked(above: u32) -> bool {
    above >> 29 == comptime!(NOT_FINITE >> 29)
}

/// Returns 1 if the sum of two words wrapped; `word` is one of the two.
#[cube]
pub fn carry(sum: u32, word: u32) -> u32 {
    select(sum < word, 1u32, 0u32)
}

#[cube]
impl<'a> Totals<'a> {
    /// Adds a derivative to a sum of a part.
    pub fn add(&self, at: u32, value: f32, part: u32) {
        if is_nonzero(value) {
            let number = self.first[part as usize] + at;
            if comptime!(self.forward) {
                for k in 0..self.along.directions {
                    self.add_along(k, value * self.tangent(number, k));
                }
            } else {
                self.add_scaled(number, value, part);
            }
        }
    }

    /// Adds a vector of three derivatives.
    pub fn add_vector(&self, at: u32, value: V3, part: u32) {
        if comptime!(self.forward) {
            if is_nonzero(value.abs().element_sum()) {
                let number = self.first[part as usize] + at;
                for k in 0..self.along.directions {
                    let x = value.x * self.tangent(number, k);
                    let y = value.y * self.tangent(number + 1, k);
                    let z = value.z * self.tangent(number + 2, k);
                    self.add_along(k, x + y + z);
                }
            }
        } else {
            let mut k = 0u32;
            while k < 3 {
                self.add(at + k, component(value, k), part);
                k += 1;
            }
        }
    }

    /// Returns the tangent of a parameter's sum in a direction.
    fn tangent(&self, number: u32, direction: u32) -> f32 {
        self.along.tangents[(number * self.along.directions + direction) as usize]
    }

    /// Adds the derivative of the current pixel and channel in a direction.
    fn add_along(&self, direction: u32, value: f32) {
        if is_nonzero(value) {
            let part = self.along.channel * self.along.directions + direction;
            self.add_scaled(part * self.along.pixels + self.along.pixel, value, part);
        }
    }

    /// Adds a nonzero number to a sum, or only measures it ([`MEASURE`]).
    fn add_scaled(&self, number: u32, value: f32, part: u32) {
        let scale = self.scales[part as usize];
        let scaled = value * scale;
        let size = magnitude(scaled);
        if scale == MEASURE {
            self.look_at(part, magnitude(value));
        } else if size < MAX_SCALED_BITS {
            self.add_whole(number, scaled, size);
        } else {
            // Infinity and NaN are above every limit.
            self.sums[(self.above + number) as usize].store(NOT_FINITE);
        }
    }

    /// Stores the largest finite derivative of a part, as bits.
    fn look_at(&self, part: u32, bits: u32) {
        let largest = &self.sums[part as usize];
        // Few are larger than those before.
        if largest.load() < bits && bits < INFINITY {
            largest.fetch_max(bits);
        }
    }

    /// Adds a rounded number to a 64-bit sum, or to a 96-bit sum if its magnitude `size`, as bits, reaches the limit.
    fn add_whole(&self, number: u32, scaled: f32, size: u32) {
        let wide = size >= self.scales[self.parts as usize].to_bits();
        let first = 2 * number + select(wide, 0u32, self.replica);
        let third = self.above + number;
        let mut digits = (scaled.abs() + 0.5).floor() as u32;
        let mut shift = 0u32;
        if size >= OF_WHOLES {
            digits = (size & 0x007f_ffff) | 0x0080_0000u32;
            shift = (size >> 23) - 150u32;
        }
        // Two's complement of negative numbers.
        let flip = select(scaled < 0.0, 0xffff_ffffu32, 0u32);
        #[comptime]
        match self.pairs {
            ComptimeOption::Some(pairs) => {
                let all = select(scaled < 0.0, 0xffff_ffff_ffff_ffffu64, 0u64);
                let more = ((digits as u64) << (shift as u64) ^ all) + (all & 1);
                let before = pairs[(first / 2) as usize].fetch_add(more);
                if wide {
                    let above = (digits >> 1) >> (63 - shift).min(31);
                    let mut carried = select(before > !more, 1u32, 0u32);
                    carried += select(more == 0, flip & 1, 0u32);
                    self.sums[third as usize].fetch_add(total(above ^ flip, carried));
                }
            }
            ComptimeOption::None => {
                let words = select(wide, 3u32, 2u32);
                self.add_words(first, third, words, digits, shift, flip);
            }
        }
    }

    /// Adds a number word by word: `digits`, shifted left by `shift` bits, or its two's complement if all bits of `flip`
    /// are set. The first two words of the sum begin at `first`, and its third word is at `third`.
    fn add_words(&self, first: u32, third: u32, words: u32, digits: u32, shift: u32, flip: u32) {
        let by = shift % 32;
        let mut carried = flip & 1;
        let mut k = 0u32;
        while k < words {
            let mut word = select(k == shift / 32, digits << by, 0u32);
            word = select(k == shift / 32 + 1, (digits >> 1) >> (31 - by), word);
            word = word ^ flip;
            let more = total(word, carried);
            carried = carry(more, carried);
            if more != 0 {
                let at = select(k == 2, third, first + k);
                let before = self.sums[at as usize].fetch_add(more);
                carried += carry(total(before, more), more);
            }
            k += 1;
        }
    }
}
