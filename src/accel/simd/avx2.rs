//! Eight numbers in a register of AVX2.

use super::machine::{Lanes, Machine};

impl Machine for pulp::x86::V3 {
    const FUSED: bool = true;

    type Floats = std::arch::x86_64::__m256;
    type Mask = std::arch::x86_64::__m256;

    #[inline(always)]
    fn not_negative(self, lanes: &Lanes) -> u32 {
        use std::arch::x86_64::_CMP_NLT_UQ;
        let zero = self.avx._mm256_setzero_ps();
        let lanes = pulp::cast(*lanes);
        let mask = self.avx._mm256_cmp_ps::<_CMP_NLT_UQ>(lanes, zero);
        self.avx._mm256_movemask_ps(mask) as u32
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
    fn add(self, a: Self::Floats, b: Self::Floats) -> Self::Floats {
        self.avx._mm256_add_ps(a, b)
    }

    #[inline(always)]
    fn sub(self, a: Self::Floats, b: Self::Floats) -> Self::Floats {
        self.avx._mm256_sub_ps(a, b)
    }

    #[inline(always)]
    fn mul(self, a: Self::Floats, b: Self::Floats) -> Self::Floats {
        self.avx._mm256_mul_ps(a, b)
    }

    #[inline(always)]
    fn div(self, a: Self::Floats, b: Self::Floats) -> Self::Floats {
        self.avx._mm256_div_ps(a, b)
    }

    #[inline(always)]
    fn mul_add(self, a: Self::Floats, b: Self::Floats, c: Self::Floats) -> Self::Floats {
        self.fma._mm256_fmadd_ps(a, b, c)
    }

    #[inline(always)]
    fn min(self, a: Self::Floats, b: Self::Floats) -> Self::Floats {
        self.avx._mm256_min_ps(a, b)
    }

    #[inline(always)]
    fn max(self, a: Self::Floats, b: Self::Floats) -> Self::Floats {
        self.avx._mm256_max_ps(a, b)
    }

    #[inline(always)]
    fn sqrt(self, a: Self::Floats) -> Self::Floats {
        self.avx._mm256_sqrt_ps(a)
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
    fn and(self, a: Self::Mask, b: Self::Mask) -> Self::Mask {
        self.avx._mm256_and_ps(a, b)
    }

    #[inline(always)]
    fn or(self, a: Self::Mask, b: Self::Mask) -> Self::Mask {
        self.avx._mm256_or_ps(a, b)
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
