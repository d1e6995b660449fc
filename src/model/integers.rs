//! Whole numbers of 32 bits that wrap, in Rust and in kernels of GPUs, and a hash of them.

#[cfg(feature = "wgpu")]
use crate::cube::*;

/// a·b modulo 2³².
#[inline(always)]
pub(crate) fn product(a: u32, b: u32) -> u32 {
    a.wrapping_mul(b)
}

/// In a kernel.
#[cfg(feature = "wgpu")]
pub(crate) mod product {
    use super::*;

    pub(crate) fn expand(
        scope: &Scope,
        a: NativeExpand<u32>,
        b: NativeExpand<u32>,
    ) -> NativeExpand<u32> {
        a.__expand_mul_method(scope, b)
    }
}

/// a + b modulo 2³².
#[cfg(feature = "wgpu")]
#[inline(always)]
pub(crate) fn total(a: u32, b: u32) -> u32 {
    a.wrapping_add(b)
}

/// In a kernel.
#[cfg(feature = "wgpu")]
pub(crate) mod total {
    use super::*;

    pub(crate) fn expand(
        scope: &Scope,
        a: NativeExpand<u32>,
        b: NativeExpand<u32>,
    ) -> NativeExpand<u32> {
        a.__expand_add_method(scope, b)
    }
}

/// A permutation of the numbers of 32 bits of which each bit depends on all others (lowbias32, Wellons 2018).
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn hashed(x: u32) -> u32 {
    let a = product(x ^ (x >> 16), 0x7feb_352du32);
    let b = product(a ^ (a >> 15), 0x846c_a68bu32);
    b ^ (b >> 16)
}
