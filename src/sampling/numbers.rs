//! The random numbers of paths on the host, and those of neighbouring samples at once.

use std::ops::Range;

use super::Sequence;
use super::sampler::Sampler;
use super::stream::{Dimensions, Four, Stream, number, point_of, points, scrambled, scrambles};

/// The random numbers of one path, some of which are drawn already.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Numbers<'a> {
    stream: Stream,
    /// Sets that are drawn already, one bit each of the first eight, and their numbers.
    drawn: u8,
    fours: &'a [Four],
}

impl Numbers<'_> {
    /// Pixel and sample.
    pub fn path(&self) -> (u32, u32) {
        (self.stream.pixel, self.stream.sample)
    }

    #[inline(always)]
    pub fn draw(&self, what: Dimensions) -> Four {
        if what.set < 8 && self.drawn & (1 << what.set) != 0 {
            return self.fours[what.set as usize];
        }
        self.draw_now(what)
    }

    #[inline(never)]
    fn draw_now(&self, what: Dimensions) -> Four {
        self.stream.draw(points(), what)
    }
}

/// Samples of a pixel whose numbers are drawn at once.
pub(crate) const RUN: usize = 8;

/// The numbers of neighbouring samples of a pixel.
pub(crate) struct Run {
    first: Stream,
    shuffled: [u32; RUN],
    drawn: u8,
    fours: [[Four; 8]; RUN],
}

impl Run {
    pub fn pixel(&self) -> u32 {
        self.first.pixel
    }

    /// The numbers of one of the samples.
    pub fn numbers(&self, sample: u32) -> Numbers<'_> {
        let i = (sample - self.first.sample) as usize % RUN;
        Numbers {
            // Samples of a run share a block, and lie side by side in it.
            stream: Stream {
                sample,
                index: self.first.index + i as u32,
                shuffled: self.shuffled[i],
                ..self.first
            },
            drawn: self.drawn,
            fours: &self.fours[i],
        }
    }
}

impl Sampler {
    /// The numbers of one path, each (pixel, sample).
    pub(crate) fn numbers(&self, (pixel, sample): (u32, u32)) -> Numbers<'static> {
        Numbers {
            stream: self.stream(pixel, sample),
            drawn: 0,
            fours: &[],
        }
    }

    /// The numbers of up to [`RUN`] samples of a pixel, of which the first is a multiple of it, with some
    /// of the first eight sets of four dimensions (one bit each) drawn for all at once, which is much
    /// less work than one by one.
    #[inline(always)]
    pub(crate) fn run(&self, pixel: u32, samples: Range<u32>, sets: u8) -> Run {
        let first = self.stream(pixel, samples.start);
        let mut run = Run {
            first,
            shuffled: [0; RUN],
            drawn: match self.sequence {
                Sequence::Sobol => sets,
                Sequence::Independent => 0,
            },
            fours: [[Four::default(); 8]; RUN],
        };
        for (i, shuffled) in run.shuffled.iter_mut().enumerate() {
            let index = first.index + i as u32;
            *shuffled = scrambled(index.reverse_bits(), first.stage.low);
        }
        let mut left = run.drawn;
        while left != 0 {
            let set = left.trailing_zeros();
            left &= left - 1;
            let mut point = [[0; RUN]; 4];
            for (i, &shuffled) in run.shuffled.iter().enumerate() {
                let found = point_of(points(), set, shuffled);
                for (values, value) in point.iter_mut().zip([found.x, found.y, found.z, found.w]) {
                    values[i] = value;
                }
            }
            let s = scrambles(first.stage, set);
            let mut drawn = [[0.0; RUN]; 4];
            for (d, scramble) in [s.x, s.y, s.z, s.w].into_iter().enumerate() {
                for i in 0..RUN {
                    drawn[d][i] = number(point[d][i], scramble);
                }
            }
            for (i, fours) in run.fours.iter_mut().enumerate() {
                let [x, y, z, w] = [drawn[0][i], drawn[1][i], drawn[2][i], drawn[3][i]];
                fours[set as usize % 8] = Four { x, y, z, w };
            }
        }
        run
    }

    /// Numbers of four dimensions for a list of paths, each (pixel, sample). They have 24 bits, so that they are the
    /// same numbers in f32 and f64.
    pub(crate) fn uniform(&self, paths: &[(u32, u32)], what: Dimensions) -> [Vec<f64>; 4] {
        let mut found = [(); 4].map(|()| Vec::with_capacity(paths.len()));
        for &path in paths {
            let Four { x, y, z, w } = self.numbers(path).draw(what);
            for (values, number) in found.iter_mut().zip([x, y, z, w]) {
                values.push(f64::from(number));
            }
        }
        found
    }

    /// For the choice between surfaces that share a ray: the control variate of that needs numbers that are independent
    /// of all other paths (`tensors/path.rs`).
    pub(crate) fn of_surfaces(&self, paths: &[(u32, u32)], bounce: u32) -> Vec<f64> {
        let of = |&(pixel, sample)| f64::from(self.stream(pixel, sample).independent(bounce, 5));
        paths.iter().map(of).collect()
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
        let [a, ..] = sampler.uniform(&paths, Dimensions::film());
        let [_, _, b, _] = sampler.uniform(&paths, Dimensions::direction(0));
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
        let of = |seed, pixel: u32, what| {
            let paths: Vec<_> = (0..64).map(|s| (pixel, s)).collect();
            Sampler::new(seed, Sequence::Sobol, 8, 64).uniform(&paths, what)
        };
        let mut seen: Vec<Vec<f64>> = Vec::new();
        for (seed, pixel) in [(1, 0), (2, 0), (1, 1)] {
            for bounce in [0, 1, 30, 31, 40, 100] {
                let [_, _, emitter, _] = of(seed, pixel, Dimensions::emitter(bounce));
                let [_, direction, ..] = of(seed, pixel, Dimensions::direction(bounce));
                let [lobe, ..] = of(seed, pixel, Dimensions::choices(bounce));
                for (d, values) in [emitter, direction, lobe].into_iter().enumerate() {
                    let mut cells: Vec<u32> = values.iter().map(|v| (v * 64.0) as u32).collect();
                    cells.sort_unstable();
                    assert!(cells.iter().copied().eq(0..64), "{bounce}, {d}");
                    assert!(!seen.contains(&values), "{bounce}, {d}");
                    seen.push(values);
                }
            }
        }
        // Past 2¹⁶ samples another scramble goes on.
        let paths: Vec<_> = (0..1 << 17).map(|s| (7, s)).collect();
        let sampler = Sampler::new(1, Sequence::Sobol, 8, 1 << 17);
        let [values, ..] = sampler.uniform(&paths, Dimensions::film());
        assert_ne!(values[..1 << 16], values[1 << 16..]);
        // The pixels of a block together.
        let paths: Vec<_> = (0..64).flat_map(|p| (0..16).map(move |s| (p, s))).collect();
        let sampler = Sampler::new(5, Sequence::Sobol, 8, 16);
        let [_, _, values, _] = sampler.uniform(&paths, Dimensions::direction(0));
        let mut cells: Vec<u32> = values.iter().map(|v| (v * 1024.0) as u32).collect();
        cells.sort_unstable();
        assert!(cells.into_iter().eq(0..1024));
    }
}
