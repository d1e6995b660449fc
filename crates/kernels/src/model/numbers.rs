//! Tests on the bits of floats that may be infinite or NaN. Shader compilers may assume that all floats are finite.
//! In shaders `NaN != 0.0` is false, since `!=` is compiled into an ordered comparison.

#![cfg_attr(not(feature = "gpu"), allow(dead_code, reason = "kernels use them"))]

#[cfg(feature = "gpu")]
use crate::cube::*;
use crate::model::choice::INFINITY;

/// Returns the bits of |x|, which are ordered as the numbers are. The bits of NaN are above all others.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn magnitude(x: f32) -> u32 {
    x.to_bits() & 0x7fff_ffff
}

#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn is_finite(x: f32) -> bool {
    magnitude(x) < INFINITY
}

/// Returns whether `x` is not 0; true for NaN.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn is_nonzero(x: f32) -> bool {
    magnitude(x) > 0
}

/// Returns NaN, made from the bits of any number, since WGSL has no NaN constant.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn not_a_number(any: f32) -> f32 {
    f32::from_bits(any.to_bits() | 0x7fc0_0000)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::choice::is_positive;

    #[test]
    fn bits_tell_what_comparisons_tell() {
        let least = f32::from_bits(1);
        let all = [0.0, least, 1.0, 1e38, f32::MAX, f32::INFINITY, f32::NAN];
        for x in all.into_iter().flat_map(|x| [x, -x]) {
            assert_eq!(is_finite(x), x.is_finite(), "{x}");
            assert_eq!(is_nonzero(x), x != 0.0, "{x}");
            assert_eq!(is_positive(x), x > 0.0 && x.is_finite(), "{x}");
            assert!(not_a_number(x).is_nan(), "{x}");
        }
        assert!(all.is_sorted_by_key(|&x| magnitude(-x)));
    }
}
