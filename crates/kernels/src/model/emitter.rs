//! Light from area emitters: front hits, geometry terms, and MIS of two strategies.

use super::triangle::weights_at;
use super::{V2, V3, v2};
use crate::cube::*;

/// Rays closer to parallel with an emitter than this cosine do not hit it.
const GRAZING: f32 = 1e-6;

/// The point at which a ray hits the front of an emitter, regardless of occluders: its distance, not positive if
/// there is no hit, and the barycentric weights of corners b and c.
#[apply(record!)]
pub struct FrontHit {
    pub distance: f32,
    pub weights: V2,
}

/// Intersects a ray from x with the front of a triangle.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn hit_front(a: V3, b: V3, c: V3, normal: V3, area: f32, x: V3, direction: V3) -> FrontHit {
    let mut found = FrontHit {
        distance: 0.0f32.runtime(),
        weights: v2(0.0, 0.0),
    };
    let cosine = normal.dot(direction);
    if cosine < -GRAZING {
        let t = normal.dot(a - x) / cosine;
        if t > 0.0 {
            let w = weights_at(a, b, c, normal, area, x + direction * t);
            if w.x >= 0.0 && w.y >= 0.0 && w.z >= 0.0 {
                found.distance = t;
                found.weights = v2(w.y, w.z);
            }
        }
    }
    found
}

/// A point of an emitter as seen from a surface point.
#[apply(record!)]
pub struct LightPoint {
    /// The unit vector from the surface point to the emitter's point.
    pub direction: V3,
    pub distance: f32,
    squared: f32,
    /// cos θ at the light.
    pub facing: f32,
}

/// Derivatives with respect to a point of an emitter, its normal and its area. The derivative with respect to the
/// point that sees it is −`position`.
#[apply(record!)]
pub struct LightGradient {
    pub position: V3,
    pub normal: V3,
    pub area: f32,
}

#[cfg_attr(feature = "gpu", cube)]
impl LightPoint {
    /// Makes the point from the vector to it and the normal of the emitter's front.
    #[inline(always)]
    pub fn new(to: V3, normal: V3) -> LightPoint {
        let squared = max(to.length_squared(), 1e-37);
        let distance = squared.sqrt();
        let direction = to * (1.0 / distance);
        LightPoint {
            direction,
            distance,
            squared,
            facing: -normal.dot(direction),
        }
    }

    /// Returns cos θ·area/r²: the solid angle of an area all of whose points are seen like this one.
    #[inline(always)]
    pub fn solid_angle(&self, area: f32) -> f32 {
        self.facing / self.squared * area
    }

    /// Turns derivatives with respect to the solid angle and the direction into those with respect to the emitter.
    #[inline(always)]
    pub fn backward(
        &self,
        normal: V3,
        area: f32,
        by_angle: f32,
        by_direction: V3,
    ) -> LightGradient {
        let by_facing = by_angle * area / self.squared;
        let towards = by_direction - normal * by_facing;
        // The normalization of the direction, and r².
        let mut by_to = towards.reject_from_normalized(self.direction);
        by_to -= self.direction * (2.0 * by_facing * self.facing);
        LightGradient {
            position: by_to * (1.0 / self.distance),
            normal: self.direction * (-by_facing),
            area: by_angle * self.facing / self.squared,
        }
    }
}

/// Returns the divisor of a sample if two strategies with densities a and b are combined by the power heuristic
/// (Veach and Guibas 1995): the weight w₁ = p₁²/(p₁² + p₂²) makes the divisor (p₁² + p₂²)/p₁.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn power_heuristic(a: f32, b: f32, is_b: bool) -> f32 {
    let mut own = a;
    if is_b {
        own = b;
    }
    (a * a + b * b) / max(own, 1e-20)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::triangle::{at, solid_angle, uniform_point};
    use crate::model::v3;

    /// The weights of both strategies, density over divisor, sum to 1.
    #[test]
    fn weights_of_both_strategies() {
        for (a, b) in [(0.3, 0.7), (2.0, 0.0), (1e-3, 5.0)] {
            let sum = a / power_heuristic(a, b, false) + b / power_heuristic(a, b, true);
            assert!((sum - 1.0).abs() < 1e-6, "{a} {b}: {sum}");
        }
    }

    const CORNERS: [V3; 3] = [v3(0.2, -0.3, 1.2), v3(0.4, 1.1, 1.5), v3(1.3, -0.2, 2.1)];

    /// Points of an emitter have the density 1/area: the mean of their solid angles is that of the triangle.
    #[test]
    fn solid_angle_by_sampled_points() {
        let [a, b, c] = CORNERS;
        let cross = (b - a).cross(c - a);
        let (n, mut mean) = (200, 0.0);
        for i in 0..n * n {
            let [u, v] = [i % n, i / n].map(|i| (i as f32 + 0.5) / n as f32);
            let on = uniform_point(u, v);
            let (b, c) = (on.x, on.y);
            let point = at(CORNERS, [1.0 - b - c, b, c]);
            let seen = LightPoint::new(point, cross.normalize());
            mean += f64::from(seen.solid_angle(0.5 * cross.length())) / f64::from(n * n);
        }
        let wanted = f64::from(solid_angle(CORNERS[0], CORNERS[1], CORNERS[2], V3::ZERO));
        assert!((mean / wanted - 1.0).abs() < 1e-3, "{mean} {wanted}");
    }

    #[test]
    fn derivatives_of_a_point() {
        let (to, normal, area) = (v3(0.5, 0.2, 1.4), v3(0.2, -0.1, -1.0).normalize(), 0.7);
        let (by_angle, by_direction) = (0.8, v3(-0.3, 0.6, 0.2));
        let value = |to: V3, normal: V3, area: f32| {
            let seen = LightPoint::new(to, normal);
            by_angle * seen.solid_angle(area) + by_direction.dot(seen.direction)
        };
        let seen = LightPoint::new(to, normal);
        let found = seen.backward(normal, area, by_angle, by_direction);
        let h = 1e-2;
        for step in V3::AXES {
            let d = step * h;
            let by_to = (value(to + d, normal, area) - value(to - d, normal, area)) / (2.0 * h);
            assert!((found.position.dot(step) - by_to).abs() < 1e-3, "{by_to}");
            let by_normal = (value(to, normal + d, area) - value(to, normal - d, area)) / (2.0 * h);
            assert!(
                (found.normal.dot(step) - by_normal).abs() < 1e-3,
                "{by_normal}"
            );
        }
        let by_area = (value(to, normal, area + h) - value(to, normal, area - h)) / (2.0 * h);
        assert!((found.area - by_area).abs() < 1e-3, "{by_area}");
    }
}
