//! Eight numbers at once with the operators of numbers.

use std::ops::{Add, Mul, Sub};

use super::machine::{Lanes, Machine};

/// Eight numbers of a machine, with the operators of numbers.
#[derive(Clone, Copy)]
pub(crate) struct F8<M: Machine> {
    machine: M,
    floats: M::Floats,
}

/// Eight answers.
#[derive(Clone, Copy)]
pub(crate) struct Mask8<M: Machine> {
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
    fn of(machine: M, floats: M::Floats) -> Self {
        Self { machine, floats }
    }

    #[inline(always)]
    pub fn lanes(self) -> Lanes {
        self.machine.store(self.floats)
    }

    /// self·b + c.
    #[inline(always)]
    pub fn mul_add(self, b: Self, c: Self) -> Self {
        Self::of(
            self.machine,
            self.machine.mul_add(self.floats, b.floats, c.floats),
        )
    }

    #[inline(always)]
    pub fn div(self, b: Self) -> Self {
        Self::of(self.machine, self.machine.div(self.floats, b.floats))
    }

    #[inline(always)]
    pub fn min(self, b: Self) -> Self {
        Self::of(self.machine, self.machine.min(self.floats, b.floats))
    }

    #[inline(always)]
    pub fn max(self, b: Self) -> Self {
        Self::of(self.machine, self.machine.max(self.floats, b.floats))
    }

    #[inline(always)]
    pub fn sqrt(self) -> Self {
        Self::of(self.machine, self.machine.sqrt(self.floats))
    }

    #[inline(always)]
    pub fn abs(self) -> Self {
        Self::of(self.machine, self.machine.abs(self.floats))
    }

    #[inline(always)]
    pub fn less(self, b: Self) -> Mask8<M> {
        Mask8 {
            machine: self.machine,
            mask: self.machine.less(self.floats, b.floats),
        }
    }

    /// The least of all lanes, which have to be numbers.
    #[inline(always)]
    pub fn least(self) -> f32 {
        self.machine.least(self.floats)
    }

    /// The sum of all lanes.
    #[inline(always)]
    pub fn sum(self) -> f32 {
        let a = self.lanes();
        ((a[0] + a[4]) + (a[2] + a[6])) + ((a[1] + a[5]) + (a[3] + a[7]))
    }
}

impl<M: Machine> Mask8<M> {
    #[inline(always)]
    pub fn and(self, b: Self) -> Self {
        Self {
            machine: self.machine,
            mask: self.machine.and(self.mask, b.mask),
        }
    }

    #[inline(always)]
    pub fn or(self, b: Self) -> Self {
        Self {
            machine: self.machine,
            mask: self.machine.or(self.mask, b.mask),
        }
    }

    #[inline(always)]
    pub fn not(self) -> Self {
        Self {
            machine: self.machine,
            mask: self.machine.not(self.mask),
        }
    }

    /// a where it is true, else b.
    #[inline(always)]
    pub fn select(self, a: F8<M>, b: F8<M>) -> F8<M> {
        F8::of(
            self.machine,
            self.machine.select(self.mask, a.floats, b.floats),
        )
    }

    /// One bit each.
    #[inline(always)]
    pub fn bits(self) -> u32 {
        self.machine.mask_bits(self.mask)
    }
}

impl<M: Machine> Add for F8<M> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self::of(self.machine, self.machine.add(self.floats, b.floats))
    }
}

impl<M: Machine> Sub for F8<M> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self::of(self.machine, self.machine.sub(self.floats, b.floats))
    }
}

impl<M: Machine> Mul for F8<M> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        Self::of(self.machine, self.machine.mul(self.floats, b.floats))
    }
}
