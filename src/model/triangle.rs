//! Points of triangles that rays hit, and how they move.

use super::V3;

/// Weights of a triangle's corners in a point of its plane. No length is squared, so that triangles may be
/// tiny and huge.
#[inline(always)]
pub(crate) fn barycentric(corners: [V3; 3], normal: V3, area: f32, point: V3) -> [f32; 3] {
    let ab = corners[1] - corners[0];
    let ac = corners[2] - corners[0];
    let from_a = point - corners[0];
    let inverse = 0.5 / area;
    let b = from_a.cross(ac).dot(normal) * inverse;
    let c = ab.cross(from_a).dot(normal) * inverse;
    [1.0 - b - c, b, c]
}

/// ∂/∂point of the weights of the second and third corner.
#[inline(always)]
pub(crate) fn barycentric_slopes(corners: [V3; 3], normal: V3, area: f32) -> [V3; 2] {
    let ab = corners[1] - corners[0];
    let ac = corners[2] - corners[0];
    let inverse = 0.5 / area;
    [ac.cross(normal) * inverse, normal.cross(ab) * inverse]
}

/// The weighted sum of the corners.
#[inline(always)]
pub(crate) fn at(corners: [V3; 3], weights: [f32; 3]) -> V3 {
    corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2]
}

/// The solid angle under which a point sees a triangle, negative from behind (Van Oosterom and Strackee
/// 1983).
#[inline(always)]
pub(crate) fn solid_angle(corners: [V3; 3], from: V3) -> f32 {
    let a = corners[0] - from;
    let b = corners[1] - from;
    let c = corners[2] - from;
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    // Seen from the front corners run counter-clockwise, and the triple product is negative.
    -2.0 * a.dot(b.cross(c)).atan2(below)
}

/// The derivative of the hit point o + t·d of a ray with a plane, at fixed weights of the corners: the
/// part of g that moves with the plane. n·d dt = n·(Σ wᵢ dvᵢ − do − t dd), so corner i takes wᵢ times
/// it, the ray's origin g less it, and its direction t times the same.
#[inline(always)]
pub(crate) fn hit_backward(normal: V3, direction: V3, g: V3) -> V3 {
    normal * (g.dot(direction) / normal.dot(direction))
}
