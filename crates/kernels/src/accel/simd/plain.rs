//! Eight numbers lane by lane, in code that the compiler vectorizes for any machine.

use super::float8::{LANES, Lanes, Machine};

/// A machine without explicit instructions. `FUSED` is true if it computes a·b + c in one instruction.
#[derive(Clone, Copy)]
pub struct Plain<const FUSED: bool>;

/// Computes the value of each lane.
#[inline(always)]
fn each<T: Copy + Default>(f: impl Fn(usize) -> T) -> [T; LANES] {
    let mut lanes = [T::default(); LANES];
    for (i, lane) in lanes.iter_mut().enumerate() {
        *lane = f(i);
    }
    lanes
}

/// Operations that treat each lane independently.
macro_rules! by_lane {
    ($($name:ident($($a:ident: $of:ident),*) -> $to:ident = |$i:ident| $value:expr;)*) => {
        $(
            #[inline(always)]
            fn $name(self, $($a: Self::$of),*) -> Self::$to {
                each(|$i| $value)
            }
        )*
    };
}

impl<const FUSED: bool> Machine for Plain<FUSED> {
    type Floats = Lanes;
    type Mask = [bool; LANES];

    by_lane! {
        add(a: Floats, b: Floats) -> Floats = |i| a[i] + b[i];
        sub(a: Floats, b: Floats) -> Floats = |i| a[i] - b[i];
        mul(a: Floats, b: Floats) -> Floats = |i| a[i] * b[i];
        div(a: Floats, b: Floats) -> Floats = |i| a[i] / b[i];
        min(a: Floats, b: Floats) -> Floats = |i| if a[i] < b[i] { a[i] } else { b[i] };
        max(a: Floats, b: Floats) -> Floats = |i| if a[i] > b[i] { a[i] } else { b[i] };
        abs(a: Floats) -> Floats = |i| a[i].abs();
        less(a: Floats, b: Floats) -> Mask = |i| a[i] < b[i];
        and(a: Mask, b: Mask) -> Mask = |i| a[i] & b[i];
        or(a: Mask, b: Mask) -> Mask = |i| a[i] | b[i];
        not(a: Mask) -> Mask = |i| !a[i];
        select(mask: Mask, a: Floats, b: Floats) -> Floats = |i| if mask[i] { a[i] } else { b[i] };
    }

    #[inline(always)]
    fn load(self, lanes: &Lanes) -> Lanes {
        *lanes
    }

    #[inline(always)]
    fn store(self, a: Lanes) -> Lanes {
        a
    }

    #[inline(always)]
    fn splat(self, x: f32) -> Lanes {
        [x; LANES]
    }

    #[inline(always)]
    fn mul_add(self, a: Lanes, b: Lanes, c: Lanes) -> Lanes {
        if FUSED {
            each(|i| a[i].mul_add(b[i], c[i]))
        } else {
            each(|i| a[i] * b[i] + c[i])
        }
    }

    #[inline(always)]
    fn mask_bits(self, mask: Self::Mask) -> u32 {
        let mut bits = 0;
        for (i, &bit) in mask.iter().enumerate() {
            bits |= u32::from(bit) << i;
        }
        bits
    }

    #[inline(always)]
    fn transpose(self, rows: &[Lanes; LANES]) -> [Lanes; LANES] {
        let mut all = [[0.0; LANES]; LANES];
        for (k, lanes) in all.iter_mut().enumerate() {
            *lanes = each(|i| rows[i][k]);
        }
        all
    }

    #[inline(always)]
    fn least(self, a: Lanes) -> f32 {
        let mut least = a[0];
        for x in a {
            least = if x < least { x } else { least };
        }
        least
    }
}
