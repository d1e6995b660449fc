//! Eight numbers at once, in code for what the machine has, chosen while it runs.

use std::ops::{Add, Mul, Sub};

use pulp::Arch;

use super::leaf::{LANES, Lanes, bits};

/// What a machine does in one instruction.
pub(crate) trait Machine: Copy {
    /// Whether a·b + c is one.
    const FUSED: bool;

    /// Eight numbers, and eight answers.
    type Floats: Copy;
    type Mask: Copy;

    /// The lanes that are not less than 0, one bit each.
    fn not_negative(self, lanes: &Lanes) -> u32;

    fn load(self, lanes: &Lanes) -> Self::Floats;
    fn store(self, a: Self::Floats) -> Lanes;
    fn splat(self, x: f32) -> Self::Floats;
    fn add(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn sub(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn mul(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn div(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// a·b + c.
    fn mul_add(self, a: Self::Floats, b: Self::Floats, c: Self::Floats) -> Self::Floats;
    /// b where one is not a number.
    fn min(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn max(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn sqrt(self, a: Self::Floats) -> Self::Floats;
    fn abs(self, a: Self::Floats) -> Self::Floats;
    /// a < b, false where one is not a number.
    fn less(self, a: Self::Floats, b: Self::Floats) -> Self::Mask;
    fn and(self, a: Self::Mask, b: Self::Mask) -> Self::Mask;
    fn or(self, a: Self::Mask, b: Self::Mask) -> Self::Mask;
    fn not(self, a: Self::Mask) -> Self::Mask;
    fn select(self, mask: Self::Mask, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn mask_bits(self, mask: Self::Mask) -> u32;
    /// The least of all lanes; none may be other than a number.
    fn least(self, a: Self::Floats) -> f32;
}

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

/// Any machine.
#[derive(Clone, Copy)]
pub(crate) struct Plain<const FUSED: bool>;

/// Lane by lane.
#[inline(always)]
fn each(f: impl Fn(usize) -> f32) -> Lanes {
    let mut lanes = [0.0; LANES];
    for (i, lane) in lanes.iter_mut().enumerate() {
        *lane = f(i);
    }
    lanes
}

impl<const FUSED: bool> Machine for Plain<FUSED> {
    const FUSED: bool = FUSED;

    type Floats = Lanes;
    type Mask = [bool; LANES];

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
    fn add(self, a: Lanes, b: Lanes) -> Lanes {
        each(|i| a[i] + b[i])
    }

    #[inline(always)]
    fn sub(self, a: Lanes, b: Lanes) -> Lanes {
        each(|i| a[i] - b[i])
    }

    #[inline(always)]
    fn mul(self, a: Lanes, b: Lanes) -> Lanes {
        each(|i| a[i] * b[i])
    }

    #[inline(always)]
    fn div(self, a: Lanes, b: Lanes) -> Lanes {
        each(|i| a[i] / b[i])
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
    fn min(self, a: Lanes, b: Lanes) -> Lanes {
        each(|i| if a[i] < b[i] { a[i] } else { b[i] })
    }

    #[inline(always)]
    fn max(self, a: Lanes, b: Lanes) -> Lanes {
        each(|i| if a[i] > b[i] { a[i] } else { b[i] })
    }

    #[inline(always)]
    fn sqrt(self, a: Lanes) -> Lanes {
        each(|i| a[i].sqrt())
    }

    #[inline(always)]
    fn abs(self, a: Lanes) -> Lanes {
        each(|i| a[i].abs())
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

#[cfg(target_arch = "x86_64")]
impl Machine for pulp::x86::V3 {
    const FUSED: bool = true;

    type Floats = std::arch::x86_64::__m256;
    type Mask = std::arch::x86_64::__m256;

    #[inline(always)]
    fn not_negative(self, lanes: &Lanes) -> u32 {
        use std::arch::x86_64::_CMP_NLT_UQ;
        let zero = self.avx._mm256_setzero_ps();
        let lanes = pulp::cast(*lanes);
        let mask = self.avx._mm256_cmp_ps::<_CMP_NLT_UQ>(lanes, zero);
        self.avx._mm256_movemask_ps(mask) as u32
    }

    #[inline(always)]
    fn load(self, lanes: &Lanes) -> Self::Floats {
        pulp::cast(*lanes)
    }

    #[inline(always)]
    fn store(self, a: Self::Floats) -> Lanes {
        pulp::cast(a)
    }

    #[inline(always)]
    fn splat(self, x: f32) -> Self::Floats {
        self.avx._mm256_set1_ps(x)
    }

    #[inline(always)]
    fn add(self, a: Self::Floats, b: Self::Floats) -> Self::Floats {
        self.avx._mm256_add_ps(a, b)
    }

    #[inline(always)]
    fn sub(self, a: Self::Floats, b: Self::Floats) -> Self::Floats {
        self.avx._mm256_sub_ps(a, b)
    }

    #[inline(always)]
    fn mul(self, a: Self::Floats, b: Self::Floats) -> Self::Floats {
        self.avx._mm256_mul_ps(a, b)
    }

    #[inline(always)]
    fn div(self, a: Self::Floats, b: Self::Floats) -> Self::Floats {
        self.avx._mm256_div_ps(a, b)
    }

    #[inline(always)]
    fn mul_add(self, a: Self::Floats, b: Self::Floats, c: Self::Floats) -> Self::Floats {
        self.fma._mm256_fmadd_ps(a, b, c)
    }

    #[inline(always)]
    fn min(self, a: Self::Floats, b: Self::Floats) -> Self::Floats {
        self.avx._mm256_min_ps(a, b)
    }

    #[inline(always)]
    fn max(self, a: Self::Floats, b: Self::Floats) -> Self::Floats {
        self.avx._mm256_max_ps(a, b)
    }

    #[inline(always)]
    fn sqrt(self, a: Self::Floats) -> Self::Floats {
        self.avx._mm256_sqrt_ps(a)
    }

    #[inline(always)]
    fn abs(self, a: Self::Floats) -> Self::Floats {
        self.avx._mm256_andnot_ps(self.avx._mm256_set1_ps(-0.0), a)
    }

    #[inline(always)]
    fn less(self, a: Self::Floats, b: Self::Floats) -> Self::Mask {
        use std::arch::x86_64::_CMP_LT_OQ;
        self.avx._mm256_cmp_ps::<_CMP_LT_OQ>(a, b)
    }

    #[inline(always)]
    fn and(self, a: Self::Mask, b: Self::Mask) -> Self::Mask {
        self.avx._mm256_and_ps(a, b)
    }

    #[inline(always)]
    fn or(self, a: Self::Mask, b: Self::Mask) -> Self::Mask {
        self.avx._mm256_or_ps(a, b)
    }

    #[inline(always)]
    fn not(self, a: Self::Mask) -> Self::Mask {
        let all = self.avx._mm256_castsi256_ps(self.avx._mm256_set1_epi32(-1));
        self.avx._mm256_xor_ps(a, all)
    }

    #[inline(always)]
    fn select(self, mask: Self::Mask, a: Self::Floats, b: Self::Floats) -> Self::Floats {
        self.avx._mm256_blendv_ps(b, a, mask)
    }

    #[inline(always)]
    fn mask_bits(self, mask: Self::Mask) -> u32 {
        self.avx._mm256_movemask_ps(mask) as u32
    }

    #[inline(always)]
    fn least(self, a: Self::Floats) -> f32 {
        let a = self.sse._mm_min_ps(
            self.avx._mm256_castps256_ps128(a),
            self.avx._mm256_extractf128_ps::<1>(a),
        );
        let a = self.sse._mm_min_ps(a, self.sse._mm_movehl_ps(a, a));
        let a = self.sse._mm_min_ps(a, self.sse._mm_shuffle_ps::<1>(a, a));
        self.sse._mm_cvtss_f32(a)
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
