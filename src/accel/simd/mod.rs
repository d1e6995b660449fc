//! Eight numbers at once, in code for what the machine has, chosen while it runs.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod float8;
mod plain;

use pulp::Arch;

pub(crate) use float8::{F8, LANES, Lanes, Machine, Mask8};
pub(crate) use plain::Plain;

/// Something to do in code for what the machine has. Not a closure: those that only borrow go through a
/// function of `core`, which is compiled for any machine. All that it calls is to be inlined, for the
/// same reason.
pub(crate) trait Task {
    type Output;

    fn run<M: Machine>(self, machine: M) -> Self::Output;
}

/// Makes a function a [`Task`], done on the machine that `arch` of its first argument names.
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

/// A function of each of three numbers, written out: a closure that `map` of arrays is given may not be inlined.
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

struct OnMachine<T, M>(T, M);

impl<T: Task, M: Machine> pulp::WithSimd for OnMachine<T, M> {
    type Output = T::Output;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _simd: S) -> T::Output {
        self.0.run(self.1)
    }
}

/// Does something in code for a machine.
#[inline(always)]
pub(crate) fn dispatch<T: Task>(arch: Arch, task: T) -> T::Output {
    match arch {
        Arch::Scalar => task.run(Plain::<false>),
        #[cfg(target_arch = "x86_64")]
        Arch::V3(machine) => arch.dispatch(OnMachine(task, machine)),
        #[allow(unreachable_patterns)] // on machines of the arms above
        arch => arch.dispatch(OnMachine(task, Plain::<true>)),
    }
}
