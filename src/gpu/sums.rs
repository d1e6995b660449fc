//! The sums of kernels ([`Totals`]): where they lie, their scales, and the kernels that add them up.

use std::collections::HashMap;

use crate::cube::*;

use crate::kernel::View;
use crate::model::choice::INFINITY;
use crate::model::integers::total;
use crate::model::numbers::not_a_number;
use crate::trace::{
    CAMERAS, Derivatives, FIRST_SUM, LEAST_LIMIT, LIMIT, OF_CAMERA, PARTS, Scene, Sums, Totals,
    carry, sums_of,
};

/// Numbers of the sums of all replicas together, about.
const REPLICATED: usize = 1 << 16;
/// Replicas at most: as many as threads of a warp.
const REPLICAS: usize = 32;

/// Where the sums of each part of views begin, in numbers. Views of one scene share them, but for the camera's.
#[derive(Clone, Debug, Default)]
pub(crate) struct Places {
    /// Of each view.
    pub first: Vec<[u32; PARTS]>,
    /// For each view, the first view of its scene.
    owner: Vec<usize>,
    pub count: usize,
}

impl Places {
    /// For views, each with the number of its scene.
    pub fn new<'a>(views: impl Iterator<Item = (&'a View, usize)>) -> Self {
        let mut places = Self::default();
        let mut known = HashMap::new();
        for (v, (view, scene)) in views.enumerate() {
            let owner = *known.entry(scene).or_insert(v);
            let mut first = [0; PARTS];
            if owner == v {
                let counts = view.wanted.lengths(&view.scene);
                // The camera's are last.
                for (first, n) in first.iter_mut().zip(counts).take(CAMERAS as usize) {
                    *first = places.count as u32;
                    places.count += n;
                }
            } else {
                first = places.first[owner];
            }
            first[CAMERAS as usize] = places.count as u32;
            places.count += OF_CAMERA as usize;
            places.first.push(first);
            places.owner.push(owner);
        }
        places
    }

    /// Copies of all sums that kernels add to, so that threads of a warp don't wait for each other.
    pub fn replicas(&self) -> usize {
        (REPLICATED / self.count.max(1)).clamp(1, REPLICAS)
    }

    /// Whether a view is the first one of its scene.
    pub fn owns(&self, view: usize) -> bool {
        self.owner[view] == view
    }
}

/// Behind the scales of all parts and [`LIMIT`], for each view how much a loss depends on the radiance of a pixel, then
/// how much on a pixel as a whole, on average.
pub(super) const TYPICAL: usize = LIMIT + 1;

/// The scale of a part with derivatives that are not finite.
const NO_SCALE: f32 = -1.0;

/// A power of two for a part, from the bits of its largest derivative and of the largest of all parts: steps of the
/// sums are 2 to the power of −`keep` of it, the rest of 63 bits is room.
#[cube]
fn scale_of(largest: u32, of_all: u32, keep: i32) -> f32 {
    let mut bits = largest;
    if bits == 0 {
        // A part that was not reached has the scale of the others.
        bits = of_all;
    }
    let mut scale = NO_SCALE.runtime();
    if bits < INFINITY {
        // The power of two that is not less.
        let mut exponent = (bits >> 23) as i32 - 127;
        exponent = select(bits & 0x007f_ffff != 0, exponent + 1, exponent);
        exponent = select(bits == 0, 0, exponent);
        let power = (keep - exponent).max(-80).min(120);
        scale = f32::from_bits(((power + 127) as u32) << 23);
    }
    scale
}

/// Chooses the scales of parts from the largest derivatives that measuring launches left, and sets all sums to 0.
#[cube(launch)]
pub(super) fn choose_scales(sizes: &[u32], scales: &mut [f32], keep: i32, sums: &mut [u32]) {
    if ABSOLUTE_POS < sums.len() {
        sums[ABSOLUTE_POS] = 0;
    }
    if ABSOLUTE_POS < PARTS {
        let mut most = 0u32;
        let mut part = 0usize;
        while part < PARTS {
            most = select(sizes[part] < INFINITY, most.max(sizes[part]), most);
            part += 1;
        }
        if most == 0 {
            // Nothing was reached, perhaps since the loss depends on few pixels.
            let views = (scales.len() - TYPICAL) / 2;
            for view in 0..views {
                let bits = scales[TYPICAL + views + view].to_bits();
                most = select(bits < INFINITY, most.max(bits), most);
            }
        }
        scales[ABSOLUTE_POS] = scale_of(sizes[ABSOLUTE_POS], most, keep);
    }
}

/// Adds what all replicas have of a number to its sum of three words, and takes it from them.
#[cube(launch)]
pub(super) fn add_replicas(sums: &mut [u32], replicas: u32, numbers: u32) {
    if ABSOLUTE_POS < numbers as usize {
        let mut low = 0u32;
        let mut high = 0u32;
        for replica in 0..replicas {
            let from = first_total(replica, numbers) + 2 * ABSOLUTE_POS;
            let own = sums[from];
            low = total(low, own);
            high = total(high, total(sums[from + 1], carry(low, own)));
            sums[from] = 0;
            sums[from + 1] = 0;
        }
        // The sign goes on in the third word.
        let mut above = select(high >> 31 == 1, 0xffff_ffffu32, 0u32);
        let at = FIRST_SUM + 3 * ABSOLUTE_POS;
        let first = total(sums[at], low);
        let more = carry(first, low);
        let own = total(sums[at + 1], high);
        let second = total(own, more);
        above = total(above, carry(own, high) + carry(second, more));
        sums[at] = first;
        sums[at + 1] = second;
        sums[at + 2] = total(sums[at + 2], above);
    }
}

/// A sum of a part as a number; NaN where derivatives of the part are not finite.
#[cube]
pub(super) fn sum_at(sums: &[u32], scales: &[f32], at: u32, part: u32) -> f32 {
    let scale = scales[part as usize];
    let first = FIRST_SUM + 3 * at as usize;
    let mut low = sums[first];
    let mut high = sums[first + 1];
    let mut above = sums[first + 2];
    let negative = above >> 31 == 1;
    if negative {
        // The two's complement.
        low = total(!low, 1u32);
        let more = carry(low, 1u32);
        high = total(!high, more);
        above = total(!above, carry(high, more));
    }
    let mut value = (above as f32 * 4_294_967_296.0 + high as f32) * 4_294_967_296.0 + low as f32;
    value = select(negative, -value, value);
    if scale > 0.0 && sums[part as usize] == 0 {
        value = value / scale;
    } else {
        value = not_a_number(scale);
    }
    value
}

/// Words of all sums: those of all launches, then two a number for each replica of those of a launch.
pub(super) fn words_of_sums(replicas: usize, numbers: usize) -> usize {
    FIRST_SUM + (3 + 2 * replicas) * numbers
}

/// The first word of a replica.
#[cube]
fn first_total(replica: u32, numbers: u32) -> usize {
    FIRST_SUM + ((3 + 2 * replica) * numbers) as usize
}

/// The sums that a launch adds to.
#[apply(argument!)]
pub(super) struct Adding {
    sums: &'static [Atomic<u32>],
    replicas: u32,
    numbers: u32,
    #[cube(comptime)]
    of: Derivatives,
}

#[cube]
impl Adding {
    /// Those of a thread's replica, as stages add to them.
    pub fn of_thread<'a>(&self, scene: &Scene<'a>, scales: &'a [f32], thread: u32) -> Sums<'a> {
        let first = first_total(thread % self.replicas, self.numbers);
        sums_of(Totals::<'a> {
            sums: self.sums,
            replica: first as u32,
            scales,
            first: scene.first_sums,
            of: comptime!(self.of),
        })
    }
}

/// Bits of derivatives, times their scale, of which so many have room in a sum of 64 bits.
pub(super) fn bits_of_each(derivatives: u64) -> i32 {
    (61 - (u64::BITS - derivatives.leading_zeros()) as i32).clamp(LEAST_LIMIT, 40 + MORE)
}

/// Bits that derivatives may be larger by than those that were measured before they are added to sums of 96 bits.
pub(super) const MORE: i32 = 12;

#[cfg(test)]
mod tests {
    use super::*;

    /// So many derivatives of the largest size fit into 63 bits.
    #[test]
    fn sums_have_room() {
        for log in 0..36 {
            let derivatives = (1u64 << log) + 1;
            let bits = bits_of_each(derivatives);
            assert!((LEAST_LIMIT..=40 + MORE).contains(&bits));
            assert!(
                u128::from(derivatives) << bits < 1 << 62,
                "{derivatives} {bits}"
            );
        }
    }
}
