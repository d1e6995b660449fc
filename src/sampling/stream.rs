//! Random numbers from a stream of them, in Rust and in kernels of GPUs.

use std::sync::OnceLock;

use sobol_burley::NUM_DIMENSION_SETS_4D;
use sobol_burley::parts::sobol_rev;

use super::Sequence;
use crate::cube::*;
use crate::model::integers::{Wide, mixed, product, total, wide};

/// Four random numbers.
#[apply(zeroed!)]
#[derive(PartialEq)]
pub(crate) struct Four {
    pub x: f32,
    pub y: f32,
    pub z: f32,
    pub w: f32,
}

/// Four words.
#[apply(record!)]
pub(crate) struct Words {
    pub x: u32,
    pub y: u32,
    pub z: u32,
    pub w: u32,
}

/// Four dimensions whose numbers are needed together. What matters most in most scenes comes first, since early
/// dimensions of a sequence are spread best.
#[apply(record!)]
pub(crate) struct Dimensions {
    /// The set of the Sobol sequence.
    pub set: u32,
    /// Independent numbers have a purpose each, the first two at a bounce, the others at another.
    bounce: u32,
    next: u32,
    purposes: Words,
}

#[cfg_attr(feature = "wgpu", cube)]
impl Dimensions {
    /// Film x and y, and for an emitter and a point on it, seen from the first surface.
    #[inline(always)]
    pub fn film() -> Dimensions {
        dimensions(0u32, 0u32, 0u32, words(0u32, 1u32, 6u32, 7u32))
    }

    /// Lens radius and angle, and time.
    #[inline(always)]
    pub fn lens_and_time() -> Dimensions {
        dimensions(1u32, 0u32, 0u32, words(2u32, 3u32, 4u32, 4u32))
    }

    /// For a direction, and for an emitter and a point on it, seen from where it leads.
    #[inline(always)]
    pub fn direction(bounce: u32) -> Dimensions {
        let purposes = words(11u32, 12u32, 6u32, 7u32);
        dimensions(2 + 2 * bounce, bounce, bounce + 1, purposes)
    }

    /// For the choice of a lobe, for survival, and for a direction to the environment.
    #[inline(always)]
    pub fn choices(bounce: u32) -> Dimensions {
        let purposes = words(10u32, 13u32, 8u32, 9u32);
        dimensions(3 + 2 * bounce, bounce, bounce, purposes)
    }

    /// For a stream that serves one purpose.
    #[inline(always)]
    pub fn of_set(set: u32) -> Dimensions {
        dimensions(set, set, set, words(16u32, 17u32, 18u32, 19u32))
    }
}

impl Dimensions {
    /// Of which the last two are for an emitter, and a point on it, seen from the surface at a bounce.
    #[inline(always)]
    pub fn emitter(bounce: u32) -> Self {
        match bounce {
            0 => Self::film(),
            _ => Self::direction(bounce - 1),
        }
    }
}

#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
fn dimensions(set: u32, bounce: u32, next: u32, purposes: Words) -> Dimensions {
    Dimensions {
        set,
        bounce,
        next,
        purposes,
    }
}

#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
fn words(x: u32, y: u32, z: u32, w: u32) -> Words {
    Words { x, y, z, w }
}

/// What the random numbers of one path are made from.
#[apply(record!)]
pub(crate) struct Stream {
    pub seed: Wide,
    #[cfg_attr(feature = "wgpu", cube(comptime))]
    pub sequence: Sequence,
    pub pixel: u32,
    pub sample: u32,
    /// The place in the sequence of the path's block of pixels, and what is the block's own.
    pub index: u32,
    pub block: Wide,
    /// What scrambles are made from, and the place, shuffled and its bits reversed, in the first round through the
    /// dimensions.
    pub stage: Wide,
    pub shuffled: u32,
}

#[cfg_attr(feature = "wgpu", cube)]
impl Stream {
    /// Four numbers, from the points of the Sobol sequence.
    #[inline(always)]
    pub fn draw(self, points: &[u32], what: Dimensions) -> Four {
        if comptime!(self.sequence == Sequence::Sobol) {
            self.of_sequence(points, what.set)
        } else {
            Four {
                x: self.independent(what.bounce, what.purposes.x),
                y: self.independent(what.bounce, what.purposes.y),
                z: self.independent(what.next, what.purposes.z),
                w: self.independent(what.next, what.purposes.w),
            }
        }
    }

    /// A number that is independent of all others, for a purpose at a bounce. It has 24 bits.
    #[inline(always)]
    pub(super) fn independent(self, bounce: u32, purpose: u32) -> f32 {
        let stage = mixed(self.seed.xor(wide(purpose, bounce)));
        let h = mixed(stage.xor(wide(self.sample, self.pixel)));
        (h.high >> 8) as f32 * (1.0f32 / 16_777_216.0f32)
    }

    /// A set of four dimensions of the sequence of the path's block: Burley's shuffled and scrambled points. After the
    /// last set come others with other scrambles.
    #[inline(always)]
    fn of_sequence(self, points: &[u32], set: u32) -> Four {
        let later = set / SETS;
        let mut stage = self.stage;
        let mut shuffled = self.shuffled;
        if later > 0 {
            stage = mixed(self.block.xor(wide(0u32, later)));
            shuffled = scrambled(self.index.reverse_bits(), stage.low);
        }
        let point = point_of(points, set % SETS, shuffled);
        let seeds = scrambles(stage, set);
        Four {
            x: number(point.x, seeds.x),
            y: number(point.y, seeds.y),
            z: number(point.z, seeds.z),
            w: number(point.w, seeds.w),
        }
    }
}

/// Sets of four dimensions in a table of points, and the words of each.
pub(super) const SETS: u32 = 64;
const _: () = assert!(SETS == NUM_DIMENSION_SETS_4D);
pub(super) const OF_SET: usize = 256;

/// Points of the Sobol sequence, for each set of four dimensions by four bits of the index at a time: a point is the
/// sum, without carry, of those of the four parts of its index.
pub(crate) fn points() -> &'static [u32] {
    static POINTS: OnceLock<Vec<u32>> = OnceLock::new();
    POINTS.get_or_init(|| {
        let of = |i: u32| {
            let (set, part, bits, d) = (i >> 8, (i >> 6) & 3, (i >> 2) & 15, i & 3);
            sobol_rev(bits << (28 - 4 * part), 4 * set + d)
        };
        (0..SETS * OF_SET as u32).map(of).collect()
    })
}

/// The seeds that scramble a set of four dimensions.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(super) fn scrambles(stage: Wide, set: u32) -> Words {
    let a = mixed(stage.xor(wide(set + 1, 0u32)));
    let b = mixed(a);
    words(a.low, a.high, b.low, b.high)
}

/// A point of a set of dimensions: the sum, without carry, of those of the parts of its index.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(super) fn point_of(points: &[u32], set: u32, index: u32) -> Words {
    let first = set as usize * OF_SET;
    let of_set = &points[first..first + OF_SET];
    let a = ((index >> 28) * 4) as usize;
    let b = (64 + ((index >> 24) & 15) * 4) as usize;
    let c = (128 + ((index >> 20) & 15) * 4) as usize;
    let d = (192 + ((index >> 16) & 15) * 4) as usize;
    words(
        of_set[a] ^ of_set[b] ^ of_set[c] ^ of_set[d],
        of_set[a + 1] ^ of_set[b + 1] ^ of_set[c + 1] ^ of_set[d + 1],
        of_set[a + 2] ^ of_set[b + 2] ^ of_set[c + 2] ^ of_set[d + 2],
        of_set[a + 3] ^ of_set[b + 3] ^ of_set[c + 3] ^ of_set[d + 3],
    )
}

/// Owen's scrambling of a number whose bits are reversed, by a hash (Burley 2020, Vegdahl 2021).
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(super) fn scrambled(n: u32, scramble: u32) -> u32 {
    let a = n ^ product(n, 0x3d20_adeau32);
    let b = product(total(a, scramble), (scramble >> 16) | 1);
    let c = b ^ product(b, 0x0552_6c56u32);
    c ^ product(c, 0x53a2_2864u32)
}

/// A number in [0, 1) from a coordinate of a point.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(super) fn number(coordinate: u32, scramble: u32) -> f32 {
    let bits = scrambled(coordinate, scramble).reverse_bits();
    f32::from_bits((bits >> 9) | 0x3f80_0000) - 1.0
}

#[cfg(test)]
mod tests {
    use sobol_burley::parts::{owen_scramble_rev, u32_to_f32_norm};

    use super::*;
    use crate::model::integers::mix;

    #[test]
    fn numbers_are_those_of_sobol_burley() {
        let mut x = 3u64;
        for set in (0..SETS).cycle().take(500) {
            let [n, scramble] = [x as u32, (x >> 32) as u32];
            assert_eq!(scrambled(n, scramble), owen_scramble_rev(n, scramble));
            let found = owen_scramble_rev(n, scramble).reverse_bits();
            assert_eq!(number(n, scramble), u32_to_f32_norm(found));
            let Words { x: a, y: b, z, w } = point_of(points(), set, n);
            let wanted = [0, 1, 2, 3].map(|d| sobol_rev(n, 4 * set + d));
            assert_eq!([a, b, z, w], wanted);
            x = mix(x);
        }
    }
}
