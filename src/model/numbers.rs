//! Numbers that may not be finite, by their bits. Compilers of shaders may assume that there are none; and NaN is not
//! unequal to 0 there, since `!=` is compiled into an ordered comparison.

#![cfg_attr(not(feature = "wgpu"), allow(dead_code, reason = "kernels use them"))]

#[cfg(feature = "wgpu")]
use crate::cube::*;
use crate::model::choice::INFINITY;

/// The bits of |x|, which have the order of the numbers; those of NaN are above all others.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn magnitude(x: f32) -> u32 {
    x.to_bits() & 0x7fff_ffff
}

#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn is_finite(x: f32) -> bool {
    magnitude(x) < INFINITY
}

/// Whether it is not 0; true of NaN.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn is_nonzero(x: f32) -> bool {
    magnitude(x) > 0
}

/// NaN, from the bits of any number: WGSL has no constant that is NaN.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn not_a_number(any: f32) -> f32 {
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
