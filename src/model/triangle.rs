//! Points of triangles that rays hit, and how they move.

use super::frame::arc_tangent_of;
use super::{Pair, V2, V3, v2, v3};
#[cfg(feature = "wgpu")]
use crate::cube::*;

/// Weights of a triangle's corners in a point of its plane. No length is squared, so that triangles may be
/// tiny and huge.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn weights_at(a: V3, b: V3, c: V3, normal: V3, area: f32, point: V3) -> V3 {
    let ab = b - a;
    let ac = c - a;
    let from_a = point - a;
    let inverse = 0.5 / area;
    let second = from_a.cross(ac).dot(normal) * inverse;
    let third = ab.cross(from_a).dot(normal) * inverse;
    v3(1.0 - second - third, second, third)
}

/// ∂/∂point of the weights of the second and third corner.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn barycentric_slopes(a: V3, b: V3, c: V3, normal: V3, area: f32) -> Pair {
    let inverse = 0.5 / area;
    Pair {
        first: (c - a).cross(normal) * inverse,
        second: normal.cross(b - a) * inverse,
    }
}

/// The solid angle under which a point sees a triangle, negative from behind (Van Oosterom and Strackee
/// 1983).
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn solid_angle(first: V3, second: V3, third: V3, from: V3) -> f32 {
    let a = first - from;
    let b = second - from;
    let c = third - from;
    let la = a.length();
    let lb = b.length();
    let lc = c.length();
    let below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    // Seen from the front corners run counter-clockwise, and the triple product is negative.
    -2.0f32 * arc_tangent_of(a.dot(b.cross(c)), below)
}

/// The derivative of the hit point o + t·d of a ray with a plane, at fixed weights of the corners: the
/// part of g that moves with the plane. n·d dt = n·(Σ wᵢ dvᵢ − do − t dd), so corner i takes wᵢ times
/// it, the ray's origin g less it, and its direction t times the same.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn hit_backward(normal: V3, direction: V3, g: V3) -> V3 {
    normal * (g.dot(direction) / normal.dot(direction))
}
/// Weights of the second and third corner in a point of a triangle, for two uniform numbers: with the density
/// 1/area.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn uniform_point(u: f32, v: f32) -> V2 {
    let root = u.sqrt();
    v2(root * (1.0 - v), root * v)
}

/// The weighted sum of the corners.
#[cfg(test)]
pub(crate) fn at(corners: [V3; 3], weights: [f32; 3]) -> V3 {
    corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::v3;

    fn barycentric([a, b, c]: [V3; 3], normal: V3, area: f32, point: V3) -> [f32; 3] {
        weights_at(a, b, c, normal, area, point).to_array()
    }

    const CORNERS: [V3; 3] = [v3(0.2, -0.3, 1.2), v3(1.3, -0.2, 2.1), v3(0.4, 1.1, 1.5)];
    const STEPS: [V3; 3] = V3::AXES;

    fn normal_and_area() -> (V3, f32) {
        let cross = (CORNERS[1] - CORNERS[0]).cross(CORNERS[2] - CORNERS[0]);
        (cross.normalize(), 0.5 * cross.length())
    }

    #[test]
    fn weights_of_corners_and_their_derivatives() {
        let (normal, area) = normal_and_area();
        let weights = |p: V3| barycentric(CORNERS, normal, area, p);
        let p = at(CORNERS, [0.2, 0.5, 0.3]);
        let found = weights(p);
        for (found, wanted) in found.into_iter().zip([0.2, 0.5, 0.3]) {
            assert!((found - wanted).abs() < 1e-6);
        }
        let [a, b, c] = CORNERS;
        let slopes = barycentric_slopes(a, b, c, normal, area);
        let slopes = [slopes.first, slopes.second];
        for step in STEPS {
            let (up, down) = (weights(p + step * 0.1), weights(p - step * 0.1));
            for k in 0..2 {
                let wanted = (up[k + 1] - down[k + 1]) / 0.2;
                assert!((slopes[k].dot(step) - wanted).abs() < 1e-4, "{wanted}");
            }
        }
    }

    /// An eighth of the sphere, from the front and from behind.
    #[test]
    fn solid_angles() {
        let eighth = std::f32::consts::FRAC_PI_2;
        let [x, y, z] = V3::AXES;
        assert!((solid_angle(x, y, z, V3::ZERO) + eighth).abs() < 1e-6);
        assert!((solid_angle(x, z, y, V3::ZERO) - eighth).abs() < 1e-6);
    }

    /// The point where a ray hits, by the plane's corners, the ray's origin and its direction.
    #[test]
    fn derivatives_of_hits() {
        let (origin, direction) = (v3(0.4, 0.1, -0.3), v3(0.1, 0.05, 1.0));
        let g = v3(0.3, -0.7, 0.5);
        let hit = |corners: [V3; 3], origin: V3, direction: V3| {
            let n = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            let t = n.dot(corners[0] - origin) / n.dot(direction);
            (origin + direction * t, t)
        };
        let (normal, area) = normal_and_area();
        let (point, t) = hit(CORNERS, origin, direction);
        let weights = barycentric(CORNERS, normal, area, point);
        let with_plane = hit_backward(normal, direction, g);
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
