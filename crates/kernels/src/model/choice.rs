//! Many decisions from one random number.

use super::V3;
use super::integers::{hashed, product};
use crate::cube::*;

/// A uniform number in [0, 1) for several decisions: its remainder after a decision is uniform again.
///
/// Each decision consumes bits of the number. While many bits are left, later decisions are as evenly spread as the
/// number was. Once less than [`MIN_RANGE`] of its range is left, a hash replaces the number. So the bits never run
/// out, and a rounding error of a probability grows by at most 1 / [`MIN_RANGE`].
#[apply(record!)]
pub struct Uniform {
    pub number: f32,
    /// The fraction of the number's range that is left after earlier decisions.
    left: f32,
    /// State of the hash.
    key: u32,
}

/// A decision, and the number for the next decision.
#[apply(record!)]
pub struct Decision {
    pub happens: bool,
    pub rest: Uniform,
}

/// The fraction of a number's range below which a hash replaces the number.
const MIN_RANGE: f32 = 1.0 / 256.0;
/// The largest number of those in [0, 1).
pub const MAX_UNIFORM: f32 = 1.0 - f32::EPSILON;
/// The bits of infinity.
pub const INFINITY: u32 = 0x7f80_0000;

/// Returns whether a sum of weights is above 0 and finite. It tests the bits, since shader compilers may assume that
/// all floats are finite.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn is_positive(x: f32) -> bool {
    let bits = x.to_bits();
    bits > 0 && bits < INFINITY
}

/// Makes the number u. `other`, an independent number, distinguishes the hashes of samples with the same u.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn decided_by(u: f32, other: f32) -> Uniform {
    Uniform {
        number: u,
        left: 1.0,
        key: product(u.to_bits(), 0x9e37_79b9u32) ^ other.to_bits(),
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Uniform {
    /// Decides whether an event with probability `chance` happens.
    #[inline(always)]
    pub fn decide(self, chance: f32) -> Decision {
        let happens = self.number < chance;
        let from = select(happens, 0.0, chance);
        let share = select(happens, chance, 1.0 - chance);
        Decision {
            happens,
            rest: self.within(from, share),
        }
    }

    /// Returns the remainder of the number, given that it lies in a part of its range.
    #[inline(always)]
    pub fn within(self, from: f32, share: f32) -> Self {
        let mut number = min((self.number - from) / max(share, 1e-30), MAX_UNIFORM);
        let mut left = self.left * share;
        let mut key = self.key;
        // A branch, since decisions follow each other and few take it.
        if left < MIN_RANGE {
            key = hashed(key);
            number = (key >> 8) as f32 * (1.0f32 / 16_777_216.0f32);
            left = 1.0f32;
        }
        Uniform { number, left, key }
    }
}

/// Returns the survival probability of a path for its throughput (Russian roulette).
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn survival(throughput: V3) -> f32 {
    min(max(throughput.max_element(), 0.05), 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each of 250 items is drawn as often as its probability requires, though a 24-bit number has too few bits for
    /// so many decisions.
    #[test]
    fn many_decisions_by_one_number() {
        let weights: Vec<f32> = (0..250).map(|i| 1.0 + (i % 7) as f32).collect();
        let total: f32 = weights.iter().sum();
        let (n, mut drawn) = (1 << 15, vec![0u32; weights.len()]);
        for i in 0..n {
            let u = (i as f32 + 0.5) / n as f32;
            let mut random = decided_by(u, (i as f32 * 0.618_034).fract());
            let (mut sum, mut taken) = (0.0, 0);
            for (k, w) in weights.iter().enumerate() {
                sum += w;
                let decision = random.decide(w / sum);
                random = decision.rest;
                assert!((0.0..1.0).contains(&random.number));
                if decision.happens {
                    taken = k;
                }
            }
            drawn[taken] += 1;
        }
        // Pearson's statistic has mean 249 and standard deviation 22.
        let pairs = drawn.iter().zip(&weights);
        let square = |(&d, w): (&u32, &f32)| {
            let wanted = f64::from(w / total) * f64::from(n);
            (f64::from(d) - wanted).powi(2) / wanted
        };
        let statistic: f64 = pairs.map(square).sum();
        assert!(statistic < 249.0 + 4.0 * 22.0, "{statistic}");
    }

    /// The first decisions are as evenly spread as the numbers.
    #[test]
    fn first_decisions_are_stratified() {
        let mut drawn = [0; 16];
        for i in 0..64 {
            let mut random = decided_by((i as f32 + 0.5) / 64.0, 0.3);
            let mut which = 0;
            for _ in 0..4 {
                let decision = random.decide(0.5);
                random = decision.rest;
                which = 2 * which + usize::from(decision.happens);
            }
            drawn[which] += 1;
        }
        assert_eq!(drawn, [4; 16]);
    }
}
