//! Points of the Sobol sequence, from tables, and their scrambles (Burley 2020).

use std::sync::OnceLock;

use sobol_burley::NUM_DIMENSION_SETS_4D;
use sobol_burley::parts::{owen_scramble_rev, sobol_rev};

use super::mix::mix;

/// The place of a path in a round through the dimensions, its bits reversed, and what scrambles are made
/// from.
pub(super) fn round(index: u32, block: u64, round: u64) -> (u32, u64) {
    let stage = mix(block ^ (round << 32));
    (owen_scramble_rev(index.reverse_bits(), stage as u32), stage)
}

/// The seeds that scramble a set of four dimensions.
#[inline(always)]
pub(super) fn scrambles(stage: u64, set: u32) -> [u32; 4] {
    let a = mix(stage ^ u64::from(set + 1));
    let b = mix(a);
    [a as u32, (a >> 32) as u32, b as u32, (b >> 32) as u32]
}

/// Points of the Sobol sequence of four dimensions by four bits of the index at a time: a point is the
/// sum, without carry, of those of the parts of its index.
pub(super) type Points = [[[u32; 4]; 16]; 4];

/// For each set of four dimensions.
pub(super) fn points() -> &'static [Points] {
    static POINTS: OnceLock<Vec<Points>> = OnceLock::new();
    POINTS.get_or_init(|| {
        let of_bits = |set: u32, part: u32, bits: u32| {
            [0, 1, 2, 3].map(|d| sobol_rev(bits << (28 - 4 * part), 4 * set + d))
        };
        let of_set = |set| {
            [0, 1, 2, 3].map(|part| std::array::from_fn(|bits| of_bits(set, part, bits as u32)))
        };
        (0..NUM_DIMENSION_SETS_4D).map(of_set).collect()
    })
}

#[inline(always)]
pub(super) fn unscrambled(points: &Points, shuffled: u32) -> [u32; 4] {
    let part = |i: usize| points[i][(shuffled >> (28 - 4 * i)) as usize % 16];
    let [a, b, c, d] = [part(0), part(1), part(2), part(3)];
    let mut sum = [0; 4];
    for i in 0..4 {
        sum[i] = a[i] ^ b[i] ^ c[i] ^ d[i];
    }
    sum
}
