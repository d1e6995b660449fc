//! Rays of a cone about an axis, and the start and end of rays.

use std::f32::consts::PI;

use super::filter::disk_kernel;
use super::frame::{SinCos, frame};
use super::{V3, splat};
use crate::cube::*;

/// A ray of a cone, and its relation to the axis.
#[apply(zeroed!)]
pub struct Bend {
    /// The vector that was added to the axis, perpendicular to it.
    pub offset: V3,
    /// Whether the ray was mirrored at the surface that it leaves.
    pub mirrored: bool,
    /// The ray's direction.
    pub direction: V3,
}

/// Returns the offset, perpendicular to a unit axis, of a direction of the cone about it. `tangent` is the tangent of
/// the half-angle; axis plus offset is not yet of unit length.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn cone_offset(axis: V3, tangent: f32, u: f32, v: f32) -> V3 {
    let p = disk_kernel(u, v);
    let f = frame(axis);
    (f.tangent * p.x + f.bitangent * p.y) * tangent
}

/// Samples a ray of a cone, and mirrors it to the outer side of the surface that it leaves.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn bend(axis: V3, normal: V3, tangent: f32, u: f32, v: f32) -> Bend {
    let mut offset = splat(0.0);
    let mut mirrored = false;
    let mut direction = axis;
    if tangent != 0.0 {
        offset = cone_offset(axis, tangent, u, v);
        direction = (axis + offset).normalize();
        let along = direction.dot(normal);
        mirrored = along < 0.0;
        direction -= normal * (2.0 * min(along, 0.0));
    }
    Bend {
        offset,
        mirrored,
        direction,
    }
}

/// Returns the solid-angle density with which rays about `axis` have the direction `to`. It equals the density with
/// which rays about `to` have the direction `axis`. `tangent` must be more than 0.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn cone_density(axis: V3, to: V3, tangent: f32) -> f32 {
    let along = axis.dot(to);
    let across = to.reject_from_normalized(axis).length() / (along * tangent);
    let mut density = 0.0;
    if along > 0.0 && across < 1.0 {
        let kernel = 1.0 - across * across;
        let wide = along / to.length();
        density = 3.0 / PI * kernel * kernel / (tangent * tangent * wide * wide * wide);
    }
    density
}

/// Turns derivatives with respect to a ray of a cone into those with respect to the cone's axis, at a fixed offset.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn bend_backward(bend: &Bend, axis: V3, normal: V3, g: V3, by_normal: &mut V3) -> V3 {
    let mut by_axis = g;
    if !bend.offset.is_zero() {
        let bent = axis + bend.offset;
        let inverse = 1.0 / bent.length();
        let direction = bent * inverse;
        if bend.mirrored {
            let along = direction.dot(normal);
            let through = g.dot(normal);
            *by_normal -= g * (2.0 * along) + direction * (2.0 * through);
            by_axis -= normal * (2.0 * through);
        }
        by_axis = by_axis.reject_from_normalized(direction) * inverse;
    }
    by_axis
}

/// Returns cosine and sine of the half-angle of a cone, less than 180°, widened by an angle given by its tangent.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn widened(half: SinCos, tangent: f32) -> SinCos {
    let wide = (1.0 + tangent * tangent).sqrt();
    SinCos {
        sin: (half.sin + half.cos * tangent) / wide,
        cos: (half.cos - half.sin * tangent) / wide,
    }
}

/// Rays start this far above a surface, relative to the largest coordinate: the rounding error of points.
const LIFT: f32 = 1e-6;
/// Shadow rays end this far before the light's plane, relative to the largest coordinate.
const END: f32 = 2e-6;

/// Rays whose cosine with a plane's normal is greater do not reach the plane.
const GRAZING: f32 = -1e-6;

/// Returns the start of rays that leave a surface point on the side of a normal.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn lifted(position: V3, normal: V3) -> V3 {
    position + normal * (LIFT * (0.1 + position.abs().max_element()))
}

/// Returns the distance at which a ray reaches the plane through a light, less a margin for rounding. It is not
/// positive if the ray starts behind that plane, as a ray that enters glass does for the plane of its own surface.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn up_to_plane(start: V3, direction: V3, normal: V3, light: V3) -> f32 {
    let cosine = normal.dot(direction);
    let before = normal.dot(start - light);
    let size = 1.0 + light.abs().max_element() + start.abs().max_element();
    let limit = select(cosine <= GRAZING, (END * size - before) / cosine, f32::MAX);
    select(before > 0.0, limit, -1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::v3;

    #[test]
    fn angles_of_widened_cones_add_up() {
        for (angle, by) in [(0.0f32, 0.3f32), (0.7, 0.0), (1.2, 0.6)] {
            let half = SinCos {
                sin: angle.sin(),
                cos: angle.cos(),
            };
            let SinCos { sin, cos } = widened(half, by.tan());
            assert!((sin.atan2(cos) - angle - by).abs() < 3e-6);
        }
    }

    #[test]
    fn a_cone_stays_about_its_axis() {
        let axis = v3(0.36, 0.48, 0.8);
        for i in 0..64 {
            let u = (i as f32 + 0.5) / 64.0;
            let offset = cone_offset(axis, 0.1, u, 0.37);
            assert!(offset.dot(axis).abs() < 1e-6 && offset.length() <= 0.1 + 1e-6);
        }
    }

    /// Densities of rays integrate to 1 and match the sampled rays: the mean of 1/density is the solid angle of the
    /// cone, without the end of the kernel.
    #[test]
    fn densities_of_rays() {
        let (axis, tangent) = (v3(0.36, 0.48, 0.8), 0.7f32);
        let (n, mut sum) = (400, 0.0);
        for i in 0..n {
            let cosine = 1.0 - (i as f32 + 0.5) / n as f32;
            let sine = (1.0 - cosine * cosine).sqrt();
            let to = axis * cosine + frame(axis).tangent * sine;
            sum += f64::from(2.0 * PI * cone_density(axis, to * 3.0, tangent)) / f64::from(n);
        }
        assert!((sum - 1.0).abs() < 1e-3, "{sum}");
        let (mut angle, mut share) = (0.0, 0);
        for i in 0..n * n {
            let (u, v) = ((i % n) as f32 + 0.5, (i / n) as f32 + 0.5);
            let ray = bend(axis, axis, tangent, u / n as f32, v / n as f32).direction;
            if ray.dot(axis) > 0.9 {
                angle += 1.0 / f64::from(cone_density(axis, ray, tangent));
                share += 1;
            }
        }
        let wanted = 2.0 * std::f64::consts::PI * 0.1;
        let angle = angle / f64::from(n * n);
        assert!(
            share > 0 && (angle - wanted).abs() < 2e-3 * wanted,
            "{angle} {wanted}"
        );
    }

    /// The derivative of a ray, mirrored or not, with respect to the axis and the normal, at a fixed offset.
    #[test]
    fn derivatives_of_bent_rays() {
        let normal = v3(0.1, 0.2, 1.0).normalize();
        let g = v3(0.3, -0.7, 0.5);
        let mut mirrored = 0;
        // From 1: without an offset the ray is its axis, which stays of unit length.
        for i in 1..16 {
            let axis = v3(0.9, -0.3, 0.02 * i as f32).normalize();
            let (u, v) = ((0.618 * i as f32).fract(), (0.37 * i as f32).fract());
            let bent = bend(axis, normal, 0.8, u, v);
            mirrored += u32::from(bent.mirrored);
            let value = |axis: V3, normal: V3| {
                let d = (axis + bent.offset).normalize();
                let along = if bent.mirrored { d.dot(normal) } else { 0.0 };
                g.dot(d - normal * (2.0 * along))
            };
            let mut by_normal = V3::ZERO;
            let by_axis = bend_backward(&bent, axis, normal, g, &mut by_normal);
            for step in [v3(1.0, 0.0, 0.0), v3(0.0, 1.0, 0.0), v3(0.0, 0.0, 1.0)] {
                let h = step * 2e-3;
                let slope = (value(axis + h, normal) - value(axis - h, normal)) / 4e-3;
                assert!((slope - by_axis.dot(step)).abs() < 2e-3);
                let slope = (value(axis, normal + h) - value(axis, normal - h)) / 4e-3;
                assert!((slope - by_normal.dot(step)).abs() < 2e-3);
            }
        }
        assert!(mirrored > 0 && mirrored < 15, "{mirrored}");
    }
}
