//! The points of a sequence of 16 dimensions: of any 16ᵏ in a row that begin at a multiple of it, each box of volume
//! 16⁻ᵏ whose sides are powers of 1/16 has one, in any of the dimensions. So has each box of volume 4⁻ᵏ in four
//! dimensions (4 q and after) of 4ᵏ points whose sides are powers of ¼, and each of 2⁻ᵏ in two (2 p and after) of 2ᵏ
//! points: Faure's sequence over the field of 16 elements, in which those over 4 and 2 are nested (Ahmed, Skopenkov,
//! Hadwiger and Wonka 2023). A digit of four bits is an element, and all that is done to it is linear in its bits.

use std::sync::OnceLock;

/// Pairs of dimensions, and the words of each.
pub(super) const PAIRS: u32 = 8;
pub(super) const OF_PAIR: usize = 128;

/// Digits of an index, of four bits each.
const DIGITS: u32 = 4;

/// What is done to the digits of dimensions so that boxes are those of a smaller field, too: each row is one bit of the
/// product. The first makes a pair of one dimension, the second four of a pair; the last, one for each four dimensions,
/// leaves those as they are, and spreads fewer points than 256 well in other pairs.
const IN_PAIR: [u8; 4] = [15, 10, 12, 8];
const IN_FOUR: [u8; 4] = [13, 6, 4, 8];
const OF_FOUR: [[u8; 4]; 4] = [[1, 2, 4, 8], [5, 10, 4, 8], [9, 14, 4, 8], [13, 6, 4, 8]];

/// The product of two elements of the field of four, 0, 1, w and w + 1.
fn product_of_four(a: u8, b: u8) -> u8 {
    let carried = (if b & 1 != 0 { a } else { 0 }) ^ (if b & 2 != 0 { a << 1 } else { 0 });
    // w² = w + 1.
    if carried & 4 != 0 {
        carried ^ 7
    } else {
        carried
    }
}

/// The product of two elements a + b y of the field of 16, where y² = y + w.
fn product(a: u8, b: u8) -> u8 {
    let high = product_of_four(a >> 2, b >> 2);
    let cross = product_of_four(a & 3, b >> 2) ^ product_of_four(a >> 2, b & 3);
    let low = product_of_four(a & 3, b & 3) ^ product_of_four(high, 2);
    low | ((cross ^ high) << 2)
}

/// A digit whose bits are parities of those that rows name.
fn mixed(rows: [u8; 4], digit: u8) -> u8 {
    let bit = |r: usize| u8::from((rows[r] & digit).count_ones() & 1 == 1) << r;
    bit(0) | bit(1) | bit(2) | bit(3)
}

/// What a digit of the index, by its place, adds to a coordinate: the last bit is what halves the range.
fn coordinate(dimension: u8, place: u32, digit: u8) -> u32 {
    let of_digit = |i: u32| {
        // The i-th derivative of a polynomial at the dimension's element, whose coefficients are the digits: binomials
        // are 0 or 1, which are 1 where the bits of i are among those of the place.
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

/// The coordinates, with their bits reversed, for each pair of dimensions by four bits of the reversed index at a time: a
/// point is the sum, without carry, of those of the four parts of its index.
pub(crate) fn points() -> &'static [u32] {
    static POINTS: OnceLock<Vec<u32>> = OnceLock::new();
    POINTS.get_or_init(|| {
        let of = |i: u32| {
            let (pair, place, bits, d) = (i >> 7, (i >> 5) & 3, (i >> 1) & 15, i & 1);
            let digit = (bits as u8).reverse_bits() >> 4;
            coordinate((2 * pair + d) as u8, place, digit)
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

    /// Whether each of boxes has one of as many points: `sides` are log₂ of the boxes along dimensions.
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
