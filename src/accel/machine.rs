//! Code for what the machine has, chosen while it runs.

use pulp::Arch;

use super::leaf::{LANES, Lanes, bits};

/// What a machine does in one instruction.
pub(crate) trait Machine: Copy {
    /// a·b + c.
    const FUSED: bool;

    /// The lanes that are not less than 0, one bit each.
    fn not_negative(self, lanes: &Lanes) -> u32;
}

/// Any machine.
#[derive(Clone, Copy)]
pub(crate) struct Plain<const FUSED: bool>;

impl<const FUSED: bool> Machine for Plain<FUSED> {
    const FUSED: bool = FUSED;

    #[inline(always)]
    fn not_negative(self, lanes: &Lanes) -> u32 {
        let mut negative = [false; LANES];
        for i in 0..LANES {
            negative[i] = lanes[i] < 0.0;
        }
        bits(negative) ^ ((1 << LANES) - 1)
    }
}

#[cfg(target_arch = "x86_64")]
impl Machine for pulp::x86::V3 {
    const FUSED: bool = true;

    #[inline(always)]
    fn not_negative(self, lanes: &Lanes) -> u32 {
        use std::arch::x86_64::_CMP_NLT_UQ;
        let zero = self.avx._mm256_setzero_ps();
        let lanes = pulp::cast(*lanes);
        let mask = self.avx._mm256_cmp_ps::<_CMP_NLT_UQ>(lanes, zero);
        self.avx._mm256_movemask_ps(mask) as u32
    }
}

/// Something to do in code for what the machine has. Not a closure: those that only borrow go through a
/// function of `core`, which is compiled for any machine. All that it calls is to be inlined, for the
/// same reason.
pub(crate) trait Task {
    type Output;

    fn run<M: Machine>(self, machine: M) -> Self::Output;
}

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
