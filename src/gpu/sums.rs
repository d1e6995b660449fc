//! The sums of kernels ([`Totals`]): their places and scales, and the kernels that add up replicas.

use std::collections::HashMap;

use softray_kernels::cube::*;

use softray_kernels::kernel::View;
use softray_kernels::model::choice::INFINITY;
use softray_kernels::model::integers::total;
use softray_kernels::model::numbers::not_a_number;
use softray_kernels::trace::{
    Along, CAMERAS, Derivatives, MIN_LIMIT, OF_CAMERA, PARTS, Pairs, Scene, Sums, Totals, carry,
    is_marked, sums_of,
};

/// The first sum of each part of views. Views of one scene share all sums except the camera's.
#[derive(Clone, Debug, Default)]
pub(crate) struct Places {
    /// The first sum of each part, for each view.
    pub first: Vec<[u32; PARTS]>,
    /// For each view, the first view of its scene.
    owner: Vec<usize>,
    pub count: usize,
}

impl Places {
    /// Computes the places for views, each given with the index of its scene.
    pub fn new<'a>(views: impl Iterator<Item = (&'a View, usize)>) -> Self {
        let mut places = Self::default();
        let mut known = HashMap::new();
        for (v, (view, scene)) in views.enumerate() {
            let owner = *known.entry(scene).or_insert(v);
            let mut first = [0; PARTS];
            if owner == v {
                let counts = view.wanted.lengths(&view.scene);
                // The sums of the camera are last.
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

    /// Returns whether a view is the first view of its scene.
    pub fn owns(&self, view: usize) -> bool {
        self.owner[view] == view
    }
}

/// Returns the start of the scales of views, behind the scales of all parts and the limit: for each view, how much the
/// loss depends on average on the radiance of a pixel, then for each view, how much it depends on a whole pixel.
#[cube]
pub(super) fn typical(parts: u32) -> u32 {
    parts + 1
}

/// Returns the scale of a part, a power of two, from the bits of its largest derivative and of the largest derivative
/// of all parts. The step of the sums is about 2 to the power of −`keep` of the largest derivative. The rest of 63
/// bits is headroom.
#[cube]
fn scale_of(largest: u32, of_all: u32, keep: i32) -> f32 {
    let mut bits = largest;
    if bits == 0 {
        // A part without measured derivatives has the scale of the largest.
        bits = of_all;
    }
    // The exponent of the least power of two that is not less than the largest derivative.
    let mut exponent = (bits >> 23) as i32 - 127;
    exponent = select(bits & 0x007f_ffff != 0, exponent + 1, exponent);
    exponent = select(bits == 0, 0, exponent);
    let power = (keep - exponent).max(-80).min(120);
    f32::from_bits(((power + 127) as u32) << 23)
}

/// Number of words that a thread of [`choose_scales`] sets to 0.
pub(super) const OF_THREAD: usize = 8;

/// Chooses the scales of parts from the largest derivatives that measuring launches stored, and sets all sums to 0.
#[cube(launch)]
pub(super) fn choose_scales(
    sizes: &[u32],
    scales: &mut [f32],
    parts: u32,
    keep: i32,
    sums: &mut [u32],
) {
    let mut at = ABSOLUTE_POS;
    while at < sums.len() {
        sums[at] = 0;
        at += CUBE_COUNT * CUBE_DIM as usize;
    }
    if ABSOLUTE_POS < parts as usize {
        let mut most = 0u32;
        let mut part = 0usize;
        while part < parts as usize {
            most = most.max(sizes[part]);
            part += 1;
        }
        if most == 0 {
            // No derivatives were measured, perhaps because the loss depends on few pixels.
            let first = typical(parts) as usize;
            let views = (scales.len() - first) / 2;
            for view in 0..views {
                let bits = scales[first + views + view].to_bits();
                most = select(bits < INFINITY, most.max(bits), most);
            }
        }
        scales[ABSOLUTE_POS] = scale_of(sizes[ABSOLUTE_POS], most, keep);
    }
}

/// The replicas of sums: their number, and the number of sums.
#[apply(argument!)]
pub(super) struct Replicas {
    pub count: u32,
    pub numbers: u32,
}

/// A sum in three words.
#[apply(record!)]
struct Wide {
    low: u32,
    high: u32,
    above: u32,
}

#[cube]
impl Replicas {
    /// Returns a sum over all launches: its three words, plus its values in all replicas.
    fn sum(&self, sums: &mut [u32], at: u32) -> Wide {
        let mut low = 0u32;
        let mut high = 0u32;
        for replica in 0..self.count {
            let from = first_total(replica, self.numbers) + 2 * at as usize;
            let own = sums[from];
            low = total(low, own);
            high = total(high, total(sums[from + 1], carry(low, own)));
        }
        // The sign extends into the third word.
        let mut above = select(high >> 31 == 1, 0xffff_ffffu32, 0u32);
        let first = (2 * at) as usize;
        let third = (first_third(self.count, self.numbers) + at) as usize;
        let sum = total(sums[first], low);
        let more = carry(sum, low);
        let own = total(sums[first + 1], high);
        let second = total(own, more);
        above = total(above, carry(own, high) + carry(second, more));
        Wide {
            low: sum,
            high: second,
            above: total(sums[third], above),
        }
    }

    /// Returns a sum of a part as a float, or NaN if one of its derivatives is not finite or too large for any sum.
    pub fn number(&self, sums: &mut [u32], scales: &[f32], at: u32, part: u32) -> f32 {
        let scale = scales[part as usize];
        let sum = self.sum(sums, at);
        let mut low = sum.low;
        let mut high = sum.high;
        let mut above = sum.above;
        let marked = is_marked(above);
        let negative = above >> 31 == 1;
        if negative {
            // The two's complement.
            low = total(!low, 1u32);
            let more = carry(low, 1u32);
            high = total(!high, more);
            above = total(!above, carry(high, more));
        }
        let mut value =
            (above as f32 * 4_294_967_296.0 + high as f32) * 4_294_967_296.0 + low as f32;
        value = select(negative, -value, value);
        value = value / scale;
        if marked {
            value = not_a_number(scale);
        }
        value
    }
}

/// Adds the values of a sum in all replicas to its sum of three words, and sets the replicas to 0.
#[cube(launch)]
pub(super) fn add_replicas(sums: &mut [u32], replicas: Replicas) {
    if ABSOLUTE_POS < replicas.numbers as usize {
        let sum = replicas.sum(sums, ABSOLUTE_POS as u32);
        let third = first_third(replicas.count, replicas.numbers) as usize;
        sums[2 * ABSOLUTE_POS] = sum.low;
        sums[2 * ABSOLUTE_POS + 1] = sum.high;
        sums[third + ABSOLUTE_POS] = sum.above;
        for replica in 0..replicas.count {
            let from = first_total(replica, replicas.numbers) + 2 * ABSOLUTE_POS;
            sums[from] = 0;
            sums[from + 1] = 0;
        }
    }
}

/// Returns the first word of a replica.
#[cube]
fn first_total(replica: u32, numbers: u32) -> usize {
    (2 * (1 + replica) * numbers) as usize
}

/// Returns the first one of the third words of all sums, which are behind the replicas.
#[cube]
fn first_third(replicas: u32, numbers: u32) -> u32 {
    first_total(replicas, numbers) as u32
}

/// The sums that a launch adds to.
#[apply(argument!)]
pub(super) struct Adding {
    sums: &'static [Atomic<u32>],
    pairs: Pairs<'static>,
    replicas: Replicas,
    parts: u32,
    directions: u32,
    pixels: u32,
    #[cube(comptime)]
    of: Derivatives,
}

#[cube]
impl Adding {
    /// Returns the sums of a thread's replica, in the form that stages take. In forward mode, with `tangents`, they are
    /// those of the first channel of a pixel.
    pub fn of_thread<'a>(
        &self,
        scene: &Scene<'a>,
        scales: &'a [f32],
        tangents: &'a [f32],
        thread: u32,
        pixel: u32,
        #[comptime] forward: bool,
    ) -> Sums<'a> {
        let first = first_total(thread % self.replicas.count, self.replicas.numbers);
        sums_of(Totals::<'a> {
            sums: self.sums,
            pairs: self.pairs,
            replica: first as u32,
            above: first_third(self.replicas.count, self.replicas.numbers),
            parts: self.parts,
            scales,
            first: scene.first_sums,
            along: Along::<'a> {
                tangents,
                directions: self.directions,
                pixels: self.pixels,
                pixel,
                channel: 0u32,
            },
            forward,
            of: comptime!(self.of),
        })
    }
}

/// Returns the sums of a channel.
#[cube]
#[allow(unused_variables)]
pub(super) fn of_channel<'a>(sums: &Sums<'a>, channel: u32) -> Sums<'a> {
    intrinsic!(|_| {
        let mut own = *sums;
        own.along.channel = channel;
        own
    })
}

/// Returns the number of bits of each scaled derivative such that a 64-bit sum can hold `derivatives` of them.
pub(super) fn bits_of_each(derivatives: u64) -> i32 {
    (61 - (u64::BITS - derivatives.leading_zeros()) as i32).clamp(MIN_LIMIT, 40 + MORE)
}

/// Number of bits by which derivatives may exceed the measured ones before they are added to 96-bit sums.
pub(super) const MORE: i32 = 12;

#[cfg(test)]
mod tests {
    use super::*;

    /// The sum of derivatives of the largest size fits into 63 bits.
    #[test]
    fn sums_have_room() {
        for log in 0..36 {
            let derivatives = (1u64 << log) + 1;
            let bits = bits_of_each(derivatives);
            assert!((MIN_LIMIT..=40 + MORE).contains(&bits));
            assert!(
                u128::from(derivatives) << bits < 1 << 62,
                "{derivatives} {bits}"
            );
        }
    }
}
