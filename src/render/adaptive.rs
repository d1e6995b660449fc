//! Adaptive sampling: how many samples each pixel has.
//!
//! The squared error of an image is least where pixels have samples in proportion to their standard deviation (Neyman
//! 1934). Two images of few samples, from random numbers of their own, tell it: their squared difference about each
//! pixel. These images are no part of the result, so it does not depend on how many samples it has what a pixel's are:
//! each mean is unbiased.

use std::collections::BTreeMap;
use std::ops::Range;

/// Samples of a pixel over those of the options, at least ([`LEAST`] halvings) and at most.
const LEAST: i32 = -2;
pub(super) const MOST: u32 = 16;

/// With fewer samples two images to choose by would take more than a quarter as many.
const FEWEST: u32 = 8;

/// The standard deviation's power that samples go by: a few differences tell it roughly, and samples of sequences, which
/// lie the more evenly the more there are, gain most from the first.
const POWER: f64 = 0.7;

/// Multiples of the golden ratio are spread evenly over [0, 1).
const GOLDEN: f64 = 0.618_033_988_749_894_8;

/// Steps in which logarithms to base 2 are compared.
const STEPS: f64 = 256.0;

/// The samples that tell how noisy pixels are, of each of two images, unless there are too few in all. They come after
/// all that pixels may have, in runs of a length that is a power of two, which have random numbers of their own each.
pub(super) fn pilots(samples: u32) -> Option<[Range<u32>; 2]> {
    let each = samples / 64;
    let run = (samples * MOST).next_power_of_two();
    (samples >= FEWEST).then(|| [run, 2 * run].map(|from| from..from + each.max(1)))
}

/// The pixels of an image of some width that have as many samples each, by their number: from the radiance of two images
/// of few, so that all together have `samples` a pixel at most.
pub(super) fn shares(
    pilots: [&[[f64; 3]]; 2],
    width: usize,
    samples: u32,
) -> BTreeMap<u32, Vec<u32>> {
    // Numbers of samples are powers of two, of which dither makes all others on average.
    let of_pixel = |(i, d): (usize, &f64)| {
        let dither = (i as f64 * GOLDEN).fract() - 0.5;
        ((POWER * d.log2() + dither) * STEPS).round() / STEPS
    };
    let levels: Vec<f64> = deviations(pilots, width)
        .iter()
        .enumerate()
        .map(of_pixel)
        .collect();
    let mut counts = BTreeMap::new();
    for &level in levels.iter().filter(|l| l.is_finite()) {
        *counts.entry((level * STEPS) as i64).or_insert(0u64) += 1;
    }
    let flat = (levels.len() as u64) - counts.values().sum::<u64>();
    let budget = u64::from(samples) * levels.len() as u64;
    // The largest shift of all levels that the budget allows.
    let total = |shift: i64| -> u64 {
        let of_level = |(&level, &count): (&i64, &u64)| {
            count * u64::from(samples_of((level + shift) as f64 / STEPS, samples))
        };
        counts.iter().map(of_level).sum::<u64>() + flat * u64::from(samples_of(f64::MIN, samples))
    };
    let (mut low, mut high) = (-(1i64 << 20), 1i64 << 20);
    while low + 1 < high {
        let middle = (low + high) / 2;
        if total(middle) <= budget {
            low = middle;
        } else {
            high = middle;
        }
    }
    let mut found: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (pixel, level) in levels.iter().enumerate() {
        let count = samples_of(level + low as f64 / STEPS, samples);
        found.entry(count).or_default().push(pixel as u32);
    }
    found
}

/// How many samples a level stands for: a power of two times those of the options.
fn samples_of(level: f64, samples: u32) -> u32 {
    let most = MOST.ilog2() as i32;
    let halvings = level.round().clamp(f64::from(LEAST), f64::from(most)) as i32;
    (f64::from(samples) * f64::from(halvings).exp2()).ceil() as u32
}

/// How much two images differ about each pixel: the root of a mean over its neighbours and, twice, itself.
fn deviations([a, b]: [&[[f64; 3]]; 2], width: usize) -> Vec<f64> {
    let height = a.len() / width;
    let squares: Vec<f64> = (a.iter().zip(b))
        .map(|(a, b)| (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f64>())
        .map(|square| if square.is_finite() { square } else { 0.0 })
        .collect();
    let about = |i: usize, most: usize| i.saturating_sub(1)..(i + 2).min(most);
    let of_pixel = |pixel: usize| {
        let (x, y) = (pixel % width, pixel / width);
        let (mut sum, mut count) = (squares[pixel], 1.0);
        for row in about(y, height) {
            for square in &squares[row * width..][about(x, width)] {
                sum += square;
                count += 1.0;
            }
        }
        (sum / count).sqrt()
    };
    (0..a.len()).map(of_pixel).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pixels of an image of 8 × 8 that differ by so much each, in two images.
    fn counts(difference: impl Fn(usize) -> f64, samples: u32) -> Vec<u32> {
        let a = vec![[0.5; 3]; 64];
        let b: Vec<[f64; 3]> = (0..64).map(|i| [0.5 + difference(i); 3]).collect();
        let mut counts = vec![0; 64];
        for (count, pixels) in shares([&a, &b], 8, samples) {
            for pixel in pixels {
                counts[pixel as usize] = count;
            }
        }
        counts
    }

    #[test]
    fn as_many_samples_as_without_and_more_where_there_is_noise() {
        for samples in [8, 10, 16, 100, 256, 1000] {
            // Noise in two columns at the left.
            let noise = |i: usize| if i % 8 < 2 { 1.0 } else { 0.01 };
            let counts = counts(noise, samples);
            let all: u32 = counts.iter().sum();
            assert!(
                all <= 64 * samples && all > 60 * samples,
                "{samples}: {all}"
            );
            assert!(counts[8] > samples && counts[15] < samples, "{counts:?}");
        }
    }

    #[test]
    fn pixels_that_differ_alike_have_alike_samples() {
        for scale in [1e-30, 1.0, 1e30] {
            let counts = counts(|_| scale, 64);
            assert!(counts.iter().all(|&c| c == 64), "{counts:?}");
        }
        // Nothing differs, or not as a number does.
        for nothing in [0.0, f64::NAN, f64::INFINITY] {
            assert!(counts(|_| nothing, 64).iter().all(|&c| c == 16));
        }
    }

    #[test]
    fn images_to_choose_by_have_samples_of_their_own() {
        assert_eq!(pilots(7), None);
        for samples in [8, 9, 100, 1 << 24] {
            let [a, b] = pilots(samples).expect("two images");
            assert!(a.start >= samples * MOST && a.end <= b.start && !a.is_empty());
        }
    }
}
