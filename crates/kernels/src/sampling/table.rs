//! The points of a low-discrepancy sequence of 16 dimensions: Faure's sequence over the field of 16 elements, which
//! contains the sequences over the fields of 4 and 2 (Ahmed, Skopenkov, Hadwiger and Wonka 2023).
//!
//! Each box below contains one point of a run whose start is a multiple of its length:
//! - 16ᵏ points, any dimensions: boxes of volume 16⁻ᵏ whose sides are powers of 1/16;
//! - 4ᵏ points, four dimensions (4 q and after): boxes of volume 4⁻ᵏ whose sides are powers of ¼;
//! - 2ᵏ points, two dimensions (2 p and after): boxes of volume 2⁻ᵏ.
//!
//! A digit of four bits is an element of the field. All operations on digits are linear in their bits.

use std::sync::OnceLock;

/// The number of pairs of dimensions, and the words of each pair in the table.
pub(super) const PAIRS: u32 = 8;
pub(super) const OF_PAIR: usize = 64;

/// The number of digits of an index. A digit has four bits.
const DIGITS: u32 = 4;

/// Linear maps of digits, by which the boxes of the smaller fields have one point each too. Each row gives one bit of
/// the product. `IN_PAIR` makes two dimensions of one, `IN_FOUR` makes four of two. `OF_FOUR` has a map for each four
/// dimensions. It leaves the properties of these unchanged, and distributes fewer than 256 points well in other pairs.
const IN_PAIR: [u8; 4] = [15, 10, 12, 8];
const IN_FOUR: [u8; 4] = [13, 6, 4, 8];
const OF_FOUR: [[u8; 4]; 4] = [[1, 2, 4, 8], [5, 10, 4, 8], [9, 14, 4, 8], [13, 6, 4, 8]];

/// Returns the product of two elements of the field of four: 0, 1, w and w + 1.
fn product_of_four(a: u8, b: u8) -> u8 {
    let carried = (if b & 1 != 0 { a } else { 0 }) ^ (if b & 2 != 0 { a << 1 } else { 0 });
    // w² = w + 1.
    if carried & 4 != 0 {
        carried ^ 7
    } else {
        carried
    }
}

/// Returns the product of two elements a + b y of the field of 16, where y² = y + w.
fn product(a: u8, b: u8) -> u8 {
    let high = product_of_four(a >> 2, b >> 2);
    let cross = product_of_four(a & 3, b >> 2) ^ product_of_four(a >> 2, b & 3);
    let low = product_of_four(a & 3, b & 3) ^ product_of_four(high, 2);
    low | ((cross ^ high) << 2)
}

/// Applies a linear map to a digit: each bit of the result is the parity of the bits that a row selects.
fn mixed(rows: [u8; 4], digit: u8) -> u8 {
    let bit = |r: usize| u8::from((rows[r] & digit).count_ones() & 1 == 1) << r;
    bit(0) | bit(1) | bit(2) | bit(3)
}

/// Returns the contribution of a digit of the index to a coordinate with reversed bits: the lowest bit halves the
/// range.
fn coordinate(dimension: u8, place: u32, digit: u8) -> u32 {
    let of_digit = |i: u32| {
        // Digit i of the coordinate is the i-th derivative, at the dimension's element, of the polynomial whose
        // coefficients are the index digits. Binomial coefficients are 1 where the bits of i are a subset of the bits
        // of `place`, otherwise 0.
        if i > place || i & !place != 0 {
            return 0;
        }
        let power = (i..place).fold(digit, |p, _| product(p, dimension));
        let mut found = mixed(OF_FOUR[usize::from(dimension >> 2)], power);
        if dimension & 2 != 0 {
            found = mixed(IN_FOUR, found);
        }
        if dimension & 1 != 0 {
            found = mixed(IN_PAIR, found);
        }
        u32::from(found) << (4 * i)
    };
    (0..DIGITS).fold(0, |sum, i| sum | of_digit(i))
}

/// Returns the table of points, for each pair of dimensions and each four bits of the reversed index: two coordinates
/// with 16 reversed bits each, the first in the lower half. A point is the XOR of the entries for the four parts of its
/// index.
pub fn points() -> &'static [u32] {
    static POINTS: OnceLock<Vec<u32>> = OnceLock::new();
    POINTS.get_or_init(|| {
        let of = |i: u32| {
            let (pair, place, bits) = (i >> 6, (i >> 4) & 3, i & 15);
            let digit = (bits as u8).reverse_bits() >> 4;
            let [x, y] = [0, 1].map(|d| coordinate((2 * pair + d) as u8, place, digit));
            x | y << 16
        };
        (0..PAIRS * OF_PAIR as u32).map(of).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(dimension: u8, index: u32) -> u32 {
        let digits = 0..DIGITS;
        let of = digits.map(|j| coordinate(dimension, j, (index >> (4 * j)) as u8 & 15));
        of.fold(0, |sum, part| sum ^ part).reverse_bits()
    }

    /// Returns whether each box contains one point, for as many points as boxes. `sides` lists dimensions, each with
    /// log₂ of the number of boxes along it.
    fn is_even(sides: &[(u8, u32)]) -> bool {
        let bits: u32 = sides.iter().map(|s| s.1).sum();
        let cell = |index: u32| {
            sides.iter().fold(0, |cell, &(d, side)| {
                let along = u64::from(place(d, index)) >> (32 - side);
                (cell << side) | along as usize
            })
        };
        let mut seen = vec![false; 1 << bits];
        (0..1 << bits).all(|index| !std::mem::replace(&mut seen[cell(index)], true))
    }

    #[test]
    fn boxes_of_pairs_have_one_point_each() {
        for pair in 0..8 {
            for m in 0..=10 {
                assert!((0..=m).all(|k| is_even(&[(2 * pair, k), (2 * pair + 1, m - k)])));
            }
        }
    }

    #[test]
    fn boxes_of_fours_have_one_point_each() {
        for first in [0, 4, 8, 12] {
            for m in 0..=4 {
                for (i, j, k) in (0..125).map(|n| (n / 25, n / 5 % 5, n % 5)) {
                    if i + j + k <= m {
                        let sides = [i, j, k, m - i - j - k];
                        let sides = [0, 1, 2, 3].map(|d| (first + d, 2 * sides[d as usize]));
                        assert!(is_even(&sides), "{sides:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn boxes_of_any_dimensions_have_one_point_each() {
        for a in 0..16 {
            for b in 0..a {
                assert!(is_even(&[(a, 4), (b, 4)]) && is_even(&[(a, 8), (b, 4)]));
                assert!((0..b).all(|c| is_even(&[(a, 4), (b, 4), (c, 4)])));
            }
        }
    }
}
