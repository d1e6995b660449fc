//! Functions that run as Rust on the host and, with the feature `wgpu`, as GPU kernels in CubeCL. They have the
//! attribute `cube`. Their arguments are structs with `#[apply(record!)]`, or with `#[apply(zeroed!)]` if `default()`
//! sets them to zeros in both languages.
//!
//! CubeCL compiles a subset of Rust: plain structs and slices, without early returns, closures or arrays.

pub(crate) use macro_rules_attribute::{apply, attribute_alias};

#[cfg(feature = "gpu")]
pub(crate) use burn::cubecl::{self, prelude::*};

attribute_alias! {
    #[apply(record!)] =
        #[cfg_attr(feature = "gpu", derive(CubeType, CubeTypeMut), expand(derive(Clone, Copy)))]
        #[derive(Clone, Copy, Debug)]
        #[macro_rules_attribute::macro_rules_derive(crate::lanes::lanes)];
    #[apply(zeroed!)] =
        #[cfg_attr(feature = "gpu", derive(CubeType, CubeTypeMut, IntoRuntime), expand(derive(Clone, Copy)))]
        #[derive(Clone, Copy, Debug, Default)]
        #[macro_rules_attribute::macro_rules_derive(crate::lanes::lanes)];
}

#[cfg(feature = "gpu")]
attribute_alias! {
    // Arguments of kernels: lists and numbers together.
    #[apply(argument!)] = #[derive(CubeType, CubeLaunch, Clone, Copy)] #[expand(derive(Clone, Copy))];
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
pub(crate) trait Runtime: Sized {
    fn runtime(self) -> Self {
        self
    }
}

#[cfg(not(feature = "gpu"))]
impl<T: Copy> Runtime for T {}

/// Returns `a` if the condition is true, otherwise `b`. Kernels evaluate both without a branch, so neither may fail.
#[inline(always)]
pub(crate) fn select<T>(condition: bool, a: T, b: T) -> T {
    if condition { a } else { b }
}

/// Returns the larger number; on the host `b` if one of them is NaN. It is one instruction everywhere, and in vectors: `f32::max` has
/// a rule of its own for NaN, and is a call of a function on WebAssembly, which keeps loops from being vectorized.
#[inline(always)]
pub(crate) fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Returns the smaller number; on the host `b` if one of them is NaN.
#[inline(always)]
pub(crate) fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Returns `count`, the number of repetitions of a loop. Compilers of kernels do not know it, so they do not unroll the
/// loop: too large a kernel waits for its instructions. `small` is any variable below 2³¹.
#[inline(always)]
pub(crate) const fn repeated(count: usize, _small: u32) -> usize {
    count
}

/// The expansions of these functions in kernels.
#[cfg(feature = "gpu")]
mod expansions {
    use burn::cubecl::prelude;

    macro_rules! expansions {
        ($($name:ident),*) => {
            $(
                pub(crate) mod $name {
                    pub(crate) use super::prelude::$name::expand;
                }
            )*
        };
    }
    expansions!(max, min, select);
}
#[cfg(feature = "gpu")]
pub(crate) use expansions::{max, min, select};

/// The expansion of `repeated` in kernels.
#[cfg(feature = "gpu")]
pub(crate) mod repeated {
    use super::*;

    #[cube]
    pub(crate) fn unknown(count: usize, small: u32) -> usize {
        count + (small >> 31) as usize
    }

    pub(crate) use unknown::expand;
}
