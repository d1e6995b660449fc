//! Clipping of segments a + λe, λ ∈ [0, 1], and sampling of points on them.

use super::V3;
use super::frame::{arc_tangent, sin_cos_of_turns};
use crate::cube::*;

/// An interval of λ on a segment. It is empty unless `to` is larger than `from`.
#[apply(record!)]
pub struct Part {
    pub from: f32,
    pub to: f32,
}

/// A sampled point of a segment, and the reciprocal of its density in λ, which is 0 where there is no point.
#[apply(record!)]
pub struct OnSegment {
    pub lambda: f32,
    pub per_density: f32,
}

/// Returns the part of a range of λ on which a linear function, f at λ = 0 and g at λ = 1, is not negative. If there
/// is no such part, the returned range ends before it starts.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn clip_linear(part: Part, f: f32, g: f32) -> Part {
    let root = f / (f - g);
    let to = select(g < 0.0, min(part.to, root), part.to);
    Part {
        from: select(f < 0.0, max(part.from, root), part.from),
        to: select(max(f, g) < 0.0, -1.0f32, to),
    }
}

/// Returns the part of a segment a + λe that lies inside a cone about `axis` with its apex at the origin. `cos` is
/// the cosine of the half-angle, which is at most 90°.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn clip_to_cone(a: V3, e: V3, axis: V3, cos: f32) -> Part {
    let p = a.dot(axis);
    let q = e.dot(axis);
    // Clip to the half-space in front of the plane through the apex, perpendicular to the axis.
    let mut from = select(q > 0.0, max(-p / q, 0.0), 0.0);
    let level = select(p <= 0.0, -1.0f32, 1.0f32);
    let mut to = select(q > 0.0, 1.0f32, level);
    to = select(q < 0.0, min(-p / q, 1.0), to);
    if cos > 0.0 {
        let square = cos * cos;
        let second = q * q - square * e.length_squared();
        let first = p * q - square * a.dot(e);
        let zeroth = p * p - square * a.length_squared();
        let discriminant = first * first - second * zeroth;
        if discriminant <= 0.0 {
            // Without two roots the whole line is inside or none of it is.
            to = select(second < 0.0 || zeroth < 0.0, -1.0f32, to);
        } else {
            let root = discriminant.sqrt();
            let root = select(first < 0.0, -root, root);
            // The two roots, computed without cancellation.
            let sum = -(first + root);
            let low = min(sum / second, zeroth / sum);
            let high = max(sum / second, zeroth / sum);
            let least = select(second < 0.0, low, high);
            let most = select(second < 0.0, high, low);
            from = select(second < 0.0 || q > 0.0, max(from, least), from);
            to = select(second < 0.0 || q <= 0.0, min(to, most), to);
        }
    }
    Part { from, to }
}

/// Samples a point on part of a segment, uniformly in the angle seen from the origin, for a uniform number `u`.
/// `per_density` is 0 for a segment that is seen end-on.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn point_by_angle(a: V3, e: V3, part: Part, u: f32) -> OnSegment {
    let squared = e.length_squared();
    let length = squared.sqrt();
    let nearest = -a.dot(e) / squared;
    let away = (a + e * nearest).length();
    let mut lambda = part.from;
    let mut per_density = 0.0f32;
    if away > 1e-7 * (a.length() + length) {
        let first = arc_tangent((part.from - nearest) * length / away);
        let last = arc_tangent((part.to - nearest) * length / away);
        let turn = (first + (last - first) * u) * PER_TURN;
        let at = sin_cos_of_turns(turn - turn.floor());
        let tangent = at.sin / max(at.cos, 1e-8);
        lambda = min(max(nearest + tangent * away / length, part.from), part.to);
        per_density = (1.0 + tangent * tangent) * away / length * (last - first);
    }
    OnSegment {
        lambda,
        per_density,
    }
}

/// Turns per radian.
const PER_TURN: f32 = 1.0 / std::f32::consts::TAU;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::v3;

    #[test]
    fn ranges_clipped_where_a_quantity_is_negative() {
        let clipped = |from: f32, f: f32, g: f32| {
            let part = clip_linear(Part { from, to: 1.0 }, f, g);
            [part.from, part.to]
        };
        assert_eq!(clipped(0.0, 1.0, 2.0), [0.0, 1.0]);
        assert_eq!(clipped(0.0, -1.0, 3.0), [0.25, 1.0]);
        assert_eq!(clipped(0.5, 3.0, -1.0), [0.5, 0.75]);
        let [from, to] = clipped(0.0, -1.0, -2.0);
        assert!(from > to);
    }

    /// The mean of 1/density is the length of the range, and points are uniform in the angle.
    #[test]
    fn points_by_their_angle() {
        let (a, e) = (v3(0.2, -0.5, 1.0), v3(0.7, 1.5, -0.4));
        let [from, to] = [0.1, 0.9];
        let n = 1000;
        let mut mean = 0.0;
        for i in 0..n {
            let u = (i as f32 + 0.5) / n as f32;
            let OnSegment {
                lambda,
                per_density,
            } = point_by_angle(a, e, Part { from, to }, u);
            mean += f64::from(per_density) / f64::from(n);
            let ends = [a + e * from, a + e * lambda, a + e * to].map(V3::normalize);
            let angle = |k: usize| ends[0].dot(ends[k]).min(1.0).acos();
            assert!((angle(1) - u * angle(2)).abs() < 2e-3, "{u}");
        }
        assert!((mean - f64::from(to - from)).abs() < 1e-4, "{mean}");
        let whole = Part { from: 0.0, to: 1.0 };
        assert_eq!(point_by_angle(e, e, whole, 0.5).per_density, 0.0);
    }

    #[test]
    fn segments_clipped_to_cones() {
        let axis = v3(0.0, 0.0, 1.0);
        let inside = |a: V3, e: V3, cos: f32, l: f32| {
            let r = a + e * l;
            r.dot(axis) > cos * r.length()
        };
        let mut state = 1u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32 * 2.0 - 1.0
        };
        for i in 0..2000 {
            let a = v3(random(), random(), random());
            let e = v3(random(), random(), random()) * 2.0;
            let cos = [0.0, 0.3, 0.9, 0.999][i % 4];
            let found = clip_to_cone(a, e, axis, cos);
            for j in 0..200 {
                let l = (j as f32 + 0.5) / 200.0;
                let is = found.from < l && l < found.to;
                let near = (l - found.from).abs().min((l - found.to).abs()) < 1e-3;
                assert!(
                    near || is == inside(a, e, cos, l),
                    "{a:?} {e:?} {cos} {l} {found:?}"
                );
            }
        }
    }
}
