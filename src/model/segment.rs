//! Parts of segments a + λe, λ ∈ [0, 1], and points drawn on them.

use super::V3;

/// The part of a range of λ on which a linear quantity, f at λ = 0 and g at λ = 1, is not negative. It ends
/// before it starts where there is none.
pub(crate) fn clip_linear([from, to]: [f32; 2], f: f32, g: f32) -> [f32; 2] {
    if f < 0.0 && g < 0.0 {
        [from, -1.0]
    } else if f < 0.0 {
        [from.max(f / (f - g)), to]
    } else if g < 0.0 {
        [from, to.min(f / (f - g))]
    } else {
        [from, to]
    }
}

/// The part of a segment a + λe that lies in a cone about an axis of a half-angle of at most 90°.
pub(crate) fn clip_to_cone(a: V3, e: V3, axis: V3, cos: f32) -> Option<[f32; 2]> {
    let (p, q) = (a.dot(axis), e.dot(axis));
    // Before the plane across the axis through the apex.
    let (mut from, mut to) = (0.0f32, 1.0f32);
    if q > 0.0 {
        from = from.max(-p / q);
    } else if q < 0.0 {
        to = to.min(-p / q);
    } else if p <= 0.0 {
        return None;
    }
    if cos > 0.0 {
        let square = cos * cos;
        let second = q * q - square * e.length_squared();
        let first = p * q - square * a.dot(e);
        let zeroth = p * p - square * a.length_squared();
        let discriminant = first * first - second * zeroth;
        if discriminant <= 0.0 {
            // All of the line or nothing.
            if second < 0.0 || zeroth < 0.0 {
                return None;
            }
        } else {
            let root = discriminant.sqrt();
            // The two roots without cancellation.
            let sum = -(first + root.copysign(first));
            let (mut low, mut high) = (sum / second, zeroth / sum);
            if low > high {
                std::mem::swap(&mut low, &mut high);
            }
            if second < 0.0 {
                from = from.max(low);
                to = to.min(high);
            } else if q > 0.0 {
                from = from.max(high);
            } else {
                to = to.min(low);
            }
        }
    }
    (from < to).then_some([from, to])
}

/// The point of a part of a segment, not seen end-on, for a uniform number: by the angle under which the
/// origin sees it. Returns λ and 1 over its density.
pub(crate) fn point_by_angle(a: V3, e: V3, [from, to]: [f32; 2], u: f32) -> Option<[f32; 2]> {
    let squared = e.length_squared();
    let length = squared.sqrt();
    let nearest = -a.dot(e) / squared;
    let away = (a + e * nearest).length();
    if away <= 1e-7 * (a.length() + length) {
        return None;
    }
    let angle = |lambda: f32| ((lambda - nearest) * length / away).atan();
    let (first, last) = (angle(from), angle(to));
    let tangent = (first + (last - first) * u).tan();
    Some([
        (nearest + tangent * away / length).clamp(from, to),
        (1.0 + tangent * tangent) * away / length * (last - first),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::v3;

    #[test]
    fn ranges_clipped_where_a_quantity_is_negative() {
        assert_eq!(clip_linear([0.0, 1.0], 1.0, 2.0), [0.0, 1.0]);
        assert_eq!(clip_linear([0.0, 1.0], -1.0, 3.0), [0.25, 1.0]);
        assert_eq!(clip_linear([0.5, 1.0], 3.0, -1.0), [0.5, 0.75]);
        let [from, to] = clip_linear([0.0, 1.0], -1.0, -2.0);
        assert!(from > to);
    }

    /// The mean of 1 over the density is the length of the range, and the numbers follow the angle.
    #[test]
    fn points_by_their_angle() {
        let (a, e) = (v3(0.2, -0.5, 1.0), v3(0.7, 1.5, -0.4));
        let [from, to] = [0.1, 0.9];
        let n = 1000;
        let mut mean = 0.0;
        for i in 0..n {
            let u = (i as f32 + 0.5) / n as f32;
            let [lambda, per_density] =
                point_by_angle(a, e, [from, to], u).expect("seen from the side");
            mean += f64::from(per_density) / f64::from(n);
            let ends = [a + e * from, a + e * lambda, a + e * to].map(V3::normalize);
            let angle = |k: usize| ends[0].dot(ends[k]).min(1.0).acos();
            assert!((angle(1) - u * angle(2)).abs() < 2e-3, "{u}");
        }
        assert!((mean - f64::from(to - from)).abs() < 1e-4, "{mean}");
        assert!(point_by_angle(e, e, [0.0, 1.0], 0.5).is_none());
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
                let is = found.is_some_and(|[from, to]| from < l && l < to);
                let near =
                    found.is_some_and(|[from, to]| (l - from).abs().min((l - to).abs()) < 1e-3);
                assert!(
                    near || is == inside(a, e, cos, l),
                    "{a:?} {e:?} {cos} {l} {found:?}"
                );
            }
        }
    }
}
