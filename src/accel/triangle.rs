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
    /// Inverse squared lengths of the edges a → b, b → c and c → a, and of apex_v.
    inverse: [f64; 4],
    /// Displacement over the shutter.
    pub velocity: DVec3,
    /// Whether it has area.
    pub valid: bool,
}

/// The intersection of a ray with a triangle's plane.
#[derive(Clone, Copy, Debug)]
pub struct PlaneHit {
    /// Distance along the ray.
    pub t: f64,
    /// n·d.
    pub cosine: f64,
    /// Squared distance to the triangle's border.
    pub squared_distance: f64,
    /// Whether it lies inside.
    pub inside: bool,
    /// Weights of the corners in the hit point.
    pub hit: [f64; 3],
    /// Weights of the corners in the nearest point of the border.
    pub border: [f64; 3],
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
        let fu = apex_u - base;
        Self {
            corners,
            normal,
            u,
            v,
            base,
            apex_u,
            apex_v,
            lines: borders(base, apex_u, apex_v),
            inverse: [
                base.powi(-2),
                (fu * fu + apex_v * apex_v).recip(),
                (apex_u * apex_u + apex_v * apex_v).recip(),
                apex_v.recip(),
            ],
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

    /// The intersection with a ray; None where the ray is too parallel, the hit lies outside of (t_min, t_max), or further from
    /// the triangle than the root of `reach`. Of hits further inside than `deep` the nearest point of
    /// the border is not computed: a corner stands in its place.
    #[inline(always)]
    pub fn intersect(
        &self,
        origin: DVec3,
        direction: DVec3,
        grazing: f64,
        range: (f64, f64),
        (reach, deep): (f64, f64),
    ) -> Option<PlaneHit> {
        let cosine = self.normal.dot(direction);
        if cosine.abs() <= grazing || !self.valid {
            return None;
        }
        let from_a = origin - self.corners[0];
        let t = -self.normal.dot(from_a) / cosine;
        if !(t > range.0 && t < range.1) {
            return None;
        }
        let at = from_a + direction * t;
        let (x, y) = (self.u.dot(at), self.v.dot(at));
        let (base, au, av) = (self.base, self.apex_u, self.apex_v);
        let [by_ab, by_bc, by_ac, by_apex] = self.inverse;
        let c = y * by_apex;
        let b = (x - c * au) * base * by_ab;
        let hit = [1.0 - b - c, b, c];
        let ([q, r, s], [v, w]) = self.lines;
        let least = y.min(x * q + y * r + s).min(x * v + y * w);
        if least > deep {
            return Some(PlaneHit {
                t,
                cosine,
                squared_distance: least * least,
                inside: true,
                hit,
                border: [1.0, 0.0, 0.0],
            });
        }
        // The nearest points of the three edges: a → b, c → b, a → c.
        let s_ab = (x * base * by_ab).clamp(0.0, 1.0);
        let d_ab = (x - s_ab * base).powi(2) + y * y;
        let fu = au - base;
        let s_bc = (((x - base) * fu + y * av) * by_bc).clamp(0.0, 1.0);
        let d_bc = (x - base - s_bc * fu).powi(2) + (y - s_bc * av).powi(2);
        let s_ac = ((x * au + y * av) * by_ac).clamp(0.0, 1.0);
        let d_ac = (x - s_ac * au).powi(2) + (y - s_ac * av).powi(2);
        let inside = y >= 0.0 && fu * y >= av * (x - base) && av * x >= au * y;
        let (squared_distance, border) = if d_ac < d_ab.min(d_bc) {
            (d_ac, [1.0 - s_ac, 0.0, s_ac])
        } else if d_bc < d_ab {
            (d_bc, [0.0, 1.0 - s_bc, s_bc])
        } else {
            (d_ab, [1.0 - s_ab, s_ab, 0.0])
        };
        if !inside && squared_distance > reach {
            return None;
        }
        Some(PlaneHit {
            t,
            cosine,
            squared_distance,
            inside,
            hit,
            border,
        })
    }

    /// Weights of the corners in a point of its plane.
    pub(super) fn weights(&self, point: DVec3) -> [f64; 3] {
        let at = point - self.corners[0];
        let (x, y) = (self.u.dot(at), self.v.dot(at));
        let [by_ab, .., by_apex] = self.inverse;
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

    /// A weighted sum of the corners.
    #[inline(always)]
    pub fn point(&self, weights: [f64; 3]) -> DVec3 {
        let [a, b, c] = self.corners;
        a * weights[0] + b * weights[1] + c * weights[2]
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
