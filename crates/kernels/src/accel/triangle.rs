//! Triangles on the host, in f64.

use glam::{DVec3, Vec3A};
use obvhs::aabb::Aabb;

/// A triangle that is displaced over the shutter.
#[derive(Clone, Debug)]
pub struct HostTriangle {
    pub corners: [DVec3; 3],
    /// The unit normal; the front is the side from which the corners are counter-clockwise.
    pub normal: DVec3,
    /// The displacement over the shutter.
    pub velocity: DVec3,
    /// Whether it has area.
    pub valid: bool,
}

impl HostTriangle {
    pub fn new(corners: [DVec3; 3], velocity: DVec3, valid: bool) -> Self {
        let [a, b, c] = corners;
        let across = (b - a).cross(c - a);
        let doubled = across.length();
        Self {
            corners,
            normal: across / doubled,
            velocity,
            valid: valid && doubled > 0.0,
        }
    }

    /// Returns the lines of the borders a → b, b → c and c → a in its plane, each as a vector `across` and an offset.
    /// The distance of a point from a line is across · point + offset, positive inside.
    pub(super) fn lines_in_space(&self) -> [(DVec3, f64); 3] {
        [0, 1, 2].map(|i| {
            let (from, to) = (self.corners[i], self.corners[(i + 1) % 3]);
            let across = self.normal.cross(to - from);
            let across = across * across.length().recip();
            (across, -across.dot(from))
        })
    }

    /// Returns the distance of a point in its plane from the nearest border line, positive inside.
    pub fn distance_to_lines(&self, point: DVec3) -> f64 {
        let distance = |(across, offset): (DVec3, f64)| across.dot(point) + offset;
        let lines = self.lines_in_space().map(distance);
        lines[0].min(lines[1]).min(lines[2])
    }

    /// Returns twice the area of a triangle in its plane, negative if that triangle is clockwise.
    fn doubled(&self, [a, b, c]: [DVec3; 3]) -> f64 {
        self.normal.dot((b - a).cross(c - a))
    }

    /// Returns the weights of the corners at a point in its plane.
    pub(super) fn weights(&self, point: DVec3) -> [f64; 3] {
        let [a, b, c] = self.corners;
        let all = self.doubled([a, b, c]);
        let (b, c) = (
            self.doubled([a, point, c]) / all,
            self.doubled([a, b, point]) / all,
        );
        [1.0 - b - c, b, c]
    }

    /// Returns its bounding box over the shutter.
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
            0.5 * self.doubled(self.corners)
        } else {
            0.0
        }
    }
}
