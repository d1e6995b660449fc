//! Eight numbers in two registers of WebAssembly.

use std::arch::wasm32::*;

use super::float8::{LANES, Lanes, Machine};

/// WebAssembly's vectors of 128 bits.
#[derive(Clone, Copy)]
pub struct Simd128;

/// Operations that are one instruction on each register.
macro_rules! instructions {
    ($($name:ident($($a:ident),*) = $instruction:ident($($of:ident),*);)*) => {
        $(
            #[inline(always)]
            fn $name(self, $($a: [v128; 2]),*) -> [v128; 2] {
                [$instruction($($of[0]),*), $instruction($($of[1]),*)]
            }
        )*
    };
}

impl Machine for Simd128 {
    type Floats = [v128; 2];
    type Mask = [v128; 2];

    instructions! {
        add(a, b) = f32x4_add(a, b);
        sub(a, b) = f32x4_sub(a, b);
        mul(a, b) = f32x4_mul(a, b);
        div(a, b) = f32x4_div(a, b);
        // `pmin(b, a)` is a < b ? a : b, and `pmax(b, a)` is b < a ? a : b.
        min(a, b) = f32x4_pmin(b, a);
        max(a, b) = f32x4_pmax(b, a);
        abs(a) = f32x4_abs(a);
        less(a, b) = f32x4_lt(a, b);
        and(a, b) = v128_and(a, b);
        or(a, b) = v128_or(a, b);
        not(a) = v128_not(a);
        select(mask, a, b) = v128_bitselect(a, b, mask);
    }

    #[inline(always)]
    fn load(self, lanes: &Lanes) -> [v128; 2] {
        let [a, b, c, d, e, f, g, h] = *lanes;
        [f32x4(a, b, c, d), f32x4(e, f, g, h)]
    }

    #[inline(always)]
    fn store(self, [a, b]: [v128; 2]) -> Lanes {
        [
            f32x4_extract_lane::<0>(a),
            f32x4_extract_lane::<1>(a),
            f32x4_extract_lane::<2>(a),
            f32x4_extract_lane::<3>(a),
            f32x4_extract_lane::<0>(b),
            f32x4_extract_lane::<1>(b),
            f32x4_extract_lane::<2>(b),
            f32x4_extract_lane::<3>(b),
        ]
    }

    #[inline(always)]
    fn splat(self, x: f32) -> [v128; 2] {
        [f32x4_splat(x); 2]
    }

    #[inline(always)]
    fn mul_add(self, a: [v128; 2], b: [v128; 2], c: [v128; 2]) -> [v128; 2] {
        self.add(self.mul(a, b), c)
    }

    #[inline(always)]
    fn mask_bits(self, [a, b]: [v128; 2]) -> u32 {
        u32::from(u32x4_bitmask(a)) | u32::from(u32x4_bitmask(b)) << 4
    }

    #[inline(always)]
    fn transpose(self, rows: &[Lanes; LANES]) -> [[v128; 2]; LANES] {
        let rows: [[v128; 2]; LANES] = [
            self.load(&rows[0]),
            self.load(&rows[1]),
            self.load(&rows[2]),
            self.load(&rows[3]),
            self.load(&rows[4]),
            self.load(&rows[5]),
            self.load(&rows[6]),
            self.load(&rows[7]),
        ];
        // Pairs of rows, then fours of rows.
        let four = |k: usize, half: usize| {
            let [a, b, c, d] = [0, 1, 2, 3].map(|i: usize| rows[k + i][half]);
            let low = [
                i32x4_shuffle::<0, 4, 1, 5>(a, b),
                i32x4_shuffle::<0, 4, 1, 5>(c, d),
            ];
            let high = [
                i32x4_shuffle::<2, 6, 3, 7>(a, b),
                i32x4_shuffle::<2, 6, 3, 7>(c, d),
            ];
            [
                i32x4_shuffle::<0, 1, 4, 5>(low[0], low[1]),
                i32x4_shuffle::<2, 3, 6, 7>(low[0], low[1]),
                i32x4_shuffle::<0, 1, 4, 5>(high[0], high[1]),
                i32x4_shuffle::<2, 3, 6, 7>(high[0], high[1]),
            ]
        };
        let (first, second) = ([four(0, 0), four(4, 0)], [four(0, 1), four(4, 1)]);
        let column = |of: [[v128; 4]; 2], k: usize| [of[0][k], of[1][k]];
        [
            column(first, 0),
            column(first, 1),
            column(first, 2),
            column(first, 3),
            column(second, 0),
            column(second, 1),
            column(second, 2),
            column(second, 3),
        ]
    }

    #[inline(always)]
    fn least(self, [a, b]: [v128; 2]) -> f32 {
        let a = f32x4_pmin(a, b);
        let a = f32x4_pmin(a, i32x4_shuffle::<2, 3, 0, 1>(a, a));
        let a = f32x4_pmin(a, i32x4_shuffle::<1, 0, 3, 2>(a, a));
        f32x4_extract_lane::<0>(a)
    }
}
