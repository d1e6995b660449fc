//! Triangles on the host, in f64.

use glam::{DVec3, Vec3A};
use obvhs::aabb::Aabb;

/// A triangle with its frame: corner a at the origin, b at (base, 0), c at (apex_u, apex_v).
#[derive(Clone, Debug)]
pub struct HostTriangle {
    pub corners: [DVec3; 3],
    /// Unit normal, counter-clockwise front.
    pub normal: DVec3,
    u: DVec3,
    v: DVec3,
    base: f64,
    apex_u: f64,
    apex_v: f64,
    /// Lines of the borders b → c and c → a (`borders`).
    lines: ([f64; 3], [f64; 2]),
    /// The inverse squared length of a → b, and the inverse of apex_v.
    inverse: [f64; 2],
    /// Displacement over the shutter.
    pub velocity: DVec3,
    /// Whether it has area.
    pub valid: bool,
}

impl HostTriangle {
    pub fn new(corners: [DVec3; 3], velocity: DVec3, valid: bool) -> Self {
        let [a, b, c] = corners;
        let (ab, ac) = (b - a, c - a);
        let n = ab.cross(ac);
        let doubled = n.length();
        let base = ab.length();
        let (normal, u) = (n / doubled, ab / base);
        let v = normal.cross(u);
        let (apex_u, apex_v) = (u.dot(ac), doubled / base);
        Self {
            corners,
            normal,
            u,
            v,
            base,
            apex_u,
            apex_v,
            lines: borders(base, apex_u, apex_v),
            inverse: [base.powi(-2), apex_v.recip()],
            velocity,
            valid: valid && doubled > 0.0,
        }
    }

    /// The lines of the borders a → b, b → c and c → a in its plane: across and an offset, so that a
    /// point's distance across + offset is positive inside.
    pub(super) fn lines_in_space(&self) -> [(DVec3, f64); 3] {
        let ([q, r, s], [v, w]) = self.lines;
        let a = self.corners[0];
        [
            (self.v, 0.0),
            (self.u * q + self.v * r, s),
            (self.u * v + self.v * w, 0.0),
        ]
        .map(|(across, offset)| (across, offset - across.dot(a)))
    }

    /// The distance of a point of its plane from the nearest line of its border, positive inside.
    pub fn distance_to_lines(&self, point: DVec3) -> f64 {
        let distance = |(across, offset): (DVec3, f64)| across.dot(point) + offset;
        let lines = self.lines_in_space().map(distance);
        lines[0].min(lines[1]).min(lines[2])
    }

    /// Weights of the corners in a point of its plane.
    pub(super) fn weights(&self, point: DVec3) -> [f64; 3] {
        let at = point - self.corners[0];
        let (x, y) = (self.u.dot(at), self.v.dot(at));
        let [by_ab, by_apex] = self.inverse;
        let c = y * by_apex;
        let b = (x - c * self.apex_u) * self.base * by_ab;
        [1.0 - b - c, b, c]
    }

    /// Its box over the shutter.
    pub(super) fn swept(&self) -> Aabb {
        let mut aabb = Aabb::INVALID;
        for corner in self.corners {
            aabb.extend(Vec3A::from(corner.as_vec3()));
            aabb.extend(Vec3A::from((corner + self.velocity).as_vec3()));
        }
        aabb
    }

    pub fn area(&self) -> f64 {
        if self.valid {
            0.5 * self.base * self.apex_v
        } else {
            0.0
        }
    }
}

/// The lines of the borders b → c and c → a in a triangle's frame.
fn borders(base: f64, apex_u: f64, apex_v: f64) -> ([f64; 3], [f64; 2]) {
    let fu = apex_u - base;
    let length = fu.hypot(apex_v);
    let bc = [-apex_v / length, fu / length, apex_v * base / length];
    let length = apex_u.hypot(apex_v);
    (bc, [apex_v / length, -apex_u / length])
}
