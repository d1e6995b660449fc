//! Adaptive sampling: how many samples each pixel has.
//!
//! The squared error of an image is least where pixels have samples in proportion to their standard deviation, over the
//! root of what a sample costs (Neyman 1934). Two images of few samples, from random numbers of their own, tell both:
//! their squared difference about each pixel, and the number of their rays. These images are no part of the result, so
//! what a pixel's samples are does not depend on how many it has: each mean is unbiased.

use std::collections::BTreeMap;
use std::ops::Range;

/// Samples of a pixel over those of the options, at least ([`LEAST`] halvings) and at most.
const LEAST: f64 = -2.0;
pub(super) const MOST: u32 = 16;

/// With fewer samples, two images to choose by would show little for what they take.
const FEWEST: u32 = 32;

/// The standard deviation's power that samples go by: a few differences tell it roughly, and samples of sequences, which
/// lie the more evenly the more there are, gain most from the first.
const POWER: f64 = 0.7;

/// The share of the squared error that must be left at most: what the two images show is rough, and sequences lie less
/// evenly where neighbouring pixels have other numbers of samples.
const WORTH_IT: f64 = 0.75;

/// What a camera ray costs, over the other rays of a path with what is computed where they end.
const OF_CAMERA: f64 = 0.1;

/// Logarithms to base 2 are compared in steps, and limited where nothing differs.
const STEPS: f64 = 256.0;
const LIMIT: f64 = 1024.0;

/// The samples that tell how noisy pixels are, of each of two images, unless there are too few in all. They come after
/// all that pixels may have, in runs of a length that is a power of two, which have random numbers of their own each.
pub(super) fn pilots(samples: u32) -> Option<[Range<u32>; 2]> {
    let each = samples / 64;
    let run = (samples * MOST).next_power_of_two();
    (samples >= FEWEST).then(|| [run, 2 * run].map(|from| from..from + each.max(1)))
}

/// The pixels of an image of some width that have as many samples each, by their number: from the radiance of two images
/// of few and the rays of their paths, so that all together have at most as many rays as by `samples` a pixel.
pub(super) fn shares(
    pilots: [&[[f64; 4]]; 2],
    width: usize,
    samples: u32,
) -> BTreeMap<u32, Vec<u32>> {
    let found = deviations(pilots, width);
    let of_pixel = |&(deviation, rays): &(f64, f64)| {
        let level = POWER * (deviation / rays.sqrt()).log2();
        (level.max(-LIMIT) * STEPS).round() as i64
    };
    let levels: Vec<i64> = found.iter().map(of_pixel).collect();
    let mut costs = BTreeMap::new();
    for (&level, &(_, rays)) in levels.iter().zip(&found) {
        *costs.entry(level).or_insert(0.0) += rays;
    }
    let budget = f64::from(samples) * costs.values().sum::<f64>();
    // The largest shift of all levels that the budget allows.
    let total = |shift: i64| -> f64 {
        let of_level =
            |(&level, &cost): (&i64, &f64)| cost * f64::from(samples_of(level + shift, samples));
        costs.iter().map(of_level).sum()
    };
    let most = (2.0 * LIMIT * STEPS) as i64;
    let (mut low, mut high) = (-most, most);
    while low + 1 < high {
        let middle = (low + high) / 2;
        if total(middle) <= budget {
            low = middle;
        } else {
            high = middle;
        }
    }
    let count_of = |level: i64| samples_of(level + low, samples);
    // Of the squared error, as far as the two images show it.
    let all: f64 = found.iter().map(|f| f.0 * f.0).sum();
    let of_pixel = |(f, &level): (&(f64, f64), &i64)| f.0 * f.0 / f64::from(count_of(level));
    let left = found.iter().zip(&levels).map(of_pixel).sum::<f64>() * f64::from(samples);
    let worth_it = left < WORTH_IT * all;
    let mut shares: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (pixel, &level) in levels.iter().enumerate() {
        let count = if worth_it { count_of(level) } else { samples };
        shares.entry(count).or_default().push(pixel as u32);
    }
    shares
}

/// How many samples a level stands for: a power of two times those of the options.
fn samples_of(level: i64, samples: u32) -> u32 {
    let most = f64::from(MOST).log2();
    let halvings = (level as f64 / STEPS).round().clamp(LEAST, most);
    (f64::from(samples) * halvings.exp2()).ceil() as u32
}

/// How much two images differ about each pixel, the root of a mean over its neighbours and, twice, itself; and the mean
/// rays of paths there.
fn deviations([a, b]: [&[[f64; 4]]; 2], width: usize) -> Vec<(f64, f64)> {
    let height = a.len() / width;
    let of_pair = |(a, b): (&[f64; 4], &[f64; 4])| {
        let square: f64 = (0..3).map(|c| (a[c] - b[c]).powi(2)).sum();
        let square = if square.is_finite() { square } else { 0.0 };
        (square, OF_CAMERA + (a[3] + b[3]) / 2.0 - 1.0)
    };
    let pairs: Vec<(f64, f64)> = a.iter().zip(b).map(of_pair).collect();
    let about = |i: usize, most: usize| i.saturating_sub(1)..(i + 2).min(most);
    let of_pixel = |pixel: usize| {
        let (x, y) = (pixel % width, pixel / width);
        let (mut square, mut rays) = pairs[pixel];
        let mut count = 1.0;
        for row in about(y, height) {
            for pair in &pairs[row * width..][about(x, width)] {
                square += pair.0;
                rays += pair.1;
                count += 1.0;
            }
        }
        ((square / count).sqrt(), rays / count)
    };
    (0..a.len()).map(of_pixel).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Samples of the pixels of an image of 32 × 8 that differ by so much each, in two images, with so many rays.
    fn counts(of: impl Fn(usize) -> (f64, f64), samples: u32) -> Vec<u32> {
        let image = |factor: f64| -> Vec<[f64; 4]> {
            let pixel = |i| [0.5 + factor * of(i).0, 0.5, 0.5, of(i).1];
            (0..256).map(pixel).collect()
        };
        let mut counts = vec![0; 256];
        for (count, pixels) in shares([&image(0.0), &image(1.0)], 32, samples) {
            for pixel in pixels {
                counts[pixel as usize] = count;
            }
        }
        counts
    }

    #[test]
    fn as_many_rays_as_without_and_more_where_there_is_noise() {
        for samples in [32, 40, 100, 256, 1000] {
            for rays in [2.0, 7.0] {
                // Noise in a column.
                let of = |i: usize| {
                    if i % 32 == 3 {
                        (1.0, rays)
                    } else {
                        (0.01, 2.0)
                    }
                };
                let counts = counts(of, samples);
                let cost = |(i, &count): (usize, &u32)| of(i).1 * f64::from(count);
                let all: f64 = counts.iter().enumerate().map(cost).sum();
                let plain = f64::from(samples) * (8.0 * rays + 248.0 * 2.0);
                assert!(
                    all <= 1.1 * plain && all > 0.5 * plain,
                    "{samples}: {all} of {plain}"
                );
                assert!(counts[35] > samples && counts[40] < samples, "{counts:?}");
            }
        }
    }

    #[test]
    fn of_two_noises_alike_the_cheaper_has_more() {
        let of = |i: usize| match i % 32 {
            3 => (1.0, 2.0),
            10 => (1.0, 40.0),
            _ => (0.001, 2.0),
        };
        let counts = counts(of, 64);
        assert!(counts[35] >= 2 * counts[42], "{counts:?}");
    }

    #[test]
    fn pixels_that_differ_alike_have_as_many_as_without() {
        for scale in [0.0, 1e-30, 1.0, 1e30, f64::NAN, f64::INFINITY] {
            assert_eq!(counts(|_| (scale, 3.0), 64), [64; 256]);
        }
    }

    #[test]
    fn images_to_choose_by_have_samples_of_their_own() {
        assert_eq!(pilots(31), None);
        for samples in [32, 100, 1 << 24] {
            let [a, b] = pilots(samples).expect("two images");
            assert!(a.start >= samples * MOST && a.end <= b.start && !a.is_empty());
        }
    }
}
