//! The source of random numbers.

use super::Sequence;
use super::stream::{Stream, scrambled};
use crate::cube::*;
use crate::model::integers::{Wide, mix, mixed, morton, wide};

/// The source of random numbers: each number is a function of (seed, pixel, sample, bounce, dimension), the same on
/// every backend and for any tiles and threads.
#[apply(record!)]
pub struct Sampler {
    pub seed: Wide,
    #[cfg_attr(feature = "gpu", cube(comptime))]
    pub sequence: Sequence,
    /// The width of the image in pixels.
    pub width: u32,
    /// log₂ of the number of samples of a pixel (rounded up), and of the number of pixels that share a sequence.
    pub samples: u32,
    pub pixels: u32,
}

/// log₂ of the length of a sequence, which has 2¹⁶ points.
pub const LENGTH: u32 = 16;

impl Sampler {
    /// Creates the source for an image that is `width` pixels wide, with `samples` samples for each pixel.
    pub fn new(seed: u64, sequence: Sequence, width: usize, samples: u32) -> Self {
        let samples = samples.next_power_of_two().trailing_zeros().min(LENGTH);
        Self {
            seed: mix(seed ^ 0x9e37_79b9_7f4a_7c15).into(),
            sequence,
            width: width.max(1) as u32,
            samples,
            pixels: LENGTH - samples,
        }
    }

    /// Returns another source, for another purpose.
    pub fn of_purpose(&self, purpose: u64) -> Self {
        Self {
            seed: mix(u64::from(self.seed) ^ mix(purpose)).into(),
            ..*self
        }
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Sampler {
    /// Returns the same source with a whole sequence for each pixel.
    pub fn of_one_pixel(self) -> Sampler {
        Sampler {
            seed: self.seed,
            sequence: comptime!(self.sequence),
            width: self.width,
            samples: LENGTH,
            pixels: 0u32,
        }
    }

    /// Returns the random numbers of a path. A sequence is dealt to a block of pixels in Morton order.
    #[inline(always)]
    pub fn stream(self, pixel: u32, sample: u32) -> Stream {
        let mut index = 0u32;
        let mut stage = wide(0u32, 0u32);
        let mut shuffled = 0u32;
        if comptime!(self.sequence == Sequence::Sobol) {
            let place = morton(pixel % self.width, pixel / self.width);
            let run = place.low & ((1u32 << self.pixels) - 1);
            index = (run << self.samples) | (sample & ((1u32 << self.samples) - 1));
            let of_pixels = mixed(self.seed.xor(place.shifted(self.pixels)));
            stage = mixed(of_pixels.xor(wide(sample >> self.samples, 0u32)));
            shuffled = scrambled(index.reverse_bits(), stage.low);
        }
        Stream {
            seed: self.seed,
            sequence: comptime!(self.sequence),
            pixel,
            sample,
            index,
            stage,
            shuffled,
        }
    }
}

#[cfg(any(feature = "gpu", test))]
#[cfg_attr(feature = "gpu", cube)]
impl Sampler {
    /// Returns the sample at a place in the order of the samples' first random numbers, among 2 to the power of
    /// `length` samples from a multiple of this number on. The order is exact up to Owen scrambling: the samples of an
    /// aligned part of a run are those of a part of the numbers' range. `length` is at
    /// least 1, and a sequence is as long as a run or longer.
    pub fn in_order(self, place: u32, length: u32) -> u32 {
        let mut sample = place;
        if comptime!(self.sequence == Sequence::Sobol) {
            let key = self.stream(0u32, place).stage.low;
            let last = (1u32 << self.samples) - 1;
            // The index in the sequence with reversed bits, and what it is to be after the shuffle.
            let mut index = (((place & last) >> length) << length).reverse_bits();
            let wanted = place << (32 - length);
            let mut bit = 32 - length;
            while bit < 32 {
                // A bit of a scrambled number depends on the bit and on those below.
                index |= (scrambled(index, key) ^ wanted) & (1u32 << bit);
                bit += 1;
            }
            sample = (place & !last) | index.reverse_bits();
        }
        sample
    }
}

#[cfg(test)]
mod tests {
    use super::super::stream::Dimensions;
    use super::super::table::points;
    use super::*;

    /// Each sample has one place, and neighboring places have neighboring first numbers.
    #[test]
    fn samples_in_the_order_of_their_first_numbers() {
        let sampler = Sampler::new(5, Sequence::Sobol, 7, 4).of_one_pixel();
        for (first, length) in [(0, 9), (3 << 12, 12), (1 << 17, 10)] {
            let places = first..first + (1u32 << length);
            let samples = places.clone().map(|place| sampler.in_order(place, length));
            let mut samples: Vec<u32> = samples.collect();
            for (k, part) in samples.chunks(32).enumerate() {
                let number = |&s: &u32| sampler.stream(0, s).draw(points(), Dimensions::film()).x;
                let numbers: Vec<f32> = part.iter().map(number).collect();
                let [low, high] = [f32::min, f32::max].map(|of| numbers.iter().copied().reduce(of));
                let range = high.expect("numbers") - low.expect("numbers");
                assert!(range < 32.0 / (1u32 << length) as f32, "{k}: {range}");
            }
            samples.sort_unstable();
            assert!(samples.into_iter().eq(places));
        }
    }
}
