//! Three numbers. Formulas of `model` are written in a subset of Rust that a kernel language takes:
//! plain structs, no early returns, no closures.

use std::ops::{Add, AddAssign, Mul, Neg, Sub, SubAssign};

/// A point, direction or colour.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct V3 {
    pub x: f32,
    pub y: f32,
    pub z: f32,
}

/// A vector of its components.
#[inline(always)]
pub(crate) const fn v3(x: f32, y: f32, z: f32) -> V3 {
    V3 { x, y, z }
}

/// The same number three times.
#[inline(always)]
pub(crate) const fn splat(x: f32) -> V3 {
    V3 { x, y: x, z: x }
}

impl V3 {
    pub const ZERO: Self = splat(0.0);
    pub const ONE: Self = splat(1.0);

    #[inline(always)]
    pub fn dot(self, o: Self) -> f32 {
        self.x * o.x + self.y * o.y + self.z * o.z
    }

    #[inline(always)]
    pub fn cross(self, o: Self) -> Self {
        v3(
            self.y * o.z - self.z * o.y,
            self.z * o.x - self.x * o.z,
            self.x * o.y - self.y * o.x,
        )
    }

    /// Component by component.
    #[inline(always)]
    pub fn times(self, o: Self) -> Self {
        v3(self.x * o.x, self.y * o.y, self.z * o.z)
    }

    #[inline(always)]
    pub fn length_squared(self) -> f32 {
        self.x * self.x + self.y * self.y + self.z * self.z
    }

    #[inline(always)]
    pub fn length(self) -> f32 {
        self.length_squared().sqrt()
    }

    /// The unit vector of its direction; not finite for a vector of length 0.
    #[inline(always)]
    pub fn normalized(self) -> Self {
        self * (1.0 / self.length())
    }

    /// Its part at right angles to a unit vector.
    #[inline(always)]
    pub fn across(self, unit: Self) -> Self {
        self - unit * self.dot(unit)
    }

    /// The smaller of each component.
    #[inline(always)]
    pub fn min(self, o: Self) -> Self {
        v3(self.x.min(o.x), self.y.min(o.y), self.z.min(o.z))
    }

    /// The larger of each component.
    #[inline(always)]
    pub fn max(self, o: Self) -> Self {
        v3(self.x.max(o.x), self.y.max(o.y), self.z.max(o.z))
    }

    /// The sum of the components.
    #[inline(always)]
    pub fn sum(self) -> f32 {
        self.x + self.y + self.z
    }

    /// The largest component.
    #[inline(always)]
    pub fn max_component(self) -> f32 {
        self.x.max(self.y).max(self.z)
    }

    /// The largest absolute value of a component.
    #[inline(always)]
    pub fn max_abs(self) -> f32 {
        self.x.abs().max(self.y.abs()).max(self.z.abs())
    }

    /// The sum of the components' absolute values.
    #[inline(always)]
    pub fn sum_abs(self) -> f32 {
        self.x.abs() + self.y.abs() + self.z.abs()
    }

    pub fn is_zero(self) -> bool {
        self.x == 0.0 && self.y == 0.0 && self.z == 0.0
    }

    pub fn to_array(self) -> [f32; 3] {
        [self.x, self.y, self.z]
    }

    pub fn to_f64(self) -> [f64; 3] {
        [self.x.into(), self.y.into(), self.z.into()]
    }
}

impl From<[f64; 3]> for V3 {
    fn from(v: [f64; 3]) -> Self {
        v3(v[0] as f32, v[1] as f32, v[2] as f32)
    }
}

impl From<glam::DVec3> for V3 {
    fn from(v: glam::DVec3) -> Self {
        v.to_array().into()
    }
}

impl From<V3> for glam::DVec3 {
    fn from(v: V3) -> Self {
        Self::new(v.x.into(), v.y.into(), v.z.into())
    }
}

impl From<glam::Vec3> for V3 {
    #[inline(always)]
    fn from(v: glam::Vec3) -> Self {
        v3(v.x, v.y, v.z)
    }
}

impl From<V3> for glam::Vec3 {
    #[inline(always)]
    fn from(v: V3) -> Self {
        Self::new(v.x, v.y, v.z)
    }
}

impl Add for V3 {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        v3(self.x + o.x, self.y + o.y, self.z + o.z)
    }
}

impl Sub for V3 {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        v3(self.x - o.x, self.y - o.y, self.z - o.z)
    }
}

impl Mul<f32> for V3 {
    type Output = Self;
    #[inline(always)]
    fn mul(self, s: f32) -> Self {
        v3(self.x * s, self.y * s, self.z * s)
    }
}

impl Neg for V3 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        v3(-self.x, -self.y, -self.z)
    }
}

impl AddAssign for V3 {
    #[inline(always)]
    fn add_assign(&mut self, o: Self) {
        *self = *self + o;
    }
}

impl SubAssign for V3 {
    #[inline(always)]
    fn sub_assign(&mut self, o: Self) {
        *self = *self - o;
    }
}
