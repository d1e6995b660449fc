//! Functions that run as Rust on the host and, with the feature `wgpu`, as GPU kernels in CubeCL. They have the
//! attribute `cube`. Their arguments are structs with `#[apply(record!)]`, or with `#[apply(zeroed!)]` if `default()`
//! sets them to zeros in both languages.
//!
//! CubeCL compiles a subset of Rust: plain structs and slices, without early returns, closures or arrays.

pub use macro_rules_attribute::apply;

#[cfg(feature = "gpu")]
pub use crate::argument;
pub use crate::{record, zeroed};

#[cfg(feature = "gpu")]
pub use ::cubecl::{self, prelude::*};

/// A struct of numbers, which may also be eight at once ([`Record`](crate::lanes::Record)).
#[macro_export]
#[doc(hidden)]
macro_rules! record {
    ($($item:tt)*) => {
        #[cfg_attr(feature = "gpu", derive(CubeType, CubeTypeMut), expand(derive(Clone, Copy)))]
        #[derive(Clone, Copy, Debug)]
        $($item)*
        $crate::lanes! { $($item)* }
    };
}

/// A [`record!`] that `default()` sets to zeros.
#[macro_export]
#[doc(hidden)]
macro_rules! zeroed {
    ($($item:tt)*) => {
        #[cfg_attr(feature = "gpu", derive(CubeType, CubeTypeMut, IntoRuntime), expand(derive(Clone, Copy)))]
        #[derive(Clone, Copy, Debug, Default)]
        $($item)*
        $crate::lanes! { $($item)* }
    };
}

/// Arguments of kernels: lists and numbers together.
#[cfg(feature = "gpu")]
#[macro_export]
#[doc(hidden)]
macro_rules! argument {
    ($($item:tt)*) => {
        #[derive(CubeType, CubeLaunch, Clone, Copy)]
        #[expand(derive(Clone, Copy))]
        $($item)*
    };
}

/// Allows a type in fields that are constants of a kernel's compilation (`cube(comptime)`). The type expands to itself.
macro_rules! known_to_kernels {
    ($type:ty) => {
        #[cfg(feature = "gpu")]
        impl IntoExpand for $type {
            type Expand = Self;

            fn into_expand(self, _: &Scope) -> Self {
                self
            }
        }

        #[cfg(feature = "gpu")]
        impl Assign for $type {
            fn __expand_assign_method(&mut self, _: &Scope, value: Self) {
                *self = value;
            }
        }

        #[cfg(feature = "gpu")]
        impl RuntimeAssign for $type {
            fn init_mut(&self, _: &Scope) -> Self {
                *self
            }
        }
    };
}
pub(crate) use known_to_kernels;

/// A condition that is evaluated when a kernel is compiled. On the host it is an ordinary condition.
#[cfg(not(feature = "gpu"))]
macro_rules! comptime {
    ($condition:expr) => {
        $condition
    };
}
#[cfg(not(feature = "gpu"))]
pub(crate) use comptime;

/// Turns a constant into a variable of a kernel. On the host this returns the value itself.
#[cfg(not(feature = "gpu"))]
pub trait Runtime: Sized {
    fn runtime(self) -> Self {
        self
    }
}

#[cfg(not(feature = "gpu"))]
impl<T: Copy> Runtime for T {}

/// Returns `a` if the condition is true, otherwise `b`. Kernels evaluate both without a branch, so neither may fail.
#[inline(always)]
pub fn select<T>(condition: bool, a: T, b: T) -> T {
    if condition { a } else { b }
}

/// Returns the larger number; on the host `b` if one of them is NaN. It is one instruction everywhere, and in vectors: `f32::max` has
/// a rule of its own for NaN, and is a call of a function on WebAssembly, which keeps loops from being vectorized.
#[inline(always)]
pub fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Returns the smaller number; on the host `b` if one of them is NaN.
#[inline(always)]
pub fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Returns `count`, the number of repetitions of a loop. Compilers of kernels do not know it, so they do not unroll the
/// loop: too large a kernel waits for its instructions. `small` is any variable below 2³¹.
#[inline(always)]
pub const fn repeated(count: usize, _small: u32) -> usize {
    count
}

/// The expansions of these functions in kernels.
#[cfg(feature = "gpu")]
mod expansions {
    use cubecl::prelude;

    macro_rules! expansions {
        ($($name:ident),*) => {
            $(
                pub mod $name {
                    pub use super::prelude::$name::expand;
                }
            )*
        };
    }
    expansions!(max, min, select);
}
#[cfg(feature = "gpu")]
pub use expansions::{max, min, select};

/// The expansion of `repeated` in kernels.
#[cfg(feature = "gpu")]
pub mod repeated {
    use super::*;

    #[cube]
    pub fn unknown(count: usize, small: u32) -> usize {
        count + (small >> 31) as usize
    }

    pub use unknown::expand;
}
