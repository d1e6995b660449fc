//! The instructions of a machine on eight numbers at once.

/// Numbers that one instruction takes: those of a register, and the triangles of a leaf.
pub(crate) const LANES: usize = 8;

/// Eight numbers, one a lane.
pub(crate) type Lanes = [f32; LANES];

/// The operations that a machine has as one instruction each.
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

/// One bit for each lane.
#[inline(always)]
pub(in crate::accel) fn bits(of: [bool; LANES]) -> u32 {
    let mut mask = 0;
    for (i, &bit) in of.iter().enumerate() {
        mask |= u32::from(bit) << i;
    }
    mask
}
