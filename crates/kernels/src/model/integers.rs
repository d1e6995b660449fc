//! Wrapping integer arithmetic and hashes, on the host and in GPU kernels. 64-bit integers are two 32-bit words,
//! since few GPUs support wider ones.

use crate::cube::*;

/// Defines an operation on words for the host and for kernels.
macro_rules! operation {
    ($name:ident, $on_host:expr, $in_kernel:ident) => {
        #[inline(always)]
        pub fn $name(a: u32, b: u32) -> u32 {
            $on_host(a, b)
        }

        #[cfg(feature = "gpu")]
        pub mod $name {
            use super::*;

            type Word = NativeExpand<u32>;

            pub fn expand(scope: &Scope, a: Word, b: Word) -> Word {
                a.$in_kernel(scope, b)
            }
        }
    };
}
// The product and the sum modulo 2³², and the upper word of the product.
operation!(product, u32::wrapping_mul, __expand_mul_method);
operation!(total, u32::wrapping_add, __expand_add_method);
#[cfg(feature = "gpu")]
operation!(
    upper,
    |a, b| ((u64::from(a) * u64::from(b)) >> 32) as u32,
    __expand_mul_hi_method
);

/// Hashes 32 bits by a permutation in which each output bit depends on all input bits (lowbias32, Wellons 2018).
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn hashed(x: u32) -> u32 {
    let a = product(x ^ (x >> 16), 0x7feb_352du32);
    let b = product(a ^ (a >> 15), 0x846c_a68bu32);
    b ^ (b >> 16)
}

/// A 64-bit integer as two words.
#[apply(record!)]
#[derive(PartialEq)]
pub struct Wide {
    pub low: u32,
    pub high: u32,
}

/// Makes a [`Wide`] from two words.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn wide(low: u32, high: u32) -> Wide {
    Wide { low, high }
}

impl From<u64> for Wide {
    #[inline(always)]
    fn from(x: u64) -> Self {
        wide(x as u32, (x >> 32) as u32)
    }
}

impl From<Wide> for u64 {
    #[inline(always)]
    fn from(x: Wide) -> Self {
        u64::from(x.high) << 32 | u64::from(x.low)
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Wide {
    #[inline(always)]
    pub fn xor(self, o: Wide) -> Wide {
        wide(self.low ^ o.low, self.high ^ o.high)
    }

    /// Returns the number shifted right by less than 32 bits.
    #[inline(always)]
    pub fn shifted(self, by: u32) -> Wide {
        let mut low = self.low;
        if by > 0 {
            low = (self.low >> by) | (self.high << (32 - by));
        }
        wide(low, self.high >> by)
    }
}

/// The finalizer of SplitMix64 (Steele et al. 2014), applied after adding an odd offset.
#[inline(always)]
pub fn mix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// [`mix`] of a number of two words.
#[inline(always)]
pub fn mixed(x: Wide) -> Wide {
    mix(x.into()).into()
}

/// The same in a kernel, in 32-bit words.
#[cfg(feature = "gpu")]
pub mod mixed {
    use super::*;

    pub fn expand(scope: &Scope, x: WideExpand) -> WideExpand {
        mixed_words::expand(scope, x)
    }

    #[cube]
    pub(super) fn mixed_words(x: Wide) -> Wide {
        let a = plus(x, wide(0x7f4a_7c15u32, 0x9e37_79b9u32));
        let b = times(
            a.xor(a.shifted(30u32)),
            wide(0x1ce4_e5b9u32, 0xbf58_476du32),
        );
        let c = times(
            b.xor(b.shifted(27u32)),
            wide(0x1331_11ebu32, 0x94d0_49bbu32),
        );
        c.xor(c.shifted(31u32))
    }

    /// a + b modulo 2⁶⁴.
    #[cube]
    fn plus(a: Wide, b: Wide) -> Wide {
        let low = total(a.low, b.low);
        let carry = select(low < b.low, 1u32, 0u32);
        wide(low, total(total(a.high, b.high), carry))
    }

    /// a·b modulo 2⁶⁴.
    #[cube]
    fn times(a: Wide, b: Wide) -> Wide {
        let crossed = total(product(a.low, b.high), product(a.high, b.low));
        wide(product(a.low, b.low), total(upper(a.low, b.low), crossed))
    }
}

/// Interleaves the bits of x and y: the Morton code, which is the position of a point on a Z-order curve.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn morton(x: u32, y: u32) -> Wide {
    wide(
        spread(x & 0xffff) | (spread(y & 0xffff) << 1),
        spread(x >> 16) | (spread(y >> 16) << 1),
    )
}

/// Inserts a zero before each bit of a number below 2¹⁶.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn spread(v: u32) -> u32 {
    let a = (v | (v << 8)) & 0x00ff_00ff;
    let b = (a | (a << 4)) & 0x0f0f_0f0f;
    let c = (b | (b << 2)) & 0x3333_3333;
    (c | (c << 1)) & 0x5555_5555
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_of_two_numbers_in_turn() {
        let (x, y) = (0x8123_4567u32, 0xfedc_ba98u32);
        let place = u64::from(morton(x, y));
        for i in 0..32 {
            assert_eq!(place >> (2 * i) & 1, u64::from(x >> i & 1));
            assert_eq!(place >> (2 * i + 1) & 1, u64::from(y >> i & 1));
        }
    }

    #[cfg(feature = "gpu")]
    #[test]
    fn words_mix_as_numbers_do() {
        let mut x = 1u64;
        for _ in 0..1000 {
            let wanted = mix(x);
            assert_eq!(mixed::mixed_words(x.into()), Wide::from(wanted));
            x = wanted;
        }
    }
}
