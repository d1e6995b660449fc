//! Counter-based random numbers: item 17 of a seed is the same in every data set.

/// A stream of random numbers. The n-th number is a hash of the key and n.
pub struct Numbers {
    key: u64,
    count: u64,
}

/// The finalizer of SplitMix64 (Steele et al. 2014), applied after an odd offset.
pub fn mix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

impl Numbers {
    pub fn new(seed: u64, stream: u64) -> Self {
        Self {
            key: mix(mix(seed) ^ stream),
            count: 0,
        }
    }

    fn bits(&mut self) -> u64 {
        self.count += 1;
        mix(self.key ^ mix(self.count))
    }

    /// Returns a uniform number in [low, high).
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        let unit = (self.bits() >> 11) as f64 / (1_u64 << 53) as f64;
        low + unit * (high - low)
    }

    /// Returns a uniform index in 0..count.
    pub fn index(&mut self, count: usize) -> usize {
        (self.uniform(0.0, count as f64) as usize).min(count.saturating_sub(1))
    }

    /// Returns a vector with uniform components in [low, high).
    pub fn vector<const N: usize>(&mut self, low: f64, high: f64) -> [f64; N] {
        std::array::from_fn(|_| self.uniform(low, high))
    }
}
