//! Eight numbers in an AVX2 register.

use super::float8::{LANES, Lanes, Machine};

/// Operations that are one instruction on registers.
macro_rules! instructions {
    ($($name:ident($($a:ident),*) = $unit:ident.$instruction:ident;)*) => {
        $(
            #[inline(always)]
            fn $name(self, $($a: Self::Floats),*) -> Self::Floats {
                self.$unit.$instruction($($a),*)
            }
        )*
    };
}

impl Machine for pulp::x86::V3 {
    type Floats = std::arch::x86_64::__m256;
    type Mask = std::arch::x86_64::__m256;

    instructions! {
        add(a, b) = avx._mm256_add_ps;
        sub(a, b) = avx._mm256_sub_ps;
        mul(a, b) = avx._mm256_mul_ps;
        div(a, b) = avx._mm256_div_ps;
        mul_add(a, b, c) = fma._mm256_fmadd_ps;
        min(a, b) = avx._mm256_min_ps;
        max(a, b) = avx._mm256_max_ps;
        and(a, b) = avx._mm256_and_ps;
        or(a, b) = avx._mm256_or_ps;
    }

    #[inline(always)]
    fn load(self, lanes: &Lanes) -> Self::Floats {
        pulp::cast(*lanes)
    }

    #[inline(always)]
    fn store(self, a: Self::Floats) -> Lanes {
        pulp::cast(a)
    }

    #[inline(always)]
    fn splat(self, x: f32) -> Self::Floats {
        self.avx._mm256_set1_ps(x)
    }

    #[inline(always)]
    fn abs(self, a: Self::Floats) -> Self::Floats {
        self.avx._mm256_andnot_ps(self.avx._mm256_set1_ps(-0.0), a)
    }

    #[inline(always)]
    fn less(self, a: Self::Floats, b: Self::Floats) -> Self::Mask {
        use std::arch::x86_64::_CMP_LT_OQ;
        self.avx._mm256_cmp_ps::<_CMP_LT_OQ>(a, b)
    }

    #[inline(always)]
    fn not(self, a: Self::Mask) -> Self::Mask {
        let all = self.avx._mm256_castsi256_ps(self.avx._mm256_set1_epi32(-1));
        self.avx._mm256_xor_ps(a, all)
    }

    #[inline(always)]
    fn select(self, mask: Self::Mask, a: Self::Floats, b: Self::Floats) -> Self::Floats {
        self.avx._mm256_blendv_ps(b, a, mask)
    }

    #[inline(always)]
    fn mask_bits(self, mask: Self::Mask) -> u32 {
        self.avx._mm256_movemask_ps(mask) as u32
    }

    #[inline(always)]
    fn transpose(self, rows: &[Lanes; LANES]) -> [Self::Floats; LANES] {
        let avx = self.avx;
        // Pairs of rows, then fours of rows in each half, then halves.
        let pair = |k: usize| {
            let (a, b) = (self.load(&rows[k]), self.load(&rows[k + 1]));
            [avx._mm256_unpacklo_ps(a, b), avx._mm256_unpackhi_ps(a, b)]
        };
        let four = |k: usize| {
            let ([a, b], [c, d]) = (pair(k), pair(k + 2));
            [
                avx._mm256_shuffle_ps::<0b01_00_01_00>(a, c),
                avx._mm256_shuffle_ps::<0b11_10_11_10>(a, c),
                avx._mm256_shuffle_ps::<0b01_00_01_00>(b, d),
                avx._mm256_shuffle_ps::<0b11_10_11_10>(b, d),
            ]
        };
        let (first, last) = (four(0), four(4));
        let low = |k: usize| avx._mm256_permute2f128_ps::<0x20>(first[k], last[k]);
        let high = |k: usize| avx._mm256_permute2f128_ps::<0x31>(first[k], last[k]);
        [
            low(0),
            low(1),
            low(2),
            low(3),
            high(0),
            high(1),
            high(2),
            high(3),
        ]
    }

    #[inline(always)]
    fn least(self, a: Self::Floats) -> f32 {
        let a = self.sse._mm_min_ps(
            self.avx._mm256_castps256_ps128(a),
            self.avx._mm256_extractf128_ps::<1>(a),
        );
        let a = self.sse._mm_min_ps(a, self.sse._mm_movehl_ps(a, a));
        let a = self.sse._mm_min_ps(a, self.sse._mm_shuffle_ps::<1>(a, a));
        self.sse._mm_cvtss_f32(a)
    }
}
