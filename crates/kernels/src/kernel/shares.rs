//! Computes the number of samples for each kind of edge, from the measured variance and cost of some samples.

use std::ops::AddAssign;

use crate::model::jumps::LOW_SAMPLES_LOG;

/// The kinds of edges: in shadows of emitters, in light that matt and glossy points reflect, and on the film.
pub const SHADOWS: usize = 0;
pub const REFLECTED: usize = 1;
pub const IN_GLOSS: usize = 2;
pub const ON_FILM: usize = 3;
pub const KINDS: usize = 4;
/// The number of kinds of edges for which points search.
pub const SEARCHED: usize = 3;

/// The variance of a sum of samples of a kind, divided by the sum of their squares. Samples on the film are spread
/// evenly over all edges there.
const VARIANCE: [f64; KINDS] = [1.0, 1.0, 1.0, 0.1];
/// The cost of a search for an edge, in rays of light beside edges.
pub(super) const SEARCH: f64 = 3.0;
/// The cost of a ray of a path, in the image and in the backward pass, in the same unit.
const PATH: f64 = 0.65;
/// Time for edges divided by time for paths; the second value applies where a pixel has few samples.
const OVER_PATHS: f64 = 2.0;
const OVER_FEW_PATHS: f64 = 1.0;
/// The smallest and the largest number of samples of a kind, divided by the usual number.
const MIN_SHARE: f64 = 0.125;
const MAX_SHARE: f64 = 8.0;
/// The number of steps per factor of two to which shares are rounded, so that rounding errors of sums do not change
/// them.
const STEPS: f64 = 4.0;

/// The result of the samples of a kind: the sum of the squared derivatives with respect to the edges' points, and the
/// cost.
#[derive(Clone, Copy, Debug, Default)]
pub struct Yield {
    pub squares: f64,
    /// In rays of light beside edges.
    pub cost: f64,
}

impl Yield {
    pub fn add(&mut self, squares: f64, cost: f64) {
        self.squares += squares;
        self.cost += cost;
    }
}

/// The cost of paths, and the results of the samples of each kind of edge.
#[derive(Clone, Copy, Debug, Default)]
pub struct Yields {
    /// Rays of paths.
    pub paths: f64,
    pub edges: [Yield; KINDS],
}

impl AddAssign for Yields {
    fn add_assign(&mut self, other: Self) {
        self.paths += other.paths;
        for (own, other) in self.edges.iter_mut().zip(other.edges) {
            own.add(other.squares, other.cost);
        }
    }
}

impl Yields {
    /// Returns the values for `factor` times as many pixels and samples.
    pub fn times(mut self, factor: f64) -> Self {
        self.paths *= factor;
        for of in &mut self.edges {
            of.squares *= factor;
            of.cost *= factor;
        }
        self
    }

    /// Returns the number of samples of each kind of edge, divided by the usual number with which this was measured.
    ///
    /// With m times as many samples, the variance of a sum (here the sum of squares) falls as 1/m and its cost grows as
    /// m. At a given total cost, the variance is least if m is proportional to √(squares / cost).
    pub fn shares(&self, samples_log: u32) -> [f32; KINDS] {
        let edges = &self.edges;
        let weight = |kind: usize| (VARIANCE[kind] * edges[kind].squares * edges[kind].cost).sqrt();
        let sum: f64 = (0..KINDS).map(weight).sum();
        if !(sum > 0.0 && sum.is_finite() && self.paths > 0.0) {
            return [1.0; KINDS];
        }
        let few = samples_log <= LOW_SAMPLES_LOG;
        let over = if few { OVER_FEW_PATHS } else { OVER_PATHS };
        let all = over * PATH * self.paths;
        std::array::from_fn(|kind| {
            let share = all * weight(kind) / (sum * edges[kind].cost);
            let share = if share.is_nan() { 1.0 } else { share };
            let steps = (share.clamp(MIN_SHARE, MAX_SHARE).log2() * STEPS).round();
            (steps / STEPS).exp2() as f32
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MANY: u32 = LOW_SAMPLES_LOG + 1;

    /// Values for which the usual number of samples takes exactly the time for edges.
    fn yields(variances: [f64; KINDS], costs: [f64; KINDS]) -> Yields {
        let edges = std::array::from_fn(|kind| Yield {
            squares: variances[kind] / VARIANCE[kind],
            cost: costs[kind],
        });
        let paths = costs.iter().sum::<f64>() / (OVER_PATHS * PATH);
        Yields { paths, edges }
    }

    /// Time goes to the kinds with the largest variance, and shares stay 1 where all kinds have the same.
    #[test]
    fn samples_go_where_the_variance_is() {
        let even = yields([5.0; KINDS], [30.0; KINDS]).shares(MANY);
        assert_eq!(even, [1.0; KINDS]);
        let few = yields([5.0; KINDS], [30.0; KINDS]).shares(LOW_SAMPLES_LOG);
        assert_eq!(few, [0.5; KINDS]);
        // The variance is Σ a_k / m_k at a cost Σ c_k m_k: moving cost from one kind to another cannot lower it.
        let (a, c) = ([8.0, 2.0, 4.0, 1.0], [10.0, 40.0, 30.0, 20.0]);
        let m = yields(a, c).shares(MANY).map(f64::from);
        let variance = |m: [f64; KINDS]| (0..KINDS).map(|k| a[k] / m[k]).sum::<f64>();
        for (from, to) in (0..KINDS).flat_map(|from| (0..KINDS).map(move |to| (from, to))) {
            if from == to {
                continue;
            }
            let mut other = m;
            // By more than the steps of shares.
            let moved = 0.3 * c[from] * m[from];
            other[from] -= moved / c[from];
            other[to] += moved / c[to];
            assert!(variance(other) > variance(m), "{m:?}, {other:?}");
        }
    }

    #[test]
    fn edges_that_bring_nothing_keep_few_samples() {
        let shares = yields([1.0, 0.0, 0.0, 0.0], [30.0; KINDS]).shares(MANY);
        assert!(shares[SHADOWS] > 2.0, "{shares:?}");
        assert_eq!(shares[REFLECTED], MIN_SHARE as f32);
        assert_eq!(shares[IN_GLOSS], MIN_SHARE as f32);
        assert_eq!(shares[ON_FILM], MIN_SHARE as f32);
        for (squares, cost) in [
            (0.0, 30.0),
            (f64::NAN, 30.0),
            (f64::INFINITY, 1.0),
            (0.0, 0.0),
        ] {
            let shares = yields([squares; KINDS], [cost; KINDS]).shares(MANY);
            assert_eq!(shares, [1.0; KINDS], "{squares}");
        }
    }
}
