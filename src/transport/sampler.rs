//! The one place that draws random numbers.

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
    Emitter,
    EmitterU,
    EmitterV,
    Lobe,
    DirectionU,
    DirectionV,
    Roulette,
}

/// A counter-based source: a number is a function of (seed, pixel, sample, bounce, dimension), the
/// same on every backend and whatever the tiles and threads.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sampler {
    seed: u64,
}

impl Sampler {
    pub(crate) fn new(seed: u64) -> Self {
        Self {
            seed: mix(seed ^ 0x9e37_79b9_7f4a_7c15),
        }
    }

    /// Uniform numbers in [0, 1) for a list of paths, each (pixel, sample). They have 24 bits, so
    /// that they are the same numbers in f32 and f64.
    pub(crate) fn uniform(
        &self,
        paths: &[(u32, u32)],
        bounce: u32,
        dimension: Dimension,
    ) -> Vec<f64> {
        let stage = mix(self.seed ^ ((u64::from(bounce) << 32) | dimension as u64));
        paths
            .iter()
            .map(|&(pixel, sample)| {
                let h = mix(stage ^ ((u64::from(pixel) << 32) | u64::from(sample)));
                (h >> 40) as f64 / (1u64 << 24) as f64
            })
            .collect()
    }
}

/// The finaliser of SplitMix64 (Steele et al. 2014), applied after an odd offset.
fn mix(x: u64) -> u64 {
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
        let sampler = Sampler::new(3);
        let paths: Vec<_> = (0..65536).map(|i| (i / 16, i % 16)).collect();
        let a = sampler.uniform(&paths, 0, Dimension::FilmX);
        let b = sampler.uniform(&paths, 1, Dimension::FilmX);
        let mean = |f: &dyn Fn(usize) -> f64| (0..a.len()).map(f).sum::<f64>() / a.len() as f64;
        // Standard errors: 0.0011 of the mean, 0.0003 of a covariance; four of them.
        assert!((mean(&|i| a[i]) - 0.5).abs() < 0.0045);
        assert!((mean(&|i| a[i] * a[i]) - 1.0 / 3.0).abs() < 0.005);
        assert!(mean(&|i| (a[i] - 0.5) * (b[i] - 0.5)).abs() < 0.0013);
        assert!(mean(&|i| (a[i] - 0.5) * (a[(i + 1) % a.len()] - 0.5)).abs() < 0.0013);
        assert!(a.iter().all(|&x| (0.0..1.0).contains(&x)));
    }
}
