//! Eight numbers at once, with the instructions of the machine, which are chosen at run time.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod float8;
#[cfg(not(all(target_arch = "wasm32", target_feature = "simd128")))]
mod plain;
#[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
mod simd128;

use pulp::Arch;

pub use float8::{F8, LANES, Lanes, Machine, Mask8};
#[cfg(not(all(target_arch = "wasm32", target_feature = "simd128")))]
pub use plain::Plain;

/// Work that is compiled for the machine's instructions. It is not a closure, because a closure that only borrows
/// passes through a function of `core`, which is compiled for any machine. For the same reason, everything that it
/// calls must be inlined.
pub trait Task {
    type Output;

    fn run<M: Machine>(self, machine: M) -> Self::Output;
}

/// Turns a function into a [`Task`], which runs on the machine given by `arch` of its first argument.
macro_rules! stage {
    (
        $(#[$meta:meta])*
        $vis:vis fn $name:ident<'a>($first:ident: $of_first:ty $(, $argument:ident: $type:ty)* $(,)?)
        $(-> $output:ty)? $body:block
    ) => {
        $(#[$meta])*
        $vis fn $name<'a>($first: $of_first $(, $argument: $type)*) $(-> $output)? {
            struct Stage<'a> {
                $first: $of_first,
                $($argument: $type,)*
            }

            impl<'a> $crate::accel::Task for Stage<'a> {
                type Output = $crate::accel::stage!(@output $($output)?);

                #[inline(always)]
                fn run<M: $crate::accel::Machine>(self, _: M) -> Self::Output {
                    #[allow(unused_variables, reason = "the first argument may name the machine alone")]
                    let Self { $first, $($argument,)* } = self;
                    $body
                }
            }

            $crate::accel::dispatch($first.arch, Stage { $first, $($argument,)* })
        }
    };
    (@output) => { () };
    (@output $output:ty) => { $output };
}
pub(crate) use stage;

/// Applies an expression to each of three numbers. It is written out, because a closure passed to `map` of arrays may
/// not be inlined.
macro_rules! each_of_three {
    (|$x:ident| $value:expr, $three:expr) => {{
        let [a, b, c] = $three;
        let ($x, second, third) = (a, b, c);
        let first = $value;
        let $x = second;
        let second = $value;
        let $x = third;
        [first, second, $value]
    }};
}
pub(super) use each_of_three;

#[cfg(not(target_arch = "wasm32"))]
struct OnMachine<T, M>(T, M);

#[cfg(not(target_arch = "wasm32"))]
impl<T: Task, M: Machine> pulp::WithSimd for OnMachine<T, M> {
    type Output = T::Output;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _simd: S) -> T::Output {
        self.0.run(self.1)
    }
}

/// Runs a task with the instructions of a machine.
#[cfg(not(target_arch = "wasm32"))]
#[inline(always)]
pub fn dispatch<T: Task>(arch: Arch, task: T) -> T::Output {
    match arch {
        Arch::Scalar => task.run(Plain::<false>),
        #[cfg(target_arch = "x86_64")]
        Arch::V3(machine) => arch.dispatch(OnMachine(task, machine)),
        #[allow(unreachable_patterns)] // on machines of the arms above
        arch => arch.dispatch(OnMachine(task, Plain::<true>)),
    }
}

/// Runs a task with the instructions for which the program is compiled: on WebAssembly they are not chosen at run time.
/// It has no instruction that multiplies and adds. Stages stay functions of their own, as they are on machines whose
/// instructions are chosen at run time: all of them in one function took 4 % more time.
#[cfg(target_arch = "wasm32")]
#[inline(never)]
pub fn dispatch<T: Task>(_arch: Arch, task: T) -> T::Output {
    #[cfg(target_feature = "simd128")]
    let machine = simd128::Simd128;
    #[cfg(not(target_feature = "simd128"))]
    let machine = Plain::<false>;
    task.run(machine)
}
