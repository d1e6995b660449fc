//! Shading normals tilted by a texel of a normal map.

use super::{V3, splat};
use crate::cube::*;

/// Vectors shorter than this have no direction.
const TINY: f32 = 1e-15;

/// The tilt of a normal N by a texel (x, y, z): N' ∝ x·T + y·B + z·N. T is the normalized component of the tangent
/// perpendicular to N, and B = ±N × T. N stays unchanged if there is no such component, or if the texel is 0.
#[apply(record!)]
pub struct Tilt {
    /// N, of unit length.
    pub normal: V3,
    /// Of any length and direction.
    pub tangent: V3,
    /// Sign of the bitangent, 1 or −1.
    pub side: f32,
    pub texel: V3,
}

/// Derivatives with respect to the fields of [`Tilt`].
#[apply(record!)]
pub struct TiltGradient {
    pub normal: V3,
    pub tangent: V3,
    pub texel: V3,
}

#[cfg_attr(feature = "gpu", cube)]
impl Tilt {
    /// Returns the component of the tangent perpendicular to the normal.
    #[inline(always)]
    fn across(&self) -> V3 {
        self.tangent - self.normal * self.normal.dot(self.tangent)
    }

    /// Returns the tilted normal before normalization, for T of unit length.
    #[inline(always)]
    fn sum(&self, tangent: V3) -> V3 {
        let bitangent = self.normal.cross(tangent) * self.side;
        tangent * self.texel.x + bitangent * self.texel.y + self.normal * self.texel.z
    }

    /// Returns N', of unit length.
    #[inline(always)]
    pub fn tilted(&self) -> V3 {
        let across = self.across();
        let length = across.length();
        let mut tilted = self.normal;
        if length > TINY {
            let sum = self.sum(across * (1.0 / length));
            let size = sum.length();
            if size > TINY {
                tilted = sum * (1.0 / size);
            }
        }
        tilted
    }

    /// Returns the derivatives of g·N'.
    #[inline(always)]
    pub fn backward(&self, g: V3) -> TiltGradient {
        let across = self.across();
        let length = across.length();
        let mut by = TiltGradient {
            normal: g,
            tangent: splat(0.0),
            texel: splat(0.0),
        };
        if length > TINY {
            let tangent = across * (1.0 / length);
            let sum = self.sum(tangent);
            let size = sum.length();
            if size > TINY {
                let tilted = sum * (1.0 / size);
                let by_sum = (g - tilted * tilted.dot(g)) * (1.0 / size);
                let x = self.texel.x;
                let y = self.texel.y * self.side;
                by.texel.x = by_sum.dot(tangent);
                by.texel.y = by_sum.dot(self.normal.cross(tangent)) * self.side;
                by.texel.z = by_sum.dot(self.normal);
                let by_tangent = by_sum * x + by_sum.cross(self.normal) * y;
                let along = tangent * tangent.dot(by_tangent);
                let by_across = (by_tangent - along) * (1.0 / length);
                let up = self.normal.dot(by_across);
                by.tangent = by_across - self.normal * up;
                by.normal = by_sum * self.texel.z + tangent.cross(by_sum) * y
                    - by_across * self.normal.dot(self.tangent)
                    - self.tangent * up;
            }
        }
        by
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::v3;

    fn tilt() -> Tilt {
        Tilt {
            normal: v3(0.3, -0.5, 0.8).normalize(),
            tangent: v3(0.9, 0.4, -0.3),
            side: -1.0,
            texel: v3(0.4, -0.3, 0.7),
        }
    }

    #[test]
    fn a_flat_texel_changes_nothing() {
        let mut flat = tilt();
        flat.texel = v3(0.0, 0.0, 0.7);
        assert!((flat.tilted() - flat.normal).length() < 1e-6);
        let lost = Tilt {
            tangent: flat.normal * 2.0,
            texel: v3(1.0, 0.0, 0.0),
            ..flat
        };
        assert!(lost.tilted().dot(flat.normal) <= 1.0 + 1e-6);
        let none = Tilt {
            tangent: V3::ZERO,
            ..tilt()
        };
        assert_eq!(none.tilted(), none.normal);
    }

    /// Red tilts toward the tangent, green toward ±N × T.
    #[test]
    fn texels_are_parts_along_an_orthonormal_frame() {
        let t = Tilt {
            normal: v3(0.0, 0.0, 1.0),
            tangent: v3(2.0, 0.0, 0.7),
            side: 1.0,
            texel: v3(0.6, 0.0, 0.8),
        };
        assert!((t.tilted() - v3(0.6, 0.0, 0.8)).length() < 1e-6);
        let up = Tilt {
            texel: v3(0.0, 0.6, 0.8),
            ..t
        };
        assert!((up.tilted() - v3(0.0, 0.6, 0.8)).length() < 1e-6);
        let other = Tilt { side: -1.0, ..up };
        assert!((other.tilted() - v3(0.0, -0.6, 0.8)).length() < 1e-6);
    }

    #[test]
    fn derivatives_of_tilted_normals() {
        let g = v3(0.3, -0.8, 0.5);
        let t = tilt();
        let by = t.backward(g);
        let h = 1e-3;
        let slope = |change: &dyn Fn(&mut Tilt, f32)| {
            let at = |h: f32| {
                let mut t = t;
                change(&mut t, h);
                g.dot(t.tilted())
            };
            (at(h) - at(-h)) / (2.0 * h)
        };
        for axis in V3::AXES {
            let wanted = slope(&|t, h| t.texel += axis * h);
            assert!(
                (by.texel.dot(axis) - wanted).abs() < 2e-3,
                "{by:?} {wanted}"
            );
            let wanted = slope(&|t, h| t.tangent += axis * h);
            assert!(
                (by.tangent.dot(axis) - wanted).abs() < 2e-3,
                "{by:?} {wanted}"
            );
            let wanted = slope(&|t, h| t.normal += axis * h);
            assert!(
                (by.normal.dot(axis) - wanted).abs() < 2e-3,
                "{by:?} {wanted}"
            );
        }
    }
}
