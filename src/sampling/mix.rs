//! Hashes of integers.

/// The finaliser of SplitMix64 (Steele et al. 2014), applied after an odd offset.
pub(crate) fn mix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// A uniform number of a path.
pub(super) fn number(stage: u64, (pixel, sample): (u32, u32)) -> f64 {
    let h = mix(stage ^ ((u64::from(pixel) << 32) | u64::from(sample)));
    (h >> 40) as f64 / (1u64 << 24) as f64
}

/// The bits of x and y in turn.
pub(super) fn morton(x: u32, y: u32) -> u64 {
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
