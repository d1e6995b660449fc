//! Random numbers from a stream of them, in Rust and in kernels of GPUs.

use super::Sequence;
use super::table::{OF_PAIR, PAIRS};
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

/// The coordinates of a point in a pair of dimensions, their bits reversed.
#[apply(record!)]
pub(crate) struct Coordinates {
    pub x: u32,
    pub y: u32,
}

/// Four dimensions whose numbers are needed together: two pairs of the sequence's.
///
/// What a path is connected to at a point, and the way on from there, bring light that is added up. So their numbers may
/// come from the same pair of dimensions, scrambled apart: few dimensions, which are spread best, are enough.
#[apply(record!)]
pub(crate) struct Dimensions {
    /// The pairs, counted over all rounds through the sequence's dimensions.
    pub first: u32,
    pub second: u32,
    /// What their scrambles are made from.
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
        let purposes = words(0u32, 1u32, 6u32, 7u32);
        dimensions(0u32, of_light(0u32), 0u32, 0u32, 0u32, purposes)
    }

    /// Lens radius and angle, and time.
    #[inline(always)]
    pub fn lens_and_time() -> Dimensions {
        let purposes = words(2u32, 3u32, 4u32, 4u32);
        dimensions(4u32, 5u32, 1u32, 0u32, 0u32, purposes)
    }

    /// For a direction, and for an emitter and a point on it, seen from where it leads.
    #[inline(always)]
    pub fn direction(bounce: u32) -> Dimensions {
        let purposes = words(11u32, 12u32, 6u32, 7u32);
        let (here, there) = (of_light(bounce), of_light(bounce + 1));
        dimensions(here, there, 2 + 2 * bounce, bounce, bounce + 1, purposes)
    }

    /// For the choice of a lobe, for survival, and for a direction to the environment.
    #[inline(always)]
    pub fn choices(bounce: u32) -> Dimensions {
        let purposes = words(10u32, 13u32, 8u32, 9u32);
        let (own, light) = (of_choices(bounce), of_light(bounce));
        dimensions(own, light, 3 + 2 * bounce, bounce, bounce, purposes)
    }

    /// For a stream that serves one purpose.
    #[inline(always)]
    pub fn of_set(set: u32) -> Dimensions {
        let purposes = words(16u32, 17u32, 18u32, 19u32);
        dimensions(2 * set, 2 * set + 1, set, set, set, purposes)
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

/// The pair of dimensions for light that comes to the point at a bounce.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
fn of_light(bounce: u32) -> u32 {
    select(bounce > 2, 2 * bounce + 2, bounce + 1)
}

/// The pair of dimensions for choices there.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
fn of_choices(bounce: u32) -> u32 {
    select(bounce < 2, 7 - bounce.min(1), 2 * bounce + 5)
}

#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
fn dimensions(
    first: u32,
    second: u32,
    set: u32,
    bounce: u32,
    next: u32,
    purposes: Words,
) -> Dimensions {
    Dimensions {
        first,
        second,
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
    /// Four numbers, from the points of the sequence.
    #[inline(always)]
    pub fn draw(self, points: &[u32], what: Dimensions) -> Four {
        if comptime!(self.sequence == Sequence::Sobol) {
            self.of_sequence(points, what)
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

    /// Four dimensions of the sequence of the path's block: its points, shuffled and scrambled as by Burley (2020).
    #[inline(always)]
    fn of_sequence(self, points: &[u32], what: Dimensions) -> Four {
        let first = point_of(points, what.first % PAIRS, self.place(what.first / PAIRS));
        let second = point_of(points, what.second % PAIRS, self.place(what.second / PAIRS));
        let seeds = scrambles(self.stage, what.set);
        Four {
            x: number(first.x, seeds.x),
            y: number(first.y, seeds.y),
            z: number(second.x, seeds.z),
            w: number(second.y, seeds.w),
        }
    }

    /// The place in the sequence, shuffled and its bits reversed: the dimensions of later rounds come from another each.
    #[inline(always)]
    pub(super) fn place(self, round: u32) -> u32 {
        let mut shuffled = self.shuffled;
        if round > 0 {
            let key = mixed(self.block.xor(wide(0u32, round)));
            shuffled = scrambled(self.index.reverse_bits(), key.low);
        }
        shuffled
    }
}

/// The seeds that scramble a set of four dimensions.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(super) fn scrambles(stage: Wide, set: u32) -> Words {
    let a = mixed(stage.xor(wide(set + 1, 0u32)));
    let b = mixed(a);
    words(a.low, a.high, b.low, b.high)
}

/// A point of a pair of dimensions: the sum, without carry, of those of the parts of its index.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(super) fn point_of(points: &[u32], pair: u32, index: u32) -> Coordinates {
    let first = pair as usize * OF_PAIR;
    let of_pair = &points[first..first + OF_PAIR];
    let a = ((index >> 28) * 2) as usize;
    let b = (32 + ((index >> 24) & 15) * 2) as usize;
    let c = (64 + ((index >> 20) & 15) * 2) as usize;
    let d = (96 + ((index >> 16) & 15) * 2) as usize;
    Coordinates {
        x: of_pair[a] ^ of_pair[b] ^ of_pair[c] ^ of_pair[d],
        y: of_pair[a + 1] ^ of_pair[b + 1] ^ of_pair[c + 1] ^ of_pair[d + 1],
    }
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
    fn scrambles_are_those_of_sobol_burley() {
        let mut x = 3u64;
        for _ in 0..500 {
            let [n, scramble] = [x as u32, (x >> 32) as u32];
            assert_eq!(scrambled(n, scramble), owen_scramble_rev(n, scramble));
            let found = owen_scramble_rev(n, scramble).reverse_bits();
            assert_eq!(number(n, scramble), u32_to_f32_norm(found));
            x = mix(x);
        }
    }
}
