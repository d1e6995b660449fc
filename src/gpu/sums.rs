//! Sums of derivatives in kernels, by atomic additions of whole numbers, so that they are the same whatever the
//! order: few GPUs add floats, and none in an order that repeats. A number has 64 bits in two words.
//!
//! A derivative is multiplied by a power of two and rounded. The powers are one for each part of a scene, and
//! come from the largest derivatives of some of the paths.

use std::collections::HashMap;

use burn::cubecl::{self, prelude::*};

use super::integers::total;
use crate::kernel::{Sums, View};
use crate::model::V3;

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

/// Sums of a light without extent ([`DeltaSums`]) and of a camera ([`CameraSums`]).
///
/// [`DeltaSums`]: crate::kernel::DeltaSums
/// [`CameraSums`]: crate::kernel::CameraSums
pub(super) const OF_LIGHT: usize = 11;
pub(super) const OF_CAMERA: usize = 19;

/// Words before the sums of a replica: the largest derivative of each part, by its bits, then the number of those
/// that no sum holds.
pub(super) const FIRST_SUM: usize = 16;
pub(super) const LOST: usize = 15;

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
                let sums = Sums::new(&view.scene, &view.wanted);
                let counts = [
                    3 * sums.vertices.len(),
                    3 * sums.triangles.len(),
                    sums.triangles.len(),
                    3 * sums.velocities.len(),
                    2 * sums.uvs.len(),
                    3 * sums.normals.len(),
                    12 * sums.materials.len(),
                    3 * sums.texels.len(),
                    3 * sums.sky.len(),
                    3 * sums.colours.len(),
                    3 * sums.tangents.len(),
                    OF_LIGHT * sums.lights.len(),
                ];
                for (first, n) in first.iter_mut().zip(counts) {
                    *first = places.count as u32;
                    places.count += n;
                }
            } else {
                first = places.first[owner];
            }
            first[CAMERA] = places.count as u32;
            places.count += OF_CAMERA;
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

/// The bits of an infinite number.
const INFINITY: u32 = 0x7f80_0000;

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
                let bits = scales[PARTS + views as usize + view].to_bits();
                if bits < INFINITY {
                    most = most.max(bits);
                }
                view += 1;
            }
        }
        scales[ABSOLUTE_POS] = scale_of(own, most, keep);
    }
}

/// Adds up replicas: the sums in two words each.
#[cube(launch)]
pub(super) fn add_replicas(
    totals: &[u32],
    sums: &mut [u32],
    replicas: u32,
    region: u32,
    numbers: u32,
) {
    if ABSOLUTE_POS < numbers as usize {
        let at = FIRST_SUM + 2 * ABSOLUTE_POS;
        let mut low = 0u32;
        let mut high = 0u32;
        let mut replica = 0u32;
        while replica < replicas {
            let from = (replica * region) as usize + at;
            let own = totals[from];
            low = total(low, own);
            high = total(high, totals[from + 1]);
            if low < own {
                high = total(high, 1u32);
            }
            replica += 1;
        }
        sums[2 * ABSOLUTE_POS] = low;
        sums[2 * ABSOLUTE_POS + 1] = high;
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
    let mut low = sums[2 * at as usize];
    let mut high = sums[2 * at as usize + 1];
    let negative = high >> 31 == 1;
    if negative {
        // The two's complement.
        low = total(!low, 1u32);
        high = !high;
        if low == 0 {
            high = total(high, 1u32);
        }
    }
    let mut value = high as f32 * 4_294_967_296.0 + low as f32;
    if negative {
        value = -value;
    }
    if scale > 0.0 {
        value = value / scale;
    } else {
        value = scale - scale;
        value = value / value;
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

/// The largest derivative that is added, times its scale: 64 of them leave room in 63 bits.
const LARGEST: f32 = 7.0e16;

/// Bits of a scaled derivative that is as large as those that were measured: so many of them have room in 61 bits.
pub(super) fn bits_to_keep(derivatives: u64) -> i32 {
    (61 - (u64::BITS - derivatives.leading_zeros()) as i32).clamp(16, 40)
}

/// Adds a derivative to a sum of a part, or looks at its size alone ([`MEASURE`]).
#[cube]
pub(super) fn add(
    totals: &[Atomic<u32>],
    scales: &[f32],
    at: u32,
    value: f32,
    #[comptime] part: usize,
) {
    if value != 0.0 {
        let scale = scales[part];
        if scale == MEASURE {
            totals[part].fetch_max(value.abs().to_bits());
        } else {
            let scaled = value * scale;
            let size = scaled.abs();
            if size < LARGEST {
                let rounded = size.floor();
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
                let before = totals[i].fetch_add(low);
                if total(before, low) < low {
                    high = total(high, 1u32);
                }
                if high != 0 {
                    totals[i + 1].fetch_add(high);
                }
            } else {
                totals[LOST].fetch_add(1u32);
            }
        }
    }
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

/// Adds three derivatives.
#[cube]
pub(super) fn add_vector(
    totals: &[Atomic<u32>],
    scales: &[f32],
    at: u32,
    value: V3,
    #[comptime] part: usize,
) {
    let mut k = 0u32;
    while k < 3 {
        add(totals, scales, at + k, component(value, k), part);
        k += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Derivatives as large as those that were measured fit into a sum, however many there are.
    #[test]
    fn sums_have_room() {
        for log in 0..45 {
            let derivatives = (1u64 << log) + 1;
            let keep = bits_to_keep(derivatives);
            assert!((16..=40).contains(&keep));
            let sum = u128::from(derivatives) << keep;
            assert!(sum < 1 << 62, "{derivatives} {keep}");
        }
        assert!(64.0 * f64::from(LARGEST) < f64::from(2.0f32.powi(63)));
    }
}
