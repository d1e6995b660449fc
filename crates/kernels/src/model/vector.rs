//! Vectors. The formulas of `model` are written in the subset of Rust that the kernel language supports: plain
//! structs, no early returns, no closures.

#![allow(
    clippy::should_implement_trait,
    reason = "CubeCL resolves operators by the methods `add`, `sub`, `mul` and `neg`"
)]

use std::ops::{Add, AddAssign, Mul, MulAssign, Neg, Sub, SubAssign};

use glam::DVec3;

use crate::cube::*;

/// A point, direction or color.
#[apply(zeroed!)]
#[derive(PartialEq)]
pub struct V3 {
    pub x: f32,
    pub y: f32,
    pub z: f32,
}

/// A point or direction in a plane.
#[apply(zeroed!)]
#[derive(PartialEq)]
pub struct V2 {
    pub x: f32,
    pub y: f32,
}

/// Four numbers.
#[apply(zeroed!)]
#[derive(PartialEq)]
pub struct Four {
    pub x: f32,
    pub y: f32,
    pub z: f32,
    pub w: f32,
}

#[cfg_attr(feature = "gpu", cube)]
impl Four {
    /// Returns the first three numbers.
    #[inline(always)]
    pub fn vector(self) -> V3 {
        v3(self.x, self.y, self.z)
    }
}

/// Two vectors.
#[apply(zeroed!)]
#[derive(PartialEq)]
pub struct Pair {
    pub first: V3,
    pub second: V3,
}

/// Makes a vector from its components.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub const fn v2(x: f32, y: f32) -> V2 {
    V2 { x, y }
}

/// Makes a vector from its components.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub const fn v3(x: f32, y: f32, z: f32) -> V3 {
    V3 { x, y, z }
}

/// Returns `a` if the condition holds, otherwise `b`, without a branch.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn select_vector(condition: bool, a: V3, b: V3) -> V3 {
    v3(
        select(condition, a.x, b.x),
        select(condition, a.y, b.y),
        select(condition, a.z, b.z),
    )
}

/// Returns a vector of three equal components.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub const fn splat(x: f32) -> V3 {
    V3 { x, y: x, z: x }
}

impl V3 {
    pub const ZERO: Self = splat(0.0);
    pub const ONE: Self = splat(1.0);

    #[cfg(test)]
    pub const AXES: [Self; 3] = [v3(1.0, 0.0, 0.0), v3(0.0, 1.0, 0.0), v3(0.0, 0.0, 1.0)];

    pub fn to_array(self) -> [f32; 3] {
        [self.x, self.y, self.z]
    }

    pub fn as_dvec3(self) -> DVec3 {
        DVec3::new(self.x.into(), self.y.into(), self.z.into())
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl V3 {
    #[inline(always)]
    pub fn add(self, o: V3) -> V3 {
        v3(self.x + o.x, self.y + o.y, self.z + o.z)
    }

    #[inline(always)]
    pub fn sub(self, o: V3) -> V3 {
        v3(self.x - o.x, self.y - o.y, self.z - o.z)
    }

    #[inline(always)]
    pub fn mul(self, s: f32) -> V3 {
        v3(self.x * s, self.y * s, self.z * s)
    }

    #[inline(always)]
    pub fn neg(self) -> V3 {
        v3(-self.x, -self.y, -self.z)
    }

    #[inline(always)]
    pub fn add_assign(&mut self, o: V3) {
        self.x += o.x;
        self.y += o.y;
        self.z += o.z;
    }

    #[inline(always)]
    pub fn sub_assign(&mut self, o: V3) {
        self.x -= o.x;
        self.y -= o.y;
        self.z -= o.z;
    }

    #[inline(always)]
    pub fn dot(self, o: V3) -> f32 {
        self.x * o.x + self.y * o.y + self.z * o.z
    }

    #[inline(always)]
    pub fn cross(self, o: V3) -> V3 {
        v3(
            self.y * o.z - self.z * o.y,
            self.z * o.x - self.x * o.z,
            self.x * o.y - self.y * o.x,
        )
    }

    /// Returns the componentwise product.
    #[inline(always)]
    pub fn times(self, o: V3) -> V3 {
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

    /// Returns the unit vector in its direction; not finite for a vector of length 0.
    #[inline(always)]
    pub fn normalize(self) -> V3 {
        self * (1.0 / self.length())
    }

    /// Returns the component perpendicular to a unit vector.
    #[inline(always)]
    pub fn reject_from_normalized(self, unit: V3) -> V3 {
        self - unit * self.dot(unit)
    }

    /// Returns the componentwise minimum.
    #[inline(always)]
    pub fn min(self, o: V3) -> V3 {
        v3(min(self.x, o.x), min(self.y, o.y), min(self.z, o.z))
    }

    /// Returns the componentwise maximum.
    #[inline(always)]
    pub fn max(self, o: V3) -> V3 {
        v3(max(self.x, o.x), max(self.y, o.y), max(self.z, o.z))
    }

    /// Returns the sum of the components.
    #[inline(always)]
    pub fn element_sum(self) -> f32 {
        self.x + self.y + self.z
    }

    /// Returns the largest component.
    #[inline(always)]
    pub fn max_element(self) -> f32 {
        max(max(self.x, self.y), self.z)
    }

    #[inline(always)]
    pub fn abs(self) -> V3 {
        v3(self.x.abs(), self.y.abs(), self.z.abs())
    }

    #[inline(always)]
    pub fn is_zero(self) -> bool {
        self.x == 0.0 && self.y == 0.0 && self.z == 0.0
    }
}

/// Returns component `k` of a vector.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn component(v: V3, k: u32) -> f32 {
    let mut found = v.x;
    if k == 1 {
        found = v.y;
    } else if k == 2 {
        found = v.z;
    }
    found
}

impl From<[f32; 3]> for V3 {
    #[inline(always)]
    fn from([x, y, z]: [f32; 3]) -> Self {
        v3(x, y, z)
    }
}

impl From<DVec3> for V3 {
    fn from(v: DVec3) -> Self {
        v.as_vec3().into()
    }
}

impl From<V3> for DVec3 {
    fn from(v: V3) -> Self {
        v.as_dvec3()
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
        V3::add(self, o)
    }
}

impl Sub for V3 {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        V3::sub(self, o)
    }
}

impl Mul<f32> for V3 {
    type Output = Self;
    #[inline(always)]
    fn mul(self, s: f32) -> Self {
        V3::mul(self, s)
    }
}

impl Mul for V3 {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        self.times(o)
    }
}

impl MulAssign<f32> for V3 {
    #[inline(always)]
    fn mul_assign(&mut self, s: f32) {
        *self = *self * s;
    }
}

impl Neg for V3 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        V3::neg(self)
    }
}

impl AddAssign for V3 {
    #[inline(always)]
    fn add_assign(&mut self, o: Self) {
        V3::add_assign(self, o);
    }
}

impl SubAssign for V3 {
    #[inline(always)]
    fn sub_assign(&mut self, o: Self) {
        V3::sub_assign(self, o);
    }
}
