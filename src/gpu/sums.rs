//! Sums of derivatives in kernels, by atomic additions of whole numbers, so that they are the same whatever the
//! order: few GPUs add floats, and none in an order that repeats. Threads of a launch add to 64 bits in two words, of
//! several replicas; after it these are added to sums of 96 bits.
//!
//! A derivative is multiplied by a power of two and rounded. The powers are one for each part of a scene, and
//! come from the largest derivatives of some of the paths. One that is so large that 64 bits might not hold all of a
//! launch is not added but counted as lost.

use burn::cubecl::{self, prelude::*};

use super::Derivatives;
use super::finite::{is_nonzero, magnitude, not_a_number};
use crate::model::V3;
use crate::model::choice::INFINITY;
use crate::model::integers::total;

/// Parts of a scene, each with a power of two of its own.
pub(super) const VERTICES: usize = 0;
pub(super) const TRIANGLES: usize = 1;
pub(super) const AREAS: usize = 2;
pub(super) const VELOCITIES: usize = 3;
pub(super) const UVS: usize = 4;
pub(super) const NORMALS: usize = 5;
pub(super) const MATERIALS: usize = 6;
pub(super) const TEXELS: usize = 7;
pub(super) const SKY: usize = 8;
pub(super) const COLOURS: usize = 9;
pub(super) const TANGENTS: usize = 10;
pub(super) const LIGHTS: usize = 11;
pub(super) const CAMERA: usize = 12;
pub(super) const PARTS: usize = 13;

/// Behind the scales of all parts: how large a derivative may be, times its scale, to be added; and for each view how much
/// a loss depends on the radiance of a pixel, then how much on a pixel as a whole, on average.
pub(super) const LIMIT: usize = PARTS;
pub(super) const TYPICAL: usize = PARTS + 1;

/// Sums of a light without extent ([`DeltaSums`]) and of a camera ([`CameraSums`]).
///
/// [`DeltaSums`]: crate::kernel::DeltaSums
/// [`CameraSums`]: crate::kernel::CameraSums
pub(super) const OF_LIGHT: usize = 11;
pub(super) const OF_CAMERA: usize = 20;

/// Words before the sums of a replica: the largest derivative of each part, by its bits, then the number of those
/// that no sum holds.
pub(super) const FIRST_SUM: usize = 16;
pub(super) const LOST: usize = 15;

/// The scale of a part with derivatives that are not finite.
const NO_SCALE: f32 = -1.0;

/// A power of two for a part, from the bits of its largest derivative and of the largest of all parts: steps of the
/// sums are 2 to the power of −`keep` of it, the rest of 63 bits is room.
#[cube]
pub(super) fn scale_of(largest: u32, of_all: u32, keep: i32) -> f32 {
    let mut bits = largest;
    if bits == 0 {
        // A part that was not reached has the scale of the others.
        bits = of_all;
    }
    let mut scale = NO_SCALE.runtime();
    if bits < INFINITY {
        // The power of two that is not less.
        let mut exponent = (bits >> 23) as i32 - 127;
        if bits & 0x007f_ffff != 0 {
            exponent += 1;
        }
        if bits == 0 {
            exponent = 0;
        }
        let power = (keep - exponent).max(-80).min(120);
        scale = f32::from_bits(((power + 127) as u32) << 23);
    }
    scale
}

/// The scale of all parts where a pass has nothing to do.
const SKIPPED: f32 = -2.0;

/// Whether a pass has nothing to do.
#[cube]
pub(super) fn is_skipped(scales: &[f32]) -> bool {
    scales[0] == SKIPPED
}

/// Lets a second pass look at all derivatives, where the first has lost any; else it has nothing to do.
#[cube(launch)]
pub(super) fn look_again(
    totals: &[u32],
    scales: &[f32],
    again: &mut [f32],
    replicas: u32,
    region: u32,
) {
    if ABSOLUTE_POS < scales.len() {
        let mut scale = scales[ABSOLUTE_POS];
        if ABSOLUTE_POS < PARTS {
            scale = SKIPPED;
            let mut replica = 0u32;
            while replica < replicas {
                if totals[(replica * region) as usize + LOST] > 0 {
                    scale = MEASURE;
                }
                replica += 1;
            }
        }
        again[ABSOLUTE_POS] = scale;
    }
}

/// Chooses the scales of parts from the largest derivatives that a measuring launch left in all replicas.
#[cube(launch)]
pub(super) fn choose_scales(
    totals: &[u32],
    scales: &mut [f32],
    replicas: u32,
    region: u32,
    keep: i32,
    views: u32,
) {
    if ABSOLUTE_POS < PARTS && scales[ABSOLUTE_POS] != SKIPPED {
        let mut own = 0u32;
        let mut most = 0u32;
        let mut part = 0usize;
        while part < PARTS {
            let mut largest = 0u32;
            let mut replica = 0u32;
            while replica < replicas {
                largest = largest.max(totals[(replica * region) as usize + part]);
                replica += 1;
            }
            if part == ABSOLUTE_POS {
                own = largest;
            }
            if largest < INFINITY {
                most = most.max(largest);
            }
            part += 1;
        }
        if most == 0 {
            // Nothing was reached, perhaps since the loss depends on few pixels.
            let mut view = 0usize;
            while view < views as usize {
                let bits = scales[TYPICAL + views as usize + view].to_bits();
                if bits < INFINITY {
                    most = most.max(bits);
                }
                view += 1;
            }
        }
        scales[ABSOLUTE_POS] = scale_of(own, most, keep);
    }
}

/// Adds what all replicas have of a number to its sum of three words, and takes it from them.
#[cube(launch)]
pub(super) fn add_replicas(
    totals: &mut [u32],
    scales: &[f32],
    sums: &mut [u32],
    replicas: u32,
    region: u32,
    numbers: u32,
) {
    if ABSOLUTE_POS < numbers as usize && !is_skipped(scales) {
        let mut low = 0u32;
        let mut high = 0u32;
        let mut replica = 0u32;
        while replica < replicas {
            let from = (replica * region) as usize + FIRST_SUM + 2 * ABSOLUTE_POS;
            let own = totals[from];
            low = total(low, own);
            high = total(high, totals[from + 1]);
            if low < own {
                high = total(high, 1u32);
            }
            totals[from] = 0;
            totals[from + 1] = 0;
            replica += 1;
        }
        // The sign goes on in the third word.
        let mut above = 0u32;
        if high >> 31 == 1 {
            above = 0xffff_ffffu32;
        }
        let at = 3 * ABSOLUTE_POS;
        let first = total(sums[at], low);
        let mut second = total(sums[at + 1], high);
        if second < high {
            above = total(above, 1u32);
        }
        if first < low {
            second = total(second, 1u32);
            if second == 0 {
                above = total(above, 1u32);
            }
        }
        sums[at] = first;
        sums[at + 1] = second;
        sums[at + 2] = total(sums[at + 2], above);
    }
}

/// Sets all words to 0, unless a pass has nothing to do.
#[cube(launch)]
pub(super) fn clear(words: &mut [u32], scales: &[f32]) {
    if ABSOLUTE_POS < words.len() && !is_skipped(scales) {
        words[ABSOLUTE_POS] = 0;
    }
}

/// Takes the scales of the second pass, if it had anything to do.
#[cube(launch)]
pub(super) fn take_scales(again: &[f32], scales: &mut [f32]) {
    if ABSOLUTE_POS < PARTS && !is_skipped(again) {
        scales[ABSOLUTE_POS] = again[ABSOLUTE_POS];
    }
}

/// A sum of a part as a number; NaN where derivatives of the part are not finite.
#[cube]
pub(super) fn sum_at(sums: &[u32], scales: &[f32], at: u32, part: u32) -> f32 {
    let scale = scales[part as usize];
    let first = 3 * at as usize;
    let mut low = sums[first];
    let mut high = sums[first + 1];
    let mut above = sums[first + 2];
    let negative = above >> 31 == 1;
    if negative {
        // The two's complement.
        low = total(!low, 1u32);
        high = !high;
        above = !above;
        if low == 0 {
            high = total(high, 1u32);
            if high == 0 {
                above = total(above, 1u32);
            }
        }
    }
    let mut value = (above as f32 * 4_294_967_296.0 + high as f32) * 4_294_967_296.0 + low as f32;
    if negative {
        value = -value;
    }
    if scale > 0.0 {
        value = value / scale;
    } else {
        value = not_a_number(scale);
    }
    value
}

/// Where the words of a thread's replica begin.
#[cube]
pub(super) fn replica_of(thread: u32, replicas: u32, region: u32) -> usize {
    (thread % replicas * region) as usize
}

/// The scale of parts of whose derivatives only the sizes are looked at.
pub(super) const MEASURE: f32 = 0.0;

/// Bits of derivatives, times their scale, of which so many have room in a sum: those of derivatives that were all
/// measured.
pub(super) fn bits_of_each(derivatives: u64) -> i32 {
    (61 - (u64::BITS - derivatives.leading_zeros()) as i32).clamp(16, 40 + MORE)
}

/// Bits that derivatives may be larger by than those that were measured, if not all were.
const MORE: i32 = 12;

/// Bits of the largest derivative that was measured: one less than there is room for, since a power of two takes all.
pub(super) fn kept(bits: i32, all_measured: bool) -> i32 {
    bits - if all_measured { 1 } else { MORE }
}

/// A component of a vector, by its number.
#[cube]
pub(super) fn component(v: V3, k: u32) -> f32 {
    let mut found = v.x;
    if k == 1 {
        found = v.y;
    } else if k == 2 {
        found = v.z;
    }
    found
}

/// The sums that a thread adds to, the scales of their parts, and the derivatives that are summed.
#[derive(CubeType, Clone, Copy)]
pub(super) struct Totals<'a> {
    totals: &'a [Atomic<u32>],
    scales: &'a [f32],
    #[cube(comptime)]
    pub of: Derivatives,
}

#[cube]
impl<'a> Totals<'a> {
    pub fn new(
        totals: &'a [Atomic<u32>],
        scales: &'a [f32],
        #[comptime] of: Derivatives,
    ) -> Totals<'a> {
        Totals::<'a> { totals, scales, of }
    }

    /// Adds a derivative to a sum of a part, or looks at its size alone ([`MEASURE`]).
    pub fn add(&self, at: u32, value: f32, #[comptime] part: usize) {
        if is_nonzero(value) {
            let scale = self.scales[part];
            if scale == MEASURE {
                self.totals[part].fetch_max(magnitude(value));
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
                    let i = FIRST_SUM + 2 * at as usize;
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
    pub fn add_vector(&self, at: u32, value: V3, #[comptime] part: usize) {
        let mut k = 0u32;
        while k < 3 {
            self.add(at + k, component(value, k), part);
            k += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// So many derivatives of the largest size fit into 63 bits; one that is a power of two, and is the largest of all
    /// that were measured, is below the limit.
    #[test]
    fn sums_have_room() {
        for log in 0..45 {
            let derivatives = (1u64 << log) + 1;
            let bits = bits_of_each(derivatives);
            assert!((16..=40 + MORE).contains(&bits));
            assert!(
                u128::from(derivatives) << bits < 1 << 62,
                "{derivatives} {bits}"
            );
            let limit = 2.0f32.powi(bits);
            for largest in [1.0f32, 0.7, 1e-9] {
                let own = largest.to_bits();
                let exponent = (own >> 23) as i32 - 127 + i32::from(own & 0x007f_ffff != 0);
                assert!(largest * 2.0f32.powi(kept(bits, true) - exponent) < limit);
            }
        }
    }
}
