//! Mini-batches of views and of tiles, from a seed.

use super::camera::Window;
use crate::error::{Error, Result};

/// The order in which views are taken, in mini-batches. It depends on the seed and the step alone, so a fit that
/// continues from a checkpoint takes the same ones.
///
/// Views are taken in rounds: in each of them, every view once, in an order of its own.
///
/// ```
/// use softray::photographs::Batches;
/// let batches = Batches::new(&[3, 5, 8], 2, 7)?;
/// let mut first: Vec<usize> = (0..3).flat_map(|step| batches.views(step)).collect();
/// first.sort();
/// assert_eq!(first, [3, 3, 5, 5, 8, 8]);
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Batches {
    views: Vec<usize>,
    count: usize,
    seed: u64,
}

impl Batches {
    /// Mini-batches of `count` of the views with these indices.
    ///
    /// # Errors
    /// If there are no views, or `count` is 0.
    pub fn new(views: &[usize], count: usize, seed: u64) -> Result<Self> {
        Error::unless(
            !views.is_empty(),
            "batches",
            "views",
            "empty",
            "at least one view",
        )?;
        Error::unless(count > 0, "batches", "count", count, "at least 1")?;
        Ok(Self {
            views: views.into(),
            count,
            seed,
        })
    }

    /// Returns the views of a step, from 0.
    pub fn views(&self, step: usize) -> Vec<usize> {
        let places = step * self.count..(step + 1) * self.count;
        let mut round = usize::MAX;
        let mut order = Vec::new();
        let view = |place: usize| {
            let n = self.views.len();
            if place / n != round {
                round = place / n;
                order = self.order(round);
            }
            order[place % n]
        };
        places.map(view).collect()
    }

    /// Returns the views of a round in its order, a random permutation (Fisher and Yates).
    fn order(&self, round: usize) -> Vec<usize> {
        let mut random = Random::of(self.seed, [0, round as u64]);
        let mut order = self.views.clone();
        for i in (1..order.len()).rev() {
            order.swap(i, random.below(i + 1));
        }
        order
    }

    /// Returns the views of a step, each with a tile of at most `tile` columns and rows. `size` returns the columns and
    /// rows of a view's image. All places at which the tile lies in the image are equally likely, so pixels nearer to
    /// the border than the tile's size are taken less often.
    pub fn tiles(
        &self,
        step: usize,
        tile: [usize; 2],
        size: impl Fn(usize) -> [usize; 2],
    ) -> Vec<(usize, Window)> {
        let mut random = Random::of(self.seed, [1, step as u64]);
        let tile_of = |view: usize| {
            let whole = size(view);
            let size = [0, 1].map(|i| tile[i].clamp(1, whole[i].max(1)));
            let start = [0, 1].map(|i| random.below(whole[i].max(1) - size[i] + 1));
            (view, Window { start, size })
        };
        self.views(step).into_iter().map(tile_of).collect()
    }
}

/// Random numbers by SplitMix64 (Steele, Lea and Flood, Fast splittable pseudorandom number generators, 2014).
struct Random(u64);

impl Random {
    /// The numbers of a seed and of a purpose.
    fn of(seed: u64, purpose: [u64; 2]) -> Self {
        let mix = |state: u64, word: u64| Self(state ^ word).next();
        Self(purpose.into_iter().fold(mix(0, seed), mix))
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Returns a number in 0..n.
    fn below(&mut self, n: usize) -> usize {
        ((u128::from(self.next()) * n as u128) >> 64) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_round_takes_every_view_once() {
        let views: Vec<usize> = (10..17).collect();
        let batches = Batches::new(&views, 3, 5).expect("batches");
        let all: Vec<usize> = (0..7).flat_map(|step| batches.views(step)).collect();
        for round in all.chunks(7) {
            let mut sorted = round.to_vec();
            sorted.sort();
            assert_eq!(sorted, views);
        }
        assert_ne!(all[..7], all[7..14]);
        let other = Batches::new(&views, 3, 6).expect("batches");
        assert!((0..7).any(|step| other.views(step) != batches.views(step)));
    }

    #[test]
    fn tiles_lie_in_the_image() {
        let batches = Batches::new(&[0, 1], 2, 1).expect("batches");
        let mut starts = std::collections::BTreeSet::new();
        for step in 0..100 {
            for (_, window) in batches.tiles(step, [4, 9], |_| [7, 5]) {
                assert_eq!(window.size, [4, 5]);
                window.check([7, 5]).expect("pixels of the image");
                starts.insert(window.start);
            }
        }
        assert_eq!(starts.len(), 4);
    }
}
