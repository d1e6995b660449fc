//! The random numbers of paths on the host, for one path and for eight paths at once.

use super::Sequence;
use super::sampler::Sampler;
use super::stream::{Dimensions, Stream, number, point_of, scrambled, scrambles, x_of, y_of};
use super::table::{OF_PAIR, PAIRS, points};
use crate::lanes::{LANES, Record};
use crate::model::Four;

/// The bits of a shuffled index that neighbors in a sequence share.
const SHARED: u32 = u32::MAX >> 4;

impl Stream {
    /// Returns four numbers.
    #[inline(never)]
    pub fn numbers(&self, what: Dimensions) -> Four {
        self.draw(points(), what)
    }

    /// Returns the stream of the same pixel, `samples` samples later. Both samples must be neighbors in the sequence.
    #[inline(always)]
    pub fn after(&self, samples: u32) -> Self {
        let index = self.index + samples;
        Self {
            sample: self.sample + samples,
            index,
            shuffled: scrambled(index.reverse_bits(), self.stage.low),
            ..*self
        }
    }
}

/// Returns four numbers for each of eight paths. Neighboring samples share most of the work.
#[inline(always)]
pub fn draw_eight(streams: [&Stream; LANES], what: Dimensions) -> <Four as Record>::Lanes {
    let mut out = <Four as Record>::Lanes::default();
    if streams[0].sequence == Sequence::Independent {
        for (i, stream) in streams.into_iter().enumerate() {
            stream.numbers(what).set(&mut out, i);
        }
        return out;
    }
    let [first, second] = [what.first, what.second].map(|pair| pair % PAIRS);
    let rounds = [what.first, what.second].map(|pair| pair / PAIRS);
    let places = places(&streams, rounds[0]);
    let others = if rounds[1] == rounds[0] {
        places
    } else {
        self::places(&streams, rounds[1])
    };
    let [of_first, of_second] = [first, second].map(of_pair);
    let [mut coordinates, mut seeds] = [[[0; 4]; LANES]; 2];
    let (mut last, mut rests) = (streams[0], [0; 2]);
    let (mut points_of_rest, mut scramble) = ([0; 2], [0; 4]);
    for (i, stream) in streams.into_iter().enumerate() {
        let own = [places[i], others[i]];
        if i == 0 || stream.stage != last.stage || own.map(|p| p & SHARED) != rests {
            rests = own.map(|p| p & SHARED);
            let a = point_of(points(), first, rests[0]);
            let b = point_of(points(), second, rests[1]);
            let s = scrambles(stream.stage, what.set);
            points_of_rest = [a, b];
            scramble = [s.x, s.y, s.z, s.w];
            last = stream;
        }
        let [a, b] = own.map(|p| (p >> 28) as usize);
        let a = points_of_rest[0] ^ of_first[a];
        let b = points_of_rest[1] ^ of_second[b];
        coordinates[i] = [x_of(a), y_of(a), x_of(b), y_of(b)];
        seeds[i] = scramble;
    }
    let mut numbers = [[0.0; 4]; LANES];
    let all = coordinates.as_flattened().iter().zip(seeds.as_flattened());
    for (drawn, (&coordinate, &seed)) in numbers.as_flattened_mut().iter_mut().zip(all) {
        *drawn = number(coordinate, seed);
    }
    for (i, [x, y, z, w]) in numbers.into_iter().enumerate() {
        Four { x, y, z, w }.set(&mut out, i);
    }
    out
}

/// Returns the table's words for a pair of dimensions.
#[inline(always)]
fn of_pair(pair: u32) -> &'static [u32] {
    let first = pair as usize * OF_PAIR;
    &points()[first..first + OF_PAIR]
}

/// Returns the shuffled indices of eight paths in the sequence of a round.
#[inline(always)]
fn places(streams: &[&Stream; LANES], round: u32) -> [u32; LANES] {
    if round > 0 {
        return later_places(streams, round);
    }
    streams.map(|stream| stream.shuffled)
}

#[inline(never)]
fn later_places(streams: &[&Stream; LANES], round: u32) -> [u32; LANES] {
    streams.map(|stream| stream.place(round))
}

impl Sampler {
    /// Returns numbers in four dimensions for a list of paths (pixel, sample). They have at most 24 bits, so they are
    /// the same numbers in f32 and f64.
    pub fn uniform(&self, paths: &[(u32, u32)], what: Dimensions) -> [Vec<f64>; 4] {
        let mut found = [(); 4].map(|()| Vec::with_capacity(paths.len()));
        for &path in paths {
            let Four { x, y, z, w } = self.stream(path.0, path.1).numbers(what);
            for (values, number) in found.iter_mut().zip([x, y, z, w]) {
                values.push(f64::from(number));
            }
        }
        found
    }

    /// Returns numbers for the choice between surfaces that share a ray. They are independent of all other paths, which
    /// the control variate of the choice requires (`tensors/path.rs`).
    pub fn of_surfaces(&self, paths: &[(u32, u32)], bounce: u32) -> Vec<f64> {
        let of = |&(pixel, sample)| f64::from(self.stream(pixel, sample).independent(bounce, 5));
        paths.iter().map(of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eight_paths_draw_the_numbers_of_each() {
        for sequence in [Sequence::Independent, Sequence::Sobol] {
            let sampler = Sampler::new(3, sequence, 64, 32);
            let first = sampler.stream(77, 16);
            let run = [0, 1, 2, 3, 4, 5, 6, 7].map(|i| first.after(i));
            let others = [5, 6, 0, 900, 41, 7, 7, 8].map(|i| sampler.stream(3 * i, i));
            let mixed =
                [0, 1, 2, 3, 4, 5, 6, 7].map(|i| if i % 3 == 0 { run[i] } else { others[i] });
            for streams in [run, others, mixed] {
                for set in [0, 1, 7, 63, 64, 200] {
                    let what = Dimensions::of_set(set);
                    let found = draw_eight(streams.each_ref(), what);
                    for (i, stream) in streams.iter().enumerate() {
                        let own = sampler.stream(stream.pixel, stream.sample);
                        assert_eq!(Four::get(&found, i), own.numbers(what));
                    }
                }
            }
        }
    }

    #[test]
    fn numbers_are_uniform_and_uncorrelated_between_dimensions() {
        for sequence in [Sequence::Independent, Sequence::Sobol] {
            uncorrelated(Sampler::new(3, sequence, 64, 16));
        }
    }

    fn uncorrelated(sampler: Sampler) {
        let paths: Vec<_> = (0..65536).map(|i| (i / 16, i % 16)).collect();
        let mut sets = vec![Dimensions::film(), Dimensions::lens_and_time()];
        for bounce in 0..3 {
            sets.extend([Dimensions::direction(bounce), Dimensions::choices(bounce)]);
        }
        // Numbers, each with its dimension of the sequence.
        let mut all = Vec::new();
        for set in sets {
            let pairs = [set.first, set.second].map(|pair| [2 * pair, 2 * pair + 1]);
            all.extend(pairs.concat().into_iter().zip(sampler.uniform(&paths, set)));
        }
        // The time is given twice.
        all.remove(7);
        let count = paths.len();
        let mean = |f: &dyn Fn(usize) -> f64| (0..count).map(f).sum::<f64>() / count as f64;
        for (i, (dimension, a)) in all.iter().enumerate() {
            // The standard errors are 0.0011 for the means and 0.0003 for a covariance. The bounds are four of them, and
            // five for the covariances, which are many.
            assert!((mean(&|k| a[k]) - 0.5).abs() < 0.0045, "{i}");
            assert!((mean(&|k| a[k] * a[k]) - 1.0 / 3.0).abs() < 0.005, "{i}");
            assert!(
                mean(&|k| (a[k] - 0.5) * (a[(k + 16) % count] - 0.5)).abs() < 0.0016,
                "{i}"
            );
            assert!(
                a.iter()
                    .all(|&x| (0.0..1.0).contains(&x) && x == f64::from(x as f32))
            );
            for (j, (other, b)) in all[..i].iter().enumerate() {
                // Light of a connection and of the continuation are added up: they share dimensions of the sequence.
                if sampler.sequence == Sequence::Sobol && dimension == other {
                    continue;
                }
                let covariance = mean(&|k| (a[k] - 0.5) * (b[k] - 0.5));
                assert!(covariance.abs() < 0.0016, "{i} and {j}: {covariance}");
            }
        }
    }

    /// Each of n samples of a pixel falls into a different n-th of every dimension. Other seeds, pixels and rounds have
    /// other scrambles.
    #[test]
    fn numbers_of_the_sequence_are_stratified() {
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
        // After 2¹⁶ samples, another scramble follows.
        let paths: Vec<_> = (0..1 << 17).map(|s| (7, s)).collect();
        let sampler = Sampler::new(1, Sequence::Sobol, 8, 1 << 17);
        let [values, ..] = sampler.uniform(&paths, Dimensions::film());
        assert_ne!(values[..1 << 16], values[1 << 16..]);
        // The pixels of a block are stratified together.
        let paths: Vec<_> = (0..64).flat_map(|p| (0..16).map(move |s| (p, s))).collect();
        let sampler = Sampler::new(5, Sequence::Sobol, 8, 16);
        let [_, _, values, _] = sampler.uniform(&paths, Dimensions::direction(0));
        let mut cells: Vec<u32> = values.iter().map(|v| (v * 1024.0) as u32).collect();
        cells.sort_unstable();
        assert!(cells.into_iter().eq(0..1024));
    }
}
