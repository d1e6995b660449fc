//! Sums of derivatives in kernels, by atomic additions of whole numbers, so that they are the same whatever the
//! order: few GPUs add floats, and none in an order that repeats. A number has 64 bits in two words.
//!
//! A derivative is multiplied by a power of two and rounded. The powers are one for each part of a scene, and
//! come from the largest derivatives of some of the paths.

use burn::cubecl::{self, prelude::*};
use glam::DVec3;

use super::integers::total;
use crate::kernel::{KernelScene, Sums, Wanted};
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
pub(super) const CAMERA: usize = 9;
pub(super) const PARTS: usize = 10;

/// Words before the sums: the largest derivative of each part, by its bits, then the number of those that
/// no sum holds.
pub(super) const FIRST_SUM: usize = 16;
pub(super) const LOST: usize = 15;

/// Where the sums of each part begin, in numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Places {
    pub first: [u32; PARTS],
    pub count: usize,
}

impl Places {
    pub fn new(scene: &KernelScene, wanted: &Wanted) -> Self {
        let sums = Sums::new(scene, wanted);
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
            19,
        ];
        let mut count = 0;
        let first = counts.map(|n| {
            count += n;
            (count - n) as u32
        });
        Self { first, count }
    }

    /// Sums from what a kernel left: words, and powers of two.
    pub fn read(
        &self,
        words: &[u32],
        scales: &[f32],
        scene: &KernelScene,
        wanted: &Wanted,
    ) -> Sums {
        let mut sums = Sums::new(scene, wanted);
        let number = |part: usize, i: usize| {
            let at = FIRST_SUM + 2 * (self.first[part] as usize + i);
            let bits = (u64::from(words[at + 1]) << 32) | u64::from(words[at]);
            (bits as i64) as f64 / f64::from(scales[part])
        };
        let vector = |part: usize, i: usize| {
            DVec3::new(
                number(part, 3 * i),
                number(part, 3 * i + 1),
                number(part, 3 * i + 2),
            )
        };
        let fill = |list: &mut [DVec3], part: usize| {
            for (i, v) in list.iter_mut().enumerate() {
                *v = vector(part, i);
            }
        };
        fill(&mut sums.vertices, VERTICES);
        fill(&mut sums.velocities, VELOCITIES);
        fill(&mut sums.normals, NORMALS);
        fill(&mut sums.texels, TEXELS);
        fill(&mut sums.sky, SKY);
        for (i, t) in sums.triangles.iter_mut().enumerate() {
            t.normal = vector(TRIANGLES, i);
            t.area = number(AREAS, i);
        }
        for (i, uv) in sums.uvs.iter_mut().enumerate() {
            *uv = [number(UVS, 2 * i), number(UVS, 2 * i + 1)];
        }
        for (i, m) in sums.materials.iter_mut().enumerate() {
            for (c, channel) in m.iter_mut().enumerate() {
                *channel = vector(MATERIALS, 4 * i + c);
            }
        }
        let c = &mut sums.camera;
        c.eye = vector(CAMERA, 0);
        c.across = vector(CAMERA, 1);
        c.upward = vector(CAMERA, 2);
        c.forward = vector(CAMERA, 3);
        c.lens = [vector(CAMERA, 4), vector(CAMERA, 5)];
        c.per_focus = number(CAMERA, 18);
        sums
    }

    /// Powers of two for the parts, from the largest derivatives of some paths, in steps of 2 to the power of −`bits`
    /// of which sums are: the rest of 63 bits is room. Not a number for a part with derivatives that are not finite.
    pub fn scales(words: &[u32], bits: f32) -> Vec<f32> {
        let sizes = words[..PARTS].iter().map(|&bits| f32::from_bits(bits));
        let reached = |size: &f32| *size > 0.0 && size.is_finite();
        // A part that those paths do not reach has the scale of the others.
        let most = sizes.clone().filter(reached).fold(0.0, f32::max);
        let most = if most > 0.0 { most } else { 1.0 };
        let scale = |size: f32| {
            let size = if size == 0.0 { most } else { size };
            (bits - size.log2().ceil()).clamp(-80.0, 120.0).exp2() * (size / size)
        };
        sizes.map(scale).collect()
    }
}

/// The scale of parts of whose derivatives only the sizes are looked at.
pub(super) const MEASURE: f32 = 0.0;

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
            if size < 4.0e18 {
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
        let mut component = value.x;
        if k == 1 {
            component = value.y;
        } else if k == 2 {
            component = value.z;
        }
        add(totals, scales, at + k, component, part);
        k += 1;
    }
}
