//! Uniform numbers for lists of paths.

use super::dimension::Dimension;
use super::mix::{mix, number};
use super::source::Sampler;
use super::strategies::Sequence;

impl Sampler {
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
