//! How many samples each kind of edge is given, by how much some of them vary and cost.

use std::ops::AddAssign;

use crate::model::jumps::FEW_SAMPLES;

/// Kinds of edges: of shadows of emitters, of reflected light, and on the film.
pub(crate) const SHADOWS: usize = 0;
pub(crate) const REFLECTED: usize = 1;
pub(crate) const ON_FILM: usize = 2;
const KINDS: usize = 3;

/// The variance of a sum of samples of a kind over the sum of their squares. Samples on the film are spread evenly over all
/// edges there.
const VARIANCE: [f64; KINDS] = [1.0, 1.0, 0.1];
/// What a search for an edge of each kind costs, in rays of light beside edges.
const SEARCH: [f64; KINDS] = [3.0, 3.0, 0.0];
/// What a ray of a path costs in the image and on the way back, in the same unit.
const PATH: f64 = 0.65;
/// Time for edges over that for paths, and where a pixel has few samples.
const OVER_PATHS: f64 = 2.0;
const OVER_FEW_PATHS: f64 = 1.0;
/// The fewest and the most samples of a kind, over the usual number.
const FEWEST: f64 = 0.125;
const MOST: f64 = 8.0;
/// Steps between numbers of samples, for each factor of two, so that rounding of sums does not change them.
const STEPS: f64 = 4.0;

/// Of samples of edges of a kind: the sum of squares of the derivatives by these edges' points, and the cost.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Yield {
    pub squares: f64,
    pub rays: f64,
    pub searches: f64,
}

impl Yield {
    /// Adds squares of derivatives, and rays.
    pub fn add(&mut self, squares: f64, rays: f64) {
        self.squares += squares;
        self.rays += rays;
    }
}

/// The cost of paths, and what samples of edges of each kind brought.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Yields {
    /// Rays of paths.
    pub paths: f64,
    pub edges: [Yield; KINDS],
}

impl AddAssign for Yields {
    fn add_assign(&mut self, other: Self) {
        self.paths += other.paths;
        for (own, other) in self.edges.iter_mut().zip(other.edges) {
            own.squares += other.squares;
            own.rays += other.rays;
            own.searches += other.searches;
        }
    }
}

impl Yields {
    /// Of so many times as many pixels and samples.
    pub fn times(mut self, factor: f64) -> Self {
        self.paths *= factor;
        for of in &mut self.edges {
            of.squares *= factor;
            of.rays *= factor;
            of.searches *= factor;
        }
        self
    }

    /// The number of samples of each kind of edge over the usual one, with which this was measured.
    ///
    /// With m times as many samples a sum's variance, here the sum of squares, falls as 1/m and its cost grows as m. At a
    /// given total cost the variance is least if m is proportional to √(squares / cost).
    pub fn shares(&self, samples_log: u32) -> [f32; KINDS] {
        let edges = &self.edges;
        let cost = |kind: usize| edges[kind].rays + SEARCH[kind] * edges[kind].searches;
        let weight = |kind: usize| (VARIANCE[kind] * edges[kind].squares * cost(kind)).sqrt();
        let sum: f64 = (0..KINDS).map(weight).sum();
        if !(sum > 0.0 && sum.is_finite()) {
            return [1.0; KINDS];
        }
        let few = samples_log <= FEW_SAMPLES;
        let over = if few { OVER_FEW_PATHS } else { OVER_PATHS };
        let all = over * PATH * self.paths;
        std::array::from_fn(|kind| {
            let share = all * weight(kind) / (sum * cost(kind));
            let share = if share.is_nan() { 1.0 } else { share };
            let steps = (share.clamp(FEWEST, MOST).log2() * STEPS).round();
            (steps / STEPS).exp2() as f32
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MANY: u32 = FEW_SAMPLES + 1;

    /// With as much time for edges as for paths.
    fn yields(variances: [f64; KINDS], rays: [f64; KINDS]) -> Yields {
        let edges = std::array::from_fn(|kind| Yield {
            squares: variances[kind] / VARIANCE[kind],
            rays: rays[kind],
            searches: 0.0,
        });
        let paths = rays.iter().sum::<f64>() / (OVER_PATHS * PATH);
        Yields { paths, edges }
    }

    /// The time that there is goes to what makes the noise, and nothing changes where all bring as much.
    #[test]
    fn samples_go_where_the_variance_is() {
        let even = yields([5.0; KINDS], [30.0; KINDS]).shares(MANY);
        assert_eq!(even, [1.0; KINDS]);
        let few = yields([5.0; KINDS], [30.0; KINDS]).shares(FEW_SAMPLES);
        assert_eq!(few, [0.5; KINDS]);
        // Variance a_k / m_k at a cost Σ c_k m_k: no shift of cost from a kind to another lowers the sum.
        let (a, c) = ([8.0, 2.0, 1.0], [10.0, 40.0, 20.0]);
        let m = yields(a, c).shares(MANY).map(f64::from);
        let variance = |m: [f64; KINDS]| (0..KINDS).map(|k| a[k] / m[k]).sum::<f64>();
        for (from, to) in [(0, 1), (1, 0), (0, 2), (2, 0), (1, 2), (2, 1)] {
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
        let shares = yields([1.0, 0.0, 0.0], [30.0, 30.0, 30.0]).shares(MANY);
        assert!(shares[SHADOWS] > 2.0, "{shares:?}");
        assert_eq!(shares[REFLECTED], FEWEST as f32);
        assert_eq!(shares[ON_FILM], FEWEST as f32);
        for (squares, rays) in [
            (0.0, 30.0),
            (f64::NAN, 30.0),
            (f64::INFINITY, 1.0),
            (0.0, 0.0),
        ] {
            let shares = yields([squares; KINDS], [rays; KINDS]).shares(MANY);
            assert_eq!(shares, [1.0; KINDS], "{squares}");
        }
    }
}
