//! The random numbers of one path, in Rust and in GPU kernels.

use super::Sequence;
use super::table::{OF_PAIR, PAIRS};
use crate::cube::*;
use crate::model::Four;
use crate::model::integers::{Wide, hashed, mixed, product, total, wide};

/// Four words.
#[apply(record!)]
pub struct Words {
    pub x: u32,
    pub y: u32,
    pub z: u32,
    pub w: u32,
}

/// Four dimensions whose numbers are used together: two pairs of the sequence's dimensions.
///
/// At a point, the light of a connection and the light of the continuation are added up. So their numbers may come from
/// the same pair of dimensions with different scrambles. Few dimensions suffice, and these are the best distributed.
#[apply(record!)]
pub struct Dimensions {
    /// The pairs, counted over all rounds through the sequence's dimensions.
    pub first: u32,
    pub second: u32,
    /// The key of their scrambles.
    pub set: u32,
    /// Each independent number has a purpose. The first two belong to `bounce`, the last two to `next`.
    bounce: u32,
    next: u32,
    purposes: Words,
}

#[cfg_attr(feature = "gpu", cube)]
impl Dimensions {
    /// Returns the dimensions for film x and y, and for an emitter and a point on it, seen from the first surface.
    #[inline(always)]
    pub fn film() -> Dimensions {
        let purposes = words(0u32, 1u32, 6u32, 7u32);
        dimensions(0u32, of_light(0u32), 0u32, 0u32, 0u32, purposes)
    }

    /// Returns the dimensions for lens radius and angle, and shutter time.
    #[inline(always)]
    pub fn lens_and_time() -> Dimensions {
        let purposes = words(2u32, 3u32, 4u32, 4u32);
        dimensions(4u32, 5u32, 1u32, 0u32, 0u32, purposes)
    }

    /// Returns the dimensions for a direction, and for an emitter and a point on it, seen from the next surface.
    #[inline(always)]
    pub fn direction(bounce: u32) -> Dimensions {
        let purposes = words(11u32, 12u32, 6u32, 7u32);
        let (here, there) = (of_light(bounce), of_light(bounce + 1));
        dimensions(here, there, 2 + 2 * bounce, bounce, bounce + 1, purposes)
    }

    /// Returns the dimensions for the choice of a lobe, Russian roulette, and a direction to the environment map.
    #[inline(always)]
    pub fn choices(bounce: u32) -> Dimensions {
        let purposes = words(10u32, 13u32, 8u32, 9u32);
        let (own, light) = (of_choices(bounce), of_light(bounce));
        dimensions(own, light, 3 + 2 * bounce, bounce, bounce, purposes)
    }

    /// Returns the dimensions for a stream that serves one purpose.
    #[inline(always)]
    pub fn of_set(set: u32) -> Dimensions {
        let purposes = words(16u32, 17u32, 18u32, 19u32);
        dimensions(2 * set, 2 * set + 1, set, set, set, purposes)
    }
}

impl Dimensions {
    /// Returns the dimensions whose last two are for an emitter and a point on it, seen from the surface at a bounce.
    #[inline(always)]
    pub fn emitter(bounce: u32) -> Self {
        match bounce {
            0 => Self::film(),
            _ => Self::direction(bounce - 1),
        }
    }
}

/// Returns the pair of dimensions for light that arrives at the point of a bounce.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn of_light(bounce: u32) -> u32 {
    select(bounce > 2, 2 * bounce + 2, bounce + 1)
}

/// Returns the pair of dimensions for the choices at a bounce.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn of_choices(bounce: u32) -> u32 {
    select(bounce < 2, 7 - bounce.min(1), 2 * bounce + 5)
}

#[cfg_attr(feature = "gpu", cube)]
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

#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn words(x: u32, y: u32, z: u32, w: u32) -> Words {
    Words { x, y, z, w }
}

/// The keys of the random numbers of one path.
#[apply(record!)]
pub struct Stream {
    pub seed: Wide,
    #[cfg_attr(feature = "gpu", cube(comptime))]
    pub sequence: Sequence,
    pub pixel: u32,
    pub sample: u32,
    /// The path's index in the sequence of its block of pixels.
    pub index: u32,
    /// The key of scrambles, whose low word is also that of the first round's shuffle and whose high word is that of later
    /// rounds. Then the index in the first round through the dimensions, shuffled and with reversed bits.
    pub stage: Wide,
    pub shuffled: u32,
}

#[cfg_attr(feature = "gpu", cube)]
impl Stream {
    /// Returns four numbers. `points` are the points of the sequence.
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

    /// Returns a number of 24 bits for a purpose at a bounce, independent of all others.
    #[inline(always)]
    pub(super) fn independent(self, bounce: u32, purpose: u32) -> f32 {
        let stage = mixed(self.seed.xor(wide(purpose, bounce)));
        let h = mixed(stage.xor(wide(self.sample, self.pixel)));
        (h.high >> 8) as f32 * (1.0f32 / 16_777_216.0f32)
    }

    /// Returns four dimensions of the block's sequence. Its points are shuffled and scrambled as by Burley (2020).
    #[inline(always)]
    fn of_sequence(self, points: &[u32], what: Dimensions) -> Four {
        let first = point_of(points, what.first % PAIRS, self.place(what.first / PAIRS));
        let second = point_of(points, what.second % PAIRS, self.place(what.second / PAIRS));
        let seeds = scrambles(self.stage, what.set);
        Four {
            x: number(x_of(first), seeds.x),
            y: number(y_of(first), seeds.y),
            z: number(x_of(second), seeds.z),
            w: number(y_of(second), seeds.w),
        }
    }

    /// Returns the shuffled index in the sequence, with reversed bits. Each round through the dimensions has its own
    /// shuffle.
    #[inline(always)]
    pub(super) fn place(self, round: u32) -> u32 {
        let mut shuffled = self.shuffled;
        if round > 0 {
            let key = hashed(self.stage.high ^ round);
            shuffled = scrambled(self.index.reverse_bits(), key);
        }
        shuffled
    }
}

/// Returns the seeds that scramble a set of four dimensions.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn scrambles(stage: Wide, set: u32) -> Words {
    let a = mixed(stage.xor(wide(set + 1, 0u32)));
    let b = mixed(a);
    words(a.low, a.high, b.low, b.high)
}

/// Returns a point in a pair of dimensions: the XOR of the table's entries for the parts of the index.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn point_of(points: &[u32], pair: u32, index: u32) -> u32 {
    let first = pair as usize * OF_PAIR;
    let of_pair = &points[first..first + OF_PAIR];
    let a = (index >> 28) as usize;
    let b = (16 + ((index >> 24) & 15)) as usize;
    let c = (32 + ((index >> 20) & 15)) as usize;
    let d = (48 + ((index >> 16) & 15)) as usize;
    of_pair[a] ^ of_pair[b] ^ of_pair[c] ^ of_pair[d]
}

/// Returns the first coordinate of a point, with reversed bits.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn x_of(point: u32) -> u32 {
    point & 0xffff
}

/// Returns the second coordinate of a point, with reversed bits.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn y_of(point: u32) -> u32 {
    point >> 16
}

/// Applies Owen scrambling to a number with reversed bits, by a hash (Burley 2020, Vegdahl 2021).
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub(super) fn scrambled(n: u32, scramble: u32) -> u32 {
    let a = n ^ product(n, 0x3d20_adeau32);
    let b = product(total(a, scramble), (scramble >> 16) | 1);
    let c = b ^ product(b, 0x0552_6c56u32);
    c ^ product(c, 0x53a2_2864u32)
}

/// Scrambles a coordinate of a point and converts it to a number in [0, 1).
#[cfg_attr(feature = "gpu", cube)]
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
