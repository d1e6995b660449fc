//! Sums of derivatives in kernels, by atomic additions of whole numbers, so that they are the same whatever the
//! order: few GPUs add floats, and none in an order that repeats. Threads of a launch add to 64 bits in two words, of
//! several replicas; after it these are added to sums of 96 bits.
//!
//! A derivative is multiplied by a power of two and rounded. The powers are one for each part of a scene, and
//! come from the largest derivatives of some of the paths. One that is so large that 64 bits might not hold all of a
//! launch is not added but counted as lost.

#![allow(dead_code, reason = "kernels alone read and call what is here")]

use crate::cube::*;

use super::Derivatives;
use super::parts::PARTS;
use crate::model::integers::total;
use crate::model::numbers::{is_nonzero, magnitude};
use crate::model::{V3, component};

/// Words before the sums of a replica: the largest derivative of each part, by its bits, then the number of those
/// that no sum holds.
pub(crate) const FIRST_SUM: usize = 16;
pub(crate) const LOST: usize = 15;

/// Behind the scales of all parts: how large a derivative may be, times its scale, to be added.
pub(crate) const LIMIT: usize = PARTS;

/// The scale of parts of whose derivatives only the sizes are looked at.
pub(crate) const MEASURE: f32 = 0.0;

/// The sums that a thread adds to, the scales of their parts, and the derivatives that are summed.
#[derive(CubeType, Clone, Copy)]
pub(crate) struct Totals<'a> {
    pub totals: &'a [Atomic<u32>],
    pub scales: &'a [f32],
    /// The first sum of each part.
    pub first: &'a [u32],
    #[cube(comptime)]
    pub of: Derivatives,
}

#[cube]
impl<'a> Totals<'a> {
    /// Adds a derivative to a sum of a part, or looks at its size alone ([`MEASURE`]).
    pub fn add(&self, at: u32, value: f32, part: u32) {
        if is_nonzero(value) {
            let scale = self.scales[part as usize];
            if scale == MEASURE {
                self.totals[part as usize].fetch_max(magnitude(value));
            } else {
                let scaled = value * scale;
                // What is infinite or NaN is above every limit.
                if magnitude(scaled) < self.scales[LIMIT].to_bits() {
                    let rounded = (scaled.abs() + 0.5).floor();
                    let upper = (rounded * (1.0f32 / 4_294_967_296.0f32)).floor();
                    let mut low = (rounded - upper * 4_294_967_296.0) as u32;
                    let mut high = upper as u32;
                    if scaled < 0.0 {
                        // The two's complement.
                        low = total(!low, 1u32);
                        high = !high;
                        if low == 0 {
                            high = total(high, 1u32);
                        }
                    }
                    let i = FIRST_SUM + 2 * (self.first[part as usize] + at) as usize;
                    let before = self.totals[i].fetch_add(low);
                    if total(before, low) < low {
                        high = total(high, 1u32);
                    }
                    if high != 0 {
                        self.totals[i + 1].fetch_add(high);
                    }
                } else {
                    self.totals[LOST].fetch_add(1u32);
                }
            }
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
