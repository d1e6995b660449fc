//! The one place that draws random numbers.

mod numbers;
mod points;

use super::Sequence;
pub(crate) use numbers::{Numbers, RUN, Run};

/// What a random number is for.
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
    /// to be independent of all other paths (`transport/path.rs`).
    fn of_sequence(self, bounce: u32) -> Option<u32> {
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

/// The source of random numbers: a number is a function of (seed, pixel, sample, bounce,
/// dimension), the same on every backend and whatever the tiles and threads.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sampler {
    seed: u64,
    sequence: Sequence,
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

    /// Uniform numbers in [0, 1) for a list of paths, each (pixel, sample). They have 24 bits, so
    /// that they are the same numbers in f32 and f64.
    pub(crate) fn uniform<const N: usize>(
        &self,
        paths: &[(u32, u32)],
        bounce: u32,
        dimensions: [Dimension; N],
    ) -> [Vec<f64>; N] {
        let of_sequence = dimensions.map(|d| d.of_sequence(bounce));
        if self.sequence == Sequence::Sobol
            && let Some(first) = of_sequence[0]
            && of_sequence
                .iter()
                .all(|d| d.is_some_and(|d| d / 4 == first / 4))
        {
            let places = of_sequence.map(|d| d.map_or(0, |d| d as usize % 4));
            return self.sobol(paths, first / 4, places);
        }
        dimensions.map(|d| match (self.sequence, d.of_sequence(bounce)) {
            (Sequence::Sobol, Some(d)) => {
                let [values] = self.sobol(paths, d / 4, [d as usize % 4]);
                values
            }
            _ => self.independent(paths, (u64::from(bounce) << 32) | d as u64),
        })
    }

    /// Independent uniform numbers, one a path, for a purpose of their own.
    fn independent(&self, paths: &[(u32, u32)], purpose: u64) -> Vec<f64> {
        let stage = mix(self.seed ^ purpose);
        paths.iter().map(|&path| number(stage, path)).collect()
    }

    /// One sequence for a block of pixels in Morton order, each with a run of it: the numbers of a
    /// pixel are stratified, and so are those of its block together (Ahmed and Wonka 2020). It ends
    /// after 2¹⁶ numbers and 256 dimensions: past them come other scrambles.
    fn sobol<const N: usize>(
        &self,
        paths: &[(u32, u32)],
        set: u32,
        places: [usize; N],
    ) -> [Vec<f64>; N] {
        let mut found = [(); N].map(|()| Vec::with_capacity(paths.len()));
        for &path in paths {
            let four = self.numbers(path).four(set);
            for (values, &p) in found.iter_mut().zip(&places) {
                values.push(f64::from(four[p]));
            }
        }
        found
    }

    /// The place of a path in the sequence of its block of pixels, and what is the block's own.
    fn place(&self, (pixel, sample): (u32, u32)) -> (u32, u64) {
        let place = morton(pixel % self.width, pixel / self.width);
        let run = place & ((1 << self.pixels) - 1);
        let index = (run << self.samples) as u32 | (sample & ((1 << self.samples) - 1));
        let block = mix(self.seed ^ (place >> self.pixels)) ^ u64::from(sample >> self.samples);
        (index, block)
    }
}

/// A uniform number of a path.
fn number(stage: u64, (pixel, sample): (u32, u32)) -> f64 {
    let h = mix(stage ^ ((u64::from(pixel) << 32) | u64::from(sample)));
    (h >> 40) as f64 / (1u64 << 24) as f64
}

/// The bits of x and y in turn.
fn morton(x: u32, y: u32) -> u64 {
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

/// The finaliser of SplitMix64 (Steele et al. 2014), applied after an odd offset.
pub(crate) fn mix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_uniform_and_uncorrelated_between_dimensions() {
        for sequence in [Sequence::Independent, Sequence::Sobol] {
            uncorrelated(Sampler::new(3, sequence, 64, 16));
        }
    }

    fn uncorrelated(sampler: Sampler) {
        let paths: Vec<_> = (0..65536).map(|i| (i / 16, i % 16)).collect();
        let [a] = sampler.uniform(&paths, 0, [Dimension::FilmX]);
        let [b] = sampler.uniform(&paths, 1, [Dimension::EmitterU]);
        let mean = |f: &dyn Fn(usize) -> f64| (0..a.len()).map(f).sum::<f64>() / a.len() as f64;
        // Standard errors: 0.0011 of the mean, 0.0003 of a covariance; four of them.
        assert!((mean(&|i| a[i]) - 0.5).abs() < 0.0045);
        assert!((mean(&|i| a[i] * a[i]) - 1.0 / 3.0).abs() < 0.005);
        assert!(mean(&|i| (a[i] - 0.5) * (b[i] - 0.5)).abs() < 0.0013);
        assert!(mean(&|i| (a[i] - 0.5) * (a[(i + 16) % a.len()] - 0.5)).abs() < 0.0013);
        assert!(a.iter().all(|&x| (0.0..1.0).contains(&x)));
        assert!(a.iter().all(|&x| x == f64::from(x as f32)));
    }

    /// Each of n samples of a pixel falls into another n-th of every dimension, and scrambles of
    /// other seeds, pixels and rounds are others.
    #[test]
    fn sobol_numbers_are_stratified() {
        let of = |seed, pixel: u32, bounce, d| {
            let paths: Vec<_> = (0..64).map(|s| (pixel, s)).collect();
            let sampler = Sampler::new(seed, Sequence::Sobol, 8, 64);
            let [values] = sampler.uniform(&paths, bounce, [d]);
            values
        };
        let mut seen: Vec<Vec<f64>> = Vec::new();
        for (seed, pixel) in [(1, 0), (2, 0), (1, 1)] {
            for bounce in [0, 1, 30, 31, 40, 100] {
                for d in [Dimension::EmitterU, Dimension::DirectionV, Dimension::Lobe] {
                    let values = of(seed, pixel, bounce, d);
                    let mut cells: Vec<u32> = values.iter().map(|v| (v * 64.0) as u32).collect();
                    cells.sort_unstable();
                    assert!(cells.iter().copied().eq(0..64), "{bounce}, {d:?}");
                    assert!(!seen.contains(&values), "{bounce}, {d:?}");
                    seen.push(values);
                }
            }
        }
        // Past 2¹⁶ samples another scramble goes on.
        let paths: Vec<_> = (0..1 << 17).map(|s| (7, s)).collect();
        let sampler = Sampler::new(1, Sequence::Sobol, 8, 1 << 17);
        let [values] = sampler.uniform(&paths, 0, [Dimension::FilmX]);
        assert_ne!(values[..1 << 16], values[1 << 16..]);
        // The pixels of a block together.
        let paths: Vec<_> = (0..64).flat_map(|p| (0..16).map(move |s| (p, s))).collect();
        let sampler = Sampler::new(5, Sequence::Sobol, 8, 16);
        let [values] = sampler.uniform(&paths, 1, [Dimension::EmitterU]);
        let mut cells: Vec<u32> = values.iter().map(|v| (v * 1024.0) as u32).collect();
        cells.sort_unstable();
        assert!(cells.into_iter().eq(0..1024));
    }
}
