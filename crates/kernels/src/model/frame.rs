//! Local frames of directions, and trigonometric functions.

use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI, SQRT_2, TAU};

use super::{V3, v3};
use crate::cube::*;

/// Two unit vectors perpendicular to a unit axis and to each other (Duff et al. 2017, whose frames jump at z = 0; these
/// jump at z = [`TURN`]).
#[apply(record!)]
pub struct Frame {
    pub tangent: V3,
    pub bitangent: V3,
}

/// The z of axes at which frames jump. Normals of axis-aligned walls have z = 0 but for rounding, so a jump there would
/// give other paths on devices that round differently.
pub const TURN: f32 = -0.37;

/// Returns −1 for a z below [`TURN`], and otherwise 1.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn sign_of(z: f32) -> f32 {
    select(z < TURN, -1.0f32, 1.0f32)
}

#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn frame(axis: V3) -> Frame {
    let sign = sign_of(axis.z);
    let a = -1.0f32 / (axis.z + sign);
    let b = axis.x * axis.y * a;
    Frame {
        tangent: v3(1.0 + sign * axis.x * axis.x * a, sign * b, -sign * axis.x),
        bitangent: v3(b, sign + axis.y * axis.y * a, -axis.y),
    }
}

/// Rotates a local direction so that z lies along a unit axis.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn from_local(axis: V3, local: V3) -> V3 {
    let f = frame(axis);
    f.tangent * local.x + f.bitangent * local.y + axis * local.z
}

/// Returns the local coordinates of a direction in the frame of a unit axis.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn to_local(axis: V3, direction: V3) -> V3 {
    let f = frame(axis);
    v3(
        f.tangent.dot(direction),
        f.bitangent.dot(direction),
        axis.dot(direction),
    )
}

/// Derivatives with respect to the axis and the local direction.
#[apply(record!)]
pub struct FromLocalGradient {
    pub axis: V3,
    pub local: V3,
}

/// The backward pass of [`from_local`].
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn from_local_backward(axis: V3, local: V3, g: V3) -> FromLocalGradient {
    let sign = sign_of(axis.z);
    let a = -1.0f32 / (axis.z + sign);
    let t = g * local.x;
    let b = g * local.y;
    let by_b = t.y * sign + b.x;
    let by_a = t.x * sign * axis.x * axis.x + b.y * axis.y * axis.y + by_b * axis.x * axis.y;
    let by_axis = v3(
        t.x * 2.0 * sign * axis.x * a - sign * t.z + by_b * axis.y * a,
        b.y * 2.0 * axis.y * a - b.z + by_b * axis.x * a,
        by_a * a * a,
    );
    FromLocalGradient {
        axis: by_axis + g * local.z,
        local: to_local(axis, g),
    }
}

/// Sine and cosine.
#[apply(record!)]
pub struct SinCos {
    pub sin: f32,
    pub cos: f32,
}

const SIN_3: f32 = -1.0 / 6.0;
const SIN_5: f32 = 1.0 / 120.0;
const SIN_7: f32 = -1.0 / 5040.0;
const SIN_9: f32 = 1.0 / 362_880.0;
const COS_2: f32 = -0.5;
const COS_4: f32 = 1.0 / 24.0;
const COS_6: f32 = -1.0 / 720.0;
const COS_8: f32 = 1.0 / 40320.0;
const COS_10: f32 = -1.0 / 3_628_800.0;

/// Returns sine and cosine of a number of turns in [0, 1].
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn sin_cos_of_turns(v: f32) -> SinCos {
    // Reduce to the nearest quarter turn; series for the remaining angle of at most 45° are exact to rounding.
    let quarter = (4.0 * v + 0.5).floor();
    let x = (v - 0.25 * quarter) * TAU;
    let y = x * x;
    let sin = x * (1.0 + y * (SIN_3 + y * (SIN_5 + y * (SIN_7 + y * SIN_9))));
    let cos = 1.0 + y * (COS_2 + y * (COS_4 + y * (COS_6 + y * (COS_8 + y * COS_10))));
    // Bit operations: branches would be mispredicted half of the time.
    let quarter = quarter as i32;
    let odd = (-(quarter & 1)) as u32;
    let changed = (sin.to_bits() ^ cos.to_bits()) & odd;
    let first = f32::from_bits(sin.to_bits() ^ changed);
    let second = f32::from_bits(cos.to_bits() ^ changed);
    let below = (1 - (quarter & 2)) as f32;
    let behind = (1 - ((quarter + 1) & 2)) as f32;
    SinCos {
        sin: first * below,
        cos: second * behind,
    }
}

/// Returns the arctangent, accurate to rounding (Cephes).
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn arc_tangent(tangent: f32) -> f32 {
    let size = tangent.abs();
    let mut angle = 0.0f32;
    let mut x = size;
    if size > TAN_3 {
        angle = FRAC_PI_2;
        x = -1.0f32 / size;
    } else if size > TAN_1 {
        angle = FRAC_PI_4;
        x = (size - 1.0) / (size + 1.0);
    }
    let y = x * x;
    angle += x + x * y * (ATAN_3 + y * (ATAN_5 + y * (ATAN_7 + y * ATAN_9)));
    angle = select(tangent < 0.0, -angle, angle);
    angle
}

/// Returns the angle from the x axis to a point (x, y), in (−π, π]; 0 at the origin.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn arc_tangent_of(y: f32, x: f32) -> f32 {
    let mut angle = arc_tangent(y / x);
    if x < 0.0 {
        let turn = select(y < 0.0, -PI, PI);
        angle += turn;
    }
    angle = select(y == 0.0 && x == 0.0, 0.0f32, angle);
    angle
}

/// Tangents of one and three eighths of 180°.
const TAN_1: f32 = SQRT_2 - 1.0;
const TAN_3: f32 = SQRT_2 + 1.0;
const ATAN_3: f32 = -0.333_329_5;
const ATAN_5: f32 = 0.199_777_11;
const ATAN_7: f32 = -0.138_776_86;
const ATAN_9: f32 = 0.080_537_444;

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn angles_of_tangents() {
        for i in -2000..2000 {
            let angle = f64::from(i) * std::f64::consts::FRAC_PI_2 / 2000.5;
            let found = f64::from(arc_tangent(angle.tan() as f32));
            assert!((found - angle).abs() < 2e-7, "{found} {angle}");
        }
    }

    #[test]
    fn angles_of_points() {
        for i in -2000..=2000 {
            let angle = f64::from(i) * std::f64::consts::PI / 2000.5;
            let found = f64::from(arc_tangent_of(angle.sin() as f32, angle.cos() as f32));
            assert!((found - angle).abs() < 4e-7, "{found} {angle}");
        }
        assert_eq!(arc_tangent_of(0.0, 0.0), 0.0);
        assert!((arc_tangent_of(1.0, 0.0) - FRAC_PI_2).abs() < 2e-7);
        assert!((arc_tangent_of(-1.0, 0.0) + FRAC_PI_2).abs() < 2e-7);
    }

    #[test]
    fn sines_to_rounding() {
        for i in 0..=4096 {
            let v = i as f32 / 4096.0;
            let SinCos { sin, cos } = sin_cos_of_turns(v);
            let wanted = (TAU * f64::from(v)).sin_cos();
            let errors = [f64::from(sin) - wanted.0, f64::from(cos) - wanted.1];
            assert!(errors.iter().all(|e| e.abs() < 2e-7), "{v}: {errors:?}");
        }
    }

    #[test]
    fn a_local_direction_and_its_derivative() {
        for axis in [v3(0.6, 0.0, 0.8), v3(0.3, -0.5, -0.2), v3(-0.1, 0.2, -0.9)] {
            let axis = axis.normalize();
            let local = v3(0.2, -0.4, 0.7);
            let back = to_local(axis, from_local(axis, local)) - local;
            assert!(back.length() < 1e-6);
            let g = v3(0.3, 0.9, -0.5);
            let FromLocalGradient {
                axis: by_axis,
                local: by_local,
            } = from_local_backward(axis, local, g);
            let along = v3(0.4, -0.7, 0.2);
            let step = 1e-2;
            // The formula also holds off the unit sphere.
            let f = |h: f32| g.dot(from_local(axis + along * h, local));
            let wanted = (f(step) - f(-step)) / (2.0 * step);
            let got = by_axis.dot(along);
            assert!(
                (got - wanted).abs() < 5e-3 * (1.0 + wanted.abs()),
                "{got} {wanted}"
            );
            assert!((by_local - to_local(axis, g)).length() < 1e-6);
        }
    }
}
