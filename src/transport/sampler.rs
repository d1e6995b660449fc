//! The one place that draws random numbers.

use std::ops::Range;
use std::sync::OnceLock;

use sobol_burley::NUM_DIMENSION_SETS_4D;
use sobol_burley::parts::{owen_scramble_rev, sobol_rev, u32_to_f32_norm};

use super::Sequence;

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

/// The place of a path in a round through the dimensions, its bits reversed, and what scrambles are made
/// from.
fn round(index: u32, block: u64, round: u64) -> (u32, u64) {
    let stage = mix(block ^ (round << 32));
    (owen_scramble_rev(index.reverse_bits(), stage as u32), stage)
}

/// What scrambles a set of four dimensions.
#[inline(always)]
fn scrambles(stage: u64, set: u32) -> [u32; 4] {
    let a = mix(stage ^ u64::from(set + 1));
    let b = mix(a);
    [a as u32, (a >> 32) as u32, b as u32, (b >> 32) as u32]
}

/// Points of the Sobol sequence of four dimensions by four bits of the index at a time: a point is the
/// sum, without carry, of those of the parts of its index.
type Points = [[[u32; 4]; 16]; 4];

/// For each set of four dimensions.
fn points() -> &'static [Points] {
    static POINTS: OnceLock<Vec<Points>> = OnceLock::new();
    POINTS.get_or_init(|| {
        let of_bits = |set: u32, part: u32, bits: u32| {
            [0, 1, 2, 3].map(|d| sobol_rev(bits << (28 - 4 * part), 4 * set + d))
        };
        let of_set = |set| {
            [0, 1, 2, 3].map(|part| std::array::from_fn(|bits| of_bits(set, part, bits as u32)))
        };
        (0..NUM_DIMENSION_SETS_4D).map(of_set).collect()
    })
}

#[inline(always)]
fn unscrambled(points: &Points, shuffled: u32) -> [u32; 4] {
    let part = |i: usize| points[i][(shuffled >> (28 - 4 * i)) as usize % 16];
    let [a, b, c, d] = [part(0), part(1), part(2), part(3)];
    let mut sum = [0; 4];
    for i in 0..4 {
        sum[i] = a[i] ^ b[i] ^ c[i] ^ d[i];
    }
    sum
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
    pub fn film(&self) -> [f64; 4] {
        use Dimension::{EmitterU, EmitterV, FilmX, FilmY};
        self.whole([(FilmX, 0), (FilmY, 0), (EmitterU, 0), (EmitterV, 0)])
    }

    /// Lens radius and angle.
    pub fn lens(&self) -> [f64; 2] {
        self.some([(Dimension::LensRadius, 0), (Dimension::LensAngle, 0)])
    }

    /// Time in the shutter.
    pub fn time(&self) -> f64 {
        let [time] = self.some([(Dimension::Time, 0)]);
        time
    }

    /// For the choice of a surface.
    pub fn surface(&self, bounce: u32) -> f64 {
        let [u] = self.some([(Dimension::Surface, bounce)]);
        u
    }

    /// For a direction, and for an emitter and a point on it, seen from where it leads.
    pub fn direction(&self, bounce: u32) -> [f64; 4] {
        use Dimension::{DirectionU, DirectionV, EmitterU, EmitterV};
        let next = bounce + 1;
        self.whole([
            (DirectionU, bounce),
            (DirectionV, bounce),
            (EmitterU, next),
            (EmitterV, next),
        ])
    }

    /// For the choice of a lobe.
    pub fn lobe(&self, bounce: u32) -> f64 {
        let [u] = self.some([(Dimension::Lobe, bounce)]);
        u
    }

    /// For a direction to the environment.
    pub fn environment(&self, bounce: u32) -> [f64; 2] {
        use Dimension::{EnvironmentU, EnvironmentV};
        self.some([(EnvironmentU, bounce), (EnvironmentV, bounce)])
    }

    /// For survival.
    pub fn roulette(&self, bounce: u32) -> f64 {
        let [u] = self.some([(Dimension::Roulette, bounce)]);
        u
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
    fn whole(&self, dimensions: [(Dimension, u32); 4]) -> [f64; 4] {
        let (first, bounce) = dimensions[0];
        match (self.sampler.sequence, first.of_sequence(bounce)) {
            (Sequence::Sobol, Some(place)) => {
                let [a, b, c, d] = self.four(place / 4);
                [a.into(), b.into(), c.into(), d.into()]
            }
            _ => self.independent(dimensions),
        }
    }

    /// Numbers of some dimensions of one set of the sequence, or independent ones.
    fn some<const N: usize>(&self, dimensions: [(Dimension, u32); N]) -> [f64; N] {
        let places = dimensions.map(|(d, bounce)| d.of_sequence(bounce));
        match (self.sampler.sequence, places[0]) {
            (Sequence::Sobol, Some(first)) => {
                let four = self.four(first / 4);
                places.map(|d| d.map_or(0.0, |d| f64::from(four[d as usize % 4])))
            }
            _ => self.independent(dimensions),
        }
    }

    #[inline(never)]
    fn independent<const N: usize>(&self, dimensions: [(Dimension, u32); N]) -> [f64; N] {
        dimensions.map(|(d, bounce)| {
            let purpose = (u64::from(bounce) << 32) | d as u64;
            number(mix(self.sampler.seed ^ purpose), self.path)
        })
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
