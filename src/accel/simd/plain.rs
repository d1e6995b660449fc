//! Eight numbers lane by lane, in code that the compiler makes vectors of on any machine.

use super::float8::{LANES, Lanes, Machine, bits};

/// A machine without instructions of its own. `FUSED` says whether it has a·b + c as one.
#[derive(Clone, Copy)]
pub(crate) struct Plain<const FUSED: bool>;

/// The value of each lane.
#[inline(always)]
fn each(f: impl Fn(usize) -> f32) -> Lanes {
    let mut lanes = [0.0; LANES];
    for (i, lane) in lanes.iter_mut().enumerate() {
        *lane = f(i);
    }
    lanes
}

/// Operations on each lane by itself.
macro_rules! by_lane {
    ($($name:ident($($a:ident),*) = |$i:ident| $value:expr;)*) => {
        $(
            #[inline(always)]
            fn $name(self, $($a: Lanes),*) -> Lanes {
                each(|$i| $value)
            }
        )*
    };
}

impl<const FUSED: bool> Machine for Plain<FUSED> {
    const FUSED: bool = FUSED;

    type Floats = Lanes;
    type Mask = [bool; LANES];

    by_lane! {
        add(a, b) = |i| a[i] + b[i];
        sub(a, b) = |i| a[i] - b[i];
        mul(a, b) = |i| a[i] * b[i];
        div(a, b) = |i| a[i] / b[i];
        min(a, b) = |i| if a[i] < b[i] { a[i] } else { b[i] };
        max(a, b) = |i| if a[i] > b[i] { a[i] } else { b[i] };
        sqrt(a) = |i| a[i].sqrt();
        abs(a) = |i| a[i].abs();
    }

    #[inline(always)]
    fn not_negative(self, lanes: &Lanes) -> u32 {
        let mut negative = [false; LANES];
        for i in 0..LANES {
            negative[i] = lanes[i] < 0.0;
        }
        bits(negative) ^ ((1 << LANES) - 1)
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
    fn less(self, a: Lanes, b: Lanes) -> Self::Mask {
        let mut mask = [false; LANES];
        for i in 0..LANES {
            mask[i] = a[i] < b[i];
        }
        mask
    }

    #[inline(always)]
    fn and(self, a: Self::Mask, b: Self::Mask) -> Self::Mask {
        let mut mask = a;
        for i in 0..LANES {
            mask[i] &= b[i];
        }
        mask
    }

    #[inline(always)]
    fn or(self, a: Self::Mask, b: Self::Mask) -> Self::Mask {
        let mut mask = a;
        for i in 0..LANES {
            mask[i] |= b[i];
        }
        mask
    }

    #[inline(always)]
    fn not(self, a: Self::Mask) -> Self::Mask {
        a.map(|a| !a)
    }

    #[inline(always)]
    fn select(self, mask: Self::Mask, a: Lanes, b: Lanes) -> Lanes {
        each(|i| if mask[i] { a[i] } else { b[i] })
    }

    #[inline(always)]
    fn mask_bits(self, mask: Self::Mask) -> u32 {
        bits(mask)
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
