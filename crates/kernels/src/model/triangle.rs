//! Triangles: barycentric weights, hit points of rays, and derivatives of both.

use super::frame::arc_tangent_of;
use super::lists::vector;
use super::{Pair, V2, V3, v2, v3};
use crate::cube::*;

/// A triangle in internal coordinates, at shutter open.
#[apply(zeroed!)]
pub struct Triangle {
    pub a: V3,
    pub b: V3,
    pub c: V3,
    /// Unit normal of the front side.
    pub normal: V3,
    /// normal · corner.
    pub offset: f32,
    pub area: f32,
}

/// The plane of a triangle.
#[apply(zeroed!)]
pub struct Plane {
    pub normal: V3,
    pub offset: f32,
}

/// Number of floats of a triangle in a list, in the order of its fields, and the offsets of its plane and its area.
pub const NUMBERS: usize = 14;
const PLANE: usize = 9;
pub const AREA: usize = 13;

/// Reads triangle `k` from a list.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn triangle_at(triangles: &[f32], k: u32) -> Triangle {
    let list = &triangles[NUMBERS * k as usize..];
    // The last index first, so that the host checks bounds once.
    let area = list[AREA];
    Triangle {
        a: vector(list, 0u32),
        b: vector(list, 3u32),
        c: vector(list, 6u32),
        normal: vector(list, 9u32),
        offset: list[12],
        area,
    }
}

/// Returns whether rays can hit a triangle of this area: it is neither infinite nor so small that it has no inverse.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn has_area(area: f32) -> bool {
    area > 1e-35 && area <= f32::MAX
}

/// Reads the plane of triangle `k` from a list.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn plane_at(triangles: &[f32], k: u32) -> Plane {
    let at = NUMBERS * k as usize + PLANE;
    // The last index first, as above.
    let offset = triangles[at + 3];
    Plane {
        normal: vector(triangles, at as u32),
        offset,
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Plane {
    /// Returns the signed distance of a point from the plane.
    #[inline(always)]
    pub fn above(&self, point: V3) -> f32 {
        self.normal.dot(point) - self.offset
    }
}

impl Triangle {
    pub fn corners(&self) -> [V3; 3] {
        [self.a, self.b, self.c]
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Triangle {
    /// Returns the triangle translated by a vector.
    #[inline(always)]
    pub fn moved(&self, shift: V3) -> Triangle {
        Triangle {
            a: self.a + shift,
            b: self.b + shift,
            c: self.c + shift,
            normal: self.normal,
            offset: self.offset + self.normal.dot(shift),
            area: self.area,
        }
    }

    /// Returns the barycentric weights of a point of the triangle's plane.
    #[inline(always)]
    pub fn weights(&self, at_rest: V3) -> V3 {
        weights_at(self.a, self.b, self.c, self.normal, self.area, at_rest)
    }

    /// Returns the derivatives with respect to the point of the weights of the second and third corner.
    #[inline(always)]
    pub fn slopes(&self) -> Pair {
        let inverse = 0.5 / self.area;
        Pair {
            first: (self.c - self.a).cross(self.normal) * inverse,
            second: self.normal.cross(self.b - self.a) * inverse,
        }
    }

    /// Turns derivatives with respect to normal and area into those with respect to b − a and c − a.
    #[inline(always)]
    pub fn sides_backward(&self, by_normal: V3, by_area: f32) -> Pair {
        let across = by_normal.reject_from_normalized(self.normal);
        let ab = self.b - self.a;
        let ac = self.c - self.a;
        // Lengths are multiplied before the division by the area, which may be tiny.
        let per_area = 0.5 / self.area;
        Pair {
            first: ac.cross(across) * per_area + ac.cross(self.normal) * (0.5 * by_area),
            second: across.cross(ab) * per_area + self.normal.cross(ab) * (0.5 * by_area),
        }
    }

    #[inline(always)]
    pub fn plane(&self) -> Plane {
        Plane {
            normal: self.normal,
            offset: self.offset,
        }
    }

    /// Returns the signed distance of a point from the triangle's plane.
    #[inline(always)]
    pub fn above(&self, point: V3) -> f32 {
        self.plane().above(point)
    }
}

/// Returns the barycentric weights of a point of a triangle's plane. No length is squared, so triangles may be tiny
/// or huge.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn weights_at(a: V3, b: V3, c: V3, normal: V3, area: f32, point: V3) -> V3 {
    let ab = b - a;
    let ac = c - a;
    let from_a = point - a;
    let inverse = 0.5 / area;
    let second = from_a.cross(ac).dot(normal) * inverse;
    let third = ab.cross(from_a).dot(normal) * inverse;
    v3(1.0 - second - third, second, third)
}

/// Returns the solid angle of a triangle seen from a point, negative from behind (Van Oosterom and Strackee 1983).
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn solid_angle(first: V3, second: V3, third: V3, from: V3) -> f32 {
    let a = first - from;
    let b = second - from;
    let c = third - from;
    let la = a.length();
    let lb = b.length();
    let lc = c.length();
    let below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    // Seen from the front, the corners run counterclockwise and the triple product is negative.
    -2.0f32 * arc_tangent_of(a.dot(b.cross(c)), below)
}

/// Returns the part of g that moves with the plane: the backward pass of the hit point o + t·d of a ray with a plane.
///
/// From n·d dt = n·(Σ wᵢ dvᵢ − do − t dd), at fixed weights wᵢ, follow the derivatives: corner i receives wᵢ times
/// this vector, the ray origin g minus it, and the ray direction t times the derivative of the origin.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn hit_backward(normal: V3, direction: V3, g: V3) -> V3 {
    normal * (g.dot(direction) / normal.dot(direction))
}

/// Maps two uniform numbers to barycentric weights of the second and third corner, with density 1/area.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn uniform_point(u: f32, v: f32) -> V2 {
    let root = u.sqrt();
    v2(root * (1.0 - v), root * v)
}

/// Returns the weighted sum of the corners.
#[cfg(test)]
pub fn at(corners: [V3; 3], weights: [f32; 3]) -> V3 {
    corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::v3;

    const CORNERS: [V3; 3] = [v3(0.2, -0.3, 1.2), v3(1.3, -0.2, 2.1), v3(0.4, 1.1, 1.5)];
    const STEPS: [V3; 3] = V3::AXES;

    fn triangle() -> Triangle {
        let [a, b, c] = CORNERS;
        let cross = (b - a).cross(c - a);
        let (normal, area) = (cross.normalize(), 0.5 * cross.length());
        let offset = normal.dot(a);
        Triangle {
            a,
            b,
            c,
            normal,
            offset,
            area,
        }
    }

    #[test]
    fn weights_of_corners_and_their_derivatives() {
        let weights = |p: V3| triangle().weights(p).to_array();
        let p = at(CORNERS, [0.2, 0.5, 0.3]);
        let found = weights(p);
        for (found, wanted) in found.into_iter().zip([0.2, 0.5, 0.3]) {
            assert!((found - wanted).abs() < 1e-6);
        }
        let slopes = triangle().slopes();
        let slopes = [slopes.first, slopes.second];
        for step in STEPS {
            let (up, down) = (weights(p + step * 0.1), weights(p - step * 0.1));
            for k in 0..2 {
                let wanted = (up[k + 1] - down[k + 1]) / 0.2;
                assert!((slopes[k].dot(step) - wanted).abs() < 1e-4, "{wanted}");
            }
        }
    }

    /// An octant of the sphere, from the front and from behind.
    #[test]
    fn solid_angles() {
        let eighth = std::f32::consts::FRAC_PI_2;
        let [x, y, z] = V3::AXES;
        assert!((solid_angle(x, y, z, V3::ZERO) + eighth).abs() < 1e-6);
        assert!((solid_angle(x, z, y, V3::ZERO) - eighth).abs() < 1e-6);
    }

    /// Derivatives of the hit point with respect to the plane's corners, the ray origin and the ray direction.
    #[test]
    fn derivatives_of_hits() {
        let (origin, direction) = (v3(0.4, 0.1, -0.3), v3(0.1, 0.05, 1.0));
        let g = v3(0.3, -0.7, 0.5);
        let hit = |corners: [V3; 3], origin: V3, direction: V3| {
            let n = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            let t = n.dot(corners[0] - origin) / n.dot(direction);
            (origin + direction * t, t)
        };
        let (point, t) = hit(CORNERS, origin, direction);
        let weights = triangle().weights(point).to_array();
        let with_plane = hit_backward(triangle().normal, direction, g);
        let h = 1e-2;
        for step in STEPS {
            let slope = |f: &dyn Fn(V3) -> V3| g.dot(f(step * h) - f(step * -h)) / (2.0 * h);
            for k in 0..3 {
                let by_corner = slope(&|d| {
                    let mut corners = CORNERS;
                    corners[k] += d;
                    hit(corners, origin, direction).0
                });
                assert!((with_plane.dot(step) * weights[k] - by_corner).abs() < 2e-3);
            }
            let by_ray = (g - with_plane).dot(step);
            let by_origin = slope(&|d| hit(CORNERS, origin + d, direction).0);
            assert!((by_ray - by_origin).abs() < 1e-3, "{by_origin}");
            let by_direction = slope(&|d| hit(CORNERS, origin, direction + d).0);
            assert!((by_ray * t - by_direction).abs() < 2e-3, "{by_direction}");
        }
    }
}
