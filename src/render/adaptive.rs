//! Adaptive sampling: the number of samples of each pixel.
//!
//! The squared error of an image is minimal if each pixel's number of samples is proportional to σ / √cost, with the
//! standard deviation σ and the cost of a sample (Neyman 1934). Two pilot images with few samples and independent
//! random numbers estimate both: σ from their squared difference around each pixel, the cost from their numbers of
//! rays. The pilots are not part of the result. A pixel's samples are therefore independent of their number, and each
//! mean is unbiased.

use std::collections::BTreeMap;
use std::ops::Range;

/// The range of a pixel's number of samples, relative to the options: a minimum of 2^[`MIN_RATIO_LOG`] and a maximum
/// of [`MAX_SAMPLES_RATIO`].
const MIN_RATIO_LOG: f64 = -2.0;
pub(super) const MAX_SAMPLES_RATIO: u32 = 16;

/// The minimum number of samples. With fewer, pilots would show little for their cost.
const MIN_SAMPLES: u32 = 32;

/// The exponent applied to σ / √cost. It is below 1 since few differences estimate σ roughly, and since low-discrepancy
/// samples, which get more even with their number, gain most from the first ones.
const POWER: f64 = 0.7;

/// The maximum estimated ratio of squared errors, adaptive over uniform, at which adaptive sampling is used. It leaves
/// a margin, since the estimate is rough, and sequences are less even where neighboring pixels differ in their numbers
/// of samples.
const WORTH_IT: f64 = 0.75;

/// The cost of a camera ray relative to another ray of a path, including the computation at its end.
const OF_CAMERA: f64 = 0.1;

/// Steps per unit of base-2 logarithms, and the limit of their magnitude (for pixels without a difference).
const STEPS: f64 = 256.0;
const LIMIT: f64 = 1024.0;

/// Returns the sample ranges of the two pilot images, or `None` with too few samples. They lie behind all samples that
/// a pixel may have. Each starts at a multiple of a power of two, so its random numbers are independent.
pub(super) fn pilots(samples: u32) -> Option<[Range<u32>; 2]> {
    let each = samples / 64;
    let run = (samples * MAX_SAMPLES_RATIO).next_power_of_two();
    (samples >= MIN_SAMPLES).then(|| [run, 2 * run].map(|from| from..from + each.max(1)))
}

/// Groups the pixels of an image by their number of samples. `pilots` holds radiance and rays per path of the two pilot
/// images. The total cost in rays is at most that of `samples` samples in each pixel.
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
    // Bisection for the largest shift of all levels within the budget.
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
    // The squared errors with uniform and with adaptive sampling, as the pilots estimate them.
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

/// The number of samples of a level: a power of two times that of the options.
fn samples_of(level: i64, samples: u32) -> u32 {
    let most = f64::from(MAX_SAMPLES_RATIO).log2();
    let halvings = (level as f64 / STEPS).round().clamp(MIN_RATIO_LOG, most);
    (f64::from(samples) * halvings.exp2()).ceil() as u32
}

/// Returns for each pixel the root mean square difference of the pilots and the mean cost of a path. Both means include
/// the neighbors once and the pixel itself twice.
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

    /// Sample counts for an image of 32 × 8 pixels. `of` returns a pixel's difference between the pilots, and its rays.
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
                // One noisy column.
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
            assert!(a.start >= samples * MAX_SAMPLES_RATIO && a.end <= b.start && !a.is_empty());
        }
    }
}
