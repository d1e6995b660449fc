//! The source of random numbers.

use std::sync::OnceLock;

use sobol_burley::NUM_DIMENSION_SETS_4D;
use sobol_burley::parts::{owen_scramble_rev, sobol_rev};

use super::strategies::Sequence;

/// The source of random numbers: a number is a function of (seed, pixel, sample, bounce,
/// dimension), the same on every backend and whatever the tiles and threads.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sampler {
    pub(crate) seed: u64,
    pub(crate) sequence: Sequence,
    /// Pixels of a row of the image.
    width: u32,
    /// log₂ of the samples of a pixel, rounded up, and of the pixels that share a sequence.
    pub(crate) samples: u32,
    pub(crate) pixels: u32,
}

/// A sequence has 2¹⁶ numbers.
const LENGTH: u32 = 16;

impl Sampler {
    /// For an image of some width, with so many samples a pixel.
    pub(crate) fn new(seed: u64, sequence: Sequence, width: usize, samples: u32) -> Self {
        let samples = samples.next_power_of_two().trailing_zeros().min(LENGTH);
        Self {
            seed: mix(seed ^ 0x9e37_79b9_7f4a_7c15),
            sequence,
            width: width.max(1) as u32,
            samples,
            pixels: LENGTH - samples,
        }
    }

    /// Another source, for another purpose.
    pub(crate) fn stream(&self, purpose: u64) -> Self {
        Self {
            seed: mix(self.seed ^ mix(purpose)),
            ..*self
        }
    }

    /// The same source with a sequence as long as there is for each pixel.
    pub(crate) fn of_one_pixel(&self) -> Self {
        Self {
            samples: LENGTH,
            pixels: 0,
            ..*self
        }
    }

    /// The place of a path in the sequence of its block of pixels, and what is the block's own.
    pub(super) fn place(&self, (pixel, sample): (u32, u32)) -> (u32, u64) {
        let place = morton(pixel % self.width, pixel / self.width);
        let run = place & ((1 << self.pixels) - 1);
        let index = (run << self.samples) as u32 | (sample & ((1 << self.samples) - 1));
        let block = mix(self.seed ^ (place >> self.pixels)) ^ u64::from(sample >> self.samples);
        (index, block)
    }
}

/// The purpose of a random number.
#[derive(Clone, Copy, Debug)]
#[repr(u32)]
pub(crate) enum Dimension {
    FilmX,
    FilmY,
    LensRadius,
    LensAngle,
    Time,
    Surface,
    EmitterU,
    EmitterV,
    EnvironmentU,
    EnvironmentV,
    Lobe,
    DirectionU,
    DirectionV,
    Roulette,
}

impl Dimension {
    /// The dimension of a Sobol sequence at a bounce; None for those that a control variate needs
    /// to be independent of all other paths (`tensors/path.rs`).
    pub(super) fn of_sequence(self, bounce: u32) -> Option<u32> {
        // Sets of four that are needed together; what matters most in most scenes comes first, since
        // early dimensions are spread best.
        let of_bounce = |slot: u32| Some(4 * (2 + 2 * bounce) + slot);
        match self {
            Self::FilmX => Some(0),
            Self::FilmY => Some(1),
            Self::EmitterU if bounce == 0 => Some(2),
            Self::EmitterV if bounce == 0 => Some(3),
            Self::LensRadius => Some(4),
            Self::LensAngle => Some(5),
            Self::Time => Some(6),
            Self::DirectionU => of_bounce(0),
            Self::DirectionV => of_bounce(1),
            // With the direction that leads there.
            Self::EmitterU => Some(4 * (2 + 2 * (bounce - 1)) + 2),
            Self::EmitterV => Some(4 * (2 + 2 * (bounce - 1)) + 3),
            Self::Lobe => of_bounce(4),
            Self::Roulette => of_bounce(5),
            Self::EnvironmentU => of_bounce(6),
            Self::EnvironmentV => of_bounce(7),
            Self::Surface => None,
        }
    }
}

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
pub(crate) type Points = [[[u32; 4]; 16]; 4];

/// For each set of four dimensions.
pub(crate) fn points() -> &'static [Points] {
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

/// The finaliser of SplitMix64 (Steele et al. 2014), applied after an odd offset.
pub(crate) fn mix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// A uniform number of a path.
pub(super) fn number(stage: u64, (pixel, sample): (u32, u32)) -> f32 {
    let h = mix(stage ^ ((u64::from(pixel) << 32) | u64::from(sample)));
    (h >> 40) as f32 / (1u64 << 24) as f32
}

/// The bits of x and y in turn.
pub(super) fn morton(x: u32, y: u32) -> u64 {
    let spread = |v: u32| {
        let mut v = u64::from(v);
        v = (v | (v << 16)) & 0x0000_ffff_0000_ffff;
        v = (v | (v << 8)) & 0x00ff_00ff_00ff_00ff;
        v = (v | (v << 4)) & 0x0f0f_0f0f_0f0f_0f0f;
        v = (v | (v << 2)) & 0x3333_3333_3333_3333;
        (v | (v << 1)) & 0x5555_5555_5555_5555
    };
    spread(x) | (spread(y) << 1)
}
