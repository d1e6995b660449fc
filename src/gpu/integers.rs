//! Integers in kernels: numbers of 64 bits as two words, which few GPUs have.

use crate::cube::*;

pub(super) use crate::model::integers::{product, total};

/// A number of 64 bits.
#[apply(record!)]
#[derive(PartialEq)]
pub(super) struct Wide {
    pub low: u32,
    pub high: u32,
}

/// Of two words.
#[cube]
pub(super) fn wide(low: u32, high: u32) -> Wide {
    Wide { low, high }
}

/// The upper half of a·b, from halves of the words.
#[cube]
fn upper(a: u32, b: u32) -> u32 {
    let a_low = a & 0xffff;
    let a_high = a >> 16;
    let b_low = b & 0xffff;
    let b_high = b >> 16;
    let middle = a_high * b_low + ((a_low * b_low) >> 16);
    let other = a_low * b_high + (middle & 0xffff);
    a_high * b_high + (middle >> 16) + (other >> 16)
}

#[cube]
impl Wide {
    pub fn xor(self, o: Wide) -> Wide {
        wide(self.low ^ o.low, self.high ^ o.high)
    }

    /// Modulo 2⁶⁴.
    fn plus(self, o: Wide) -> Wide {
        let low = total(self.low, o.low);
        let mut carry = 0u32;
        if low < o.low {
            carry = 1u32;
        }
        wide(low, total(total(self.high, o.high), carry))
    }

    /// Modulo 2⁶⁴.
    fn by(self, o: Wide) -> Wide {
        let crossed = total(product(self.low, o.high), product(self.high, o.low));
        wide(
            product(self.low, o.low),
            total(upper(self.low, o.low), crossed),
        )
    }

    /// Shifted right by less than 32.
    pub fn shifted(self, by: u32) -> Wide {
        let mut low = self.low;
        if by > 0 {
            low = (self.low >> by) | (self.high << (32 - by));
        }
        wide(low, self.high >> by)
    }
}

/// `sampling::mix`: the finaliser of SplitMix64 (Steele et al. 2014), applied after an odd offset.
#[cube]
pub(super) fn mix(x: Wide) -> Wide {
    let a = x.plus(wide(0x7f4a_7c15u32, 0x9e37_79b9u32));
    let b = a
        .xor(a.shifted(30u32))
        .by(wide(0x1ce4_e5b9u32, 0xbf58_476du32));
    let c = b
        .xor(b.shifted(27u32))
        .by(wide(0x1331_11ebu32, 0x94d0_49bbu32));
    c.xor(c.shifted(31u32))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mixes_as_sampling_does() {
        let mut x = 1u64;
        for _ in 0..1000 {
            let wanted = crate::sampling::mix(x);
            let found = mix(wide(x as u32, (x >> 32) as u32));
            assert_eq!(found, wide(wanted as u32, (wanted >> 32) as u32));
            x = wanted;
        }
    }
}
