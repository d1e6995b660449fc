//! The source of random numbers.

use super::mix::{mix, morton};
use super::strategies::Sequence;

/// The source of random numbers: a number is a function of (seed, pixel, sample, bounce,
/// dimension), the same on every backend and whatever the tiles and threads.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sampler {
    pub(super) seed: u64,
    pub(super) sequence: Sequence,
    /// Pixels of a row of the image.
    width: u32,
    /// log₂ of the samples of a pixel, rounded up, and of the pixels that share a sequence.
    samples: u32,
    pixels: u32,
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
