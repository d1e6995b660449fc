//! Eight numbers at once: the instructions of a machine, and operators on numbers.

use std::ops::{Add, Mul, Sub};

/// The number of values that one instruction processes: the size of a register, and the number of triangles of a leaf.
pub const LANES: usize = 8;

/// Eight numbers, one per lane.
pub type Lanes = [f32; LANES];

/// The operations that a machine performs with one instruction each.
pub trait Machine: Copy {
    /// Eight numbers, and eight results of a comparison.
    type Floats: Copy;
    type Mask: Copy;

    fn load(self, lanes: &Lanes) -> Self::Floats;
    fn store(self, a: Self::Floats) -> Lanes;
    fn splat(self, x: f32) -> Self::Floats;
    fn add(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn sub(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn mul(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn div(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// a·b + c.
    fn mul_add(self, a: Self::Floats, b: Self::Floats, c: Self::Floats) -> Self::Floats;
    /// Returns b if one of them is NaN; `max` does the same.
    fn min(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn max(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn abs(self, a: Self::Floats) -> Self::Floats;
    /// a < b; false if one of them is NaN.
    fn less(self, a: Self::Floats, b: Self::Floats) -> Self::Mask;
    fn and(self, a: Self::Mask, b: Self::Mask) -> Self::Mask;
    fn or(self, a: Self::Mask, b: Self::Mask) -> Self::Mask;
    fn not(self, a: Self::Mask) -> Self::Mask;
    fn select(self, mask: Self::Mask, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn mask_bits(self, mask: Self::Mask) -> u32;
    /// Returns, for each column, the numbers of all eight rows.
    fn transpose(self, rows: &[Lanes; LANES]) -> [Self::Floats; LANES];
    /// Returns the minimum of all lanes. None may be NaN.
    fn least(self, a: Self::Floats) -> f32;
}

/// Eight numbers on a machine, with the operators of numbers.
#[derive(Clone, Copy)]
pub struct F8<M: Machine> {
    machine: M,
    floats: M::Floats,
}

/// Eight results of a comparison.
#[derive(Clone, Copy)]
pub struct Mask8<M: Machine> {
    machine: M,
    mask: M::Mask,
}

impl<M: Machine> F8<M> {
    #[inline(always)]
    pub fn load(machine: M, lanes: &Lanes) -> Self {
        Self::of(machine, machine.load(lanes))
    }

    #[inline(always)]
    pub fn splat(machine: M, x: f32) -> Self {
        Self::of(machine, machine.splat(x))
    }

    #[inline(always)]
    pub fn of(machine: M, floats: M::Floats) -> Self {
        Self { machine, floats }
    }

    #[inline(always)]
    pub fn lanes(self) -> Lanes {
        self.machine.store(self.floats)
    }

    #[inline(always)]
    pub fn less(self, b: Self) -> Mask8<M> {
        Mask8 {
            machine: self.machine,
            mask: self.machine.less(self.floats, b.floats),
        }
    }

    /// Returns the minimum of all lanes. None may be NaN.
    #[inline(always)]
    pub fn least(self) -> f32 {
        self.machine.least(self.floats)
    }
}

/// Defines the operations of a machine on the numbers of a type.
macro_rules! operations {
    ($of:ident, $part:ident: $($(#[$doc:meta])* $name:ident($($b:ident),*);)*) => {
        impl<M: Machine> $of<M> {
            $(
                $(#[$doc])*
                #[inline(always)]
                pub fn $name(self $(, $b: Self)*) -> Self {
                    let $part = self.machine.$name(self.$part $(, $b.$part)*);
                    Self { $part, ..self }
                }
            )*
        }
    };
}

operations! { F8, floats:
    /// self·b + c.
    mul_add(b, c);
    div(b);
    min(b);
    max(b);
    abs();
}

operations! { Mask8, mask:
    and(b);
    or(b);
    not();
}

impl<M: Machine> Mask8<M> {
    /// Returns a where the mask is true, otherwise b.
    #[inline(always)]
    pub fn select(self, a: F8<M>, b: F8<M>) -> F8<M> {
        F8::of(
            self.machine,
            self.machine.select(self.mask, a.floats, b.floats),
        )
    }

    /// Returns the mask as one bit per lane.
    #[inline(always)]
    pub fn bits(self) -> u32 {
        self.machine.mask_bits(self.mask)
    }
}

macro_rules! operators {
    ($($operator:ident $name:ident),*) => {
        $(
            impl<M: Machine> $operator for F8<M> {
                type Output = Self;

                #[inline(always)]
                fn $name(self, b: Self) -> Self {
                    Self::of(self.machine, self.machine.$name(self.floats, b.floats))
                }
            }
        )*
    };
}

operators!(Add add, Sub sub, Mul mul);
