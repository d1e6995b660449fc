//! The random numbers of one path, and of neighbouring samples at once.

use std::ops::Range;

use sobol_burley::NUM_DIMENSION_SETS_4D;
use sobol_burley::parts::{owen_scramble_rev, u32_to_f32_norm};

use super::sampler::{Dimension, Sampler, mix, number, points, round, scrambles, unscrambled};
use super::strategies::Sequence;

/// Samples of a pixel whose numbers are drawn at once.
pub(crate) const RUN: usize = 8;

/// The numbers of neighbouring samples of a pixel.
pub(crate) struct Run<'a> {
    sampler: &'a Sampler,
    pixel: u32,
    first: u32,
    index: u32,
    block: u64,
    stage: u64,
    shuffled: [u32; RUN],
    drawn: u8,
    fours: [[[f32; 4]; 8]; RUN],
}

impl Run<'_> {
    /// The numbers of one of the samples.
    pub fn numbers(&self, sample: u32) -> Numbers<'_> {
        let i = (sample - self.first) as usize % RUN;
        Numbers {
            sampler: self.sampler,
            path: (self.pixel, sample),
            index: self.index + i as u32,
            block: self.block,
            shuffled: self.shuffled[i],
            stage: self.stage,
            drawn: self.drawn,
            fours: &self.fours[i],
        }
    }
}

impl Sampler {
    /// The numbers of one path.
    pub(crate) fn numbers(&self, path: (u32, u32)) -> Numbers<'_> {
        let (index, block) = self.place(path);
        let (shuffled, stage) = round(index, block, 0);
        Numbers {
            sampler: self,
            path,
            index,
            block,
            shuffled,
            stage,
            drawn: 0,
            fours: &[],
        }
    }

    /// The numbers of up to [`RUN`] samples of a pixel, of which the first is a multiple of it, with some
    /// of the first eight sets of four dimensions (one bit each) drawn for all at once, which is much
    /// less work than one by one.
    #[inline(always)]
    pub(crate) fn run(&self, pixel: u32, samples: Range<u32>, sets: u8) -> Run<'_> {
        // The samples of a run share a block, and lie side by side in it.
        let (index, block) = self.place((pixel, samples.start));
        let mut run = Run {
            sampler: self,
            pixel,
            first: samples.start,
            index,
            block,
            stage: mix(block),
            shuffled: [0; RUN],
            drawn: if self.sequence == Sequence::Sobol {
                sets
            } else {
                0
            },
            fours: [[[0.0; 4]; 8]; RUN],
        };
        for (i, shuffled) in run.shuffled.iter_mut().enumerate() {
            let index = index.wrapping_add(i as u32);
            *shuffled = owen_scramble_rev(index.reverse_bits(), run.stage as u32);
        }
        let mut left = run.drawn;
        while left != 0 {
            let set = left.trailing_zeros();
            left &= left - 1;
            let table = &points()[set as usize];
            let mut point = [[0; RUN]; 4];
            for (i, &shuffled) in run.shuffled.iter().enumerate() {
                let found = unscrambled(table, shuffled);
                for (values, value) in point.iter_mut().zip(found) {
                    values[i] = value;
                }
            }
            let scramble = scrambles(run.stage, set);
            for d in 0..4 {
                for x in &mut point[d] {
                    let scrambled = owen_scramble_rev(*x, scramble[d]);
                    *x = scrambled.reverse_bits();
                }
                for (fours, &x) in run.fours.iter_mut().zip(&point[d]) {
                    fours[set as usize % 8][d] = u32_to_f32_norm(x);
                }
            }
        }
        run
    }
}

/// The random numbers of one path: those of [`Sampler::uniform`], set by set.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Numbers<'a> {
    sampler: &'a Sampler,
    path: (u32, u32),
    /// In the sequence of the path's block.
    index: u32,
    block: u64,
    /// The index shuffled, its bits reversed, and what scrambles are made from, in the first round
    /// through the dimensions.
    shuffled: u32,
    stage: u64,
    /// Sets that are drawn already, one bit each of the first eight, and their numbers.
    drawn: u8,
    fours: &'a [[f32; 4]],
}

impl Numbers<'_> {
    /// Film x and y, and for an emitter and a point on it, seen from the first surface.
    pub fn film(&self) -> [f32; 4] {
        use Dimension::{EmitterU, EmitterV, FilmX, FilmY};
        self.whole([(FilmX, 0), (FilmY, 0), (EmitterU, 0), (EmitterV, 0)])
    }

    pub fn lens(&self) -> [f32; 2] {
        self.some([(Dimension::LensRadius, 0), (Dimension::LensAngle, 0)])
    }

    pub fn time(&self) -> f32 {
        let [time] = self.some([(Dimension::Time, 0)]);
        time
    }

    /// For a direction, and for an emitter and a point on it, seen from where it leads.
    pub fn direction(&self, bounce: u32) -> [f32; 4] {
        use Dimension::{DirectionU, DirectionV, EmitterU, EmitterV};
        let next = bounce + 1;
        self.whole([
            (DirectionU, bounce),
            (DirectionV, bounce),
            (EmitterU, next),
            (EmitterV, next),
        ])
    }

    pub fn lobe(&self, bounce: u32) -> f32 {
        let [u] = self.some([(Dimension::Lobe, bounce)]);
        u
    }

    pub fn environment(&self, bounce: u32) -> [f32; 2] {
        use Dimension::{EnvironmentU, EnvironmentV};
        self.some([(EnvironmentU, bounce), (EnvironmentV, bounce)])
    }

    pub fn path(&self) -> (u32, u32) {
        self.path
    }

    pub fn roulette(&self, bounce: u32) -> f32 {
        let [u] = self.some([(Dimension::Roulette, bounce)]);
        u
    }

    /// Four numbers for a purpose of their own, of a stream that serves nothing else.
    #[inline(always)]
    pub fn set(&self, set: u32) -> [f32; 4] {
        match self.sampler.sequence {
            Sequence::Sobol => self.four(set),
            Sequence::Independent => [0, 1, 2, 3].map(|d| {
                let purpose = (u64::from(set) << 32) | (16 + d);
                number(mix(self.sampler.seed ^ purpose), self.path)
            }),
        }
    }

    /// A set of four dimensions of the sequence of the path's block: Burley's shuffled and scrambled
    /// points. After 256 dimensions come other scrambles.
    #[inline(always)]
    fn four(&self, set: u32) -> [f32; 4] {
        if set < 8 && self.drawn & (1 << set) != 0 {
            return self.fours[set as usize];
        }
        self.draw(set)
    }

    #[inline(never)]
    fn draw(&self, set: u32) -> [f32; 4] {
        let (shuffled, stage) = match set / NUM_DIMENSION_SETS_4D {
            0 => (self.shuffled, self.stage),
            later => round(self.index, self.block, u64::from(later)),
        };
        let point = unscrambled(&points()[(set % NUM_DIMENSION_SETS_4D) as usize], shuffled);
        let scramble = scrambles(stage, set);
        [0, 1, 2, 3].map(|d| {
            let scrambled = owen_scramble_rev(point[d], scramble[d]);
            u32_to_f32_norm(scrambled.reverse_bits())
        })
    }

    /// Numbers of dimensions that are a whole set of the sequence, or independent ones.
    #[inline(always)]
    fn whole(&self, dimensions: [(Dimension, u32); 4]) -> [f32; 4] {
        let (first, bounce) = dimensions[0];
        match (self.sampler.sequence, first.of_sequence(bounce)) {
            (Sequence::Sobol, Some(place)) => self.four(place / 4),
            _ => self.independent(dimensions),
        }
    }

    /// Numbers of some dimensions of one set of the sequence, or independent ones.
    fn some<const N: usize>(&self, dimensions: [(Dimension, u32); N]) -> [f32; N] {
        let places = dimensions.map(|(d, bounce)| d.of_sequence(bounce));
        match (self.sampler.sequence, places[0]) {
            (Sequence::Sobol, Some(first)) => {
                let four = self.four(first / 4);
                places.map(|d| d.map_or(0.0, |d| four[d as usize % 4]))
            }
            _ => self.independent(dimensions),
        }
    }

    #[inline(never)]
    fn independent<const N: usize>(&self, dimensions: [(Dimension, u32); N]) -> [f32; N] {
        dimensions.map(|(d, bounce)| {
            let purpose = (u64::from(bounce) << 32) | d as u64;
            number(mix(self.sampler.seed ^ purpose), self.path)
        })
    }
}

impl Sampler {
    /// Uniform numbers in [0, 1) for a list of paths, each (pixel, sample), of dimensions of one set: those of
    /// [`Numbers`]. They have 24 bits, so that they are the same numbers in f32 and f64.
    pub(crate) fn uniform<const N: usize>(
        &self,
        paths: &[(u32, u32)],
        bounce: u32,
        dimensions: [Dimension; N],
    ) -> [Vec<f64>; N] {
        let mut found = [(); N].map(|()| Vec::with_capacity(paths.len()));
        for &path in paths {
            let numbers = self.numbers(path).some(dimensions.map(|d| (d, bounce)));
            for (values, number) in found.iter_mut().zip(numbers) {
                values.push(f64::from(number));
            }
        }
        found
    }
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
