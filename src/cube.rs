//! Functions that are Rust on the host, and with the feature `wgpu` kernels of GPUs in CubeCL as well: they have the
//! attribute `cube`, and their arguments are structs with `#[apply(record!)]`, or `#[apply(zeroed!)]` if both languages
//! begin them as zeros, by `default()`.
//!
//! CubeCL compiles a subset of Rust: plain structs and slices, no early returns, closures or arrays.

pub(crate) use macro_rules_attribute::{apply, attribute_alias};

#[cfg(feature = "wgpu")]
pub(crate) use burn::cubecl::{self, prelude::*};

attribute_alias! {
    #[apply(record!)] =
        #[cfg_attr(feature = "wgpu", derive(CubeType, CubeTypeMut), expand(derive(Clone, Copy)))]
        #[derive(Clone, Copy, Debug)]
        #[macro_rules_attribute::macro_rules_derive(crate::lanes::lanes)];
    #[apply(zeroed!)] =
        #[cfg_attr(feature = "wgpu", derive(CubeType, CubeTypeMut, IntoRuntime), expand(derive(Clone, Copy)))]
        #[derive(Clone, Copy, Debug, Default)]
        #[macro_rules_attribute::macro_rules_derive(crate::lanes::lanes)];
}

#[cfg(feature = "wgpu")]
attribute_alias! {
    // Arguments of kernels, lists and numbers together.
    #[apply(argument!)] = #[derive(CubeType, CubeLaunch, Clone, Copy)] #[expand(derive(Clone, Copy))];
}

/// Makes a type one of fields that kernels are compiled for (`cube(comptime)`): in their language it stays what it is.
macro_rules! known_to_kernels {
    ($type:ty) => {
        #[cfg(feature = "wgpu")]
        impl IntoExpand for $type {
            type Expand = Self;

            fn into_expand(self, _: &Scope) -> Self {
                self
            }
        }

        #[cfg(feature = "wgpu")]
        impl Assign for $type {
            fn __expand_assign_method(&mut self, _: &Scope, value: Self) {
                *self = value;
            }
        }

        #[cfg(feature = "wgpu")]
        impl RuntimeAssign for $type {
            fn init_mut(&self, _: &Scope) -> Self {
                *self
            }
        }
    };
}
pub(crate) use known_to_kernels;

/// A condition that a kernel is compiled for; on the host it is one like others.
#[cfg(not(feature = "wgpu"))]
macro_rules! comptime {
    ($condition:expr) => {
        $condition
    };
}
#[cfg(not(feature = "wgpu"))]
pub(crate) use comptime;

/// A constant that a kernel may change later; on the host all may.
#[cfg(not(feature = "wgpu"))]
pub(crate) trait Runtime: Sized {
    fn runtime(self) -> Self {
        self
    }
}

#[cfg(not(feature = "wgpu"))]
impl<T: Copy> Runtime for T {}

/// The first of two values under a condition, else the second. Kernels choose without a branch, so neither may fail.
#[inline(always)]
pub(crate) fn select<T>(condition: bool, a: T, b: T) -> T {
    if condition { a } else { b }
}

/// In a kernel.
#[cfg(feature = "wgpu")]
pub(crate) mod select {
    pub(crate) use burn::cubecl::prelude::select::expand;
}
