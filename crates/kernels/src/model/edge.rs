//! Boundary terms: the contribution of moving edges to the derivative of an image.
//!
//! The derivative of an integral of f over directions, or over the film, is ∫ ∂f plus, along each edge across which f
//! jumps, ∫ (f⁻ − f⁺) v·n dl (Reynolds). Here v is the velocity of the edge's image, and n its normal from the side
//! of f⁻ to the side of f⁺. dl is that of the edge's parameter λ ∈ [0, 1], so n·dl is a vector linear in the edge.

use super::bsdf::Shading;
use super::cone::Bend;
use super::{V2, V3, select_vector, v2};
use crate::cube::*;

/// An edge seen from a point, relative to an axis ω of a blurred direction.
#[apply(zeroed!)]
pub struct DirectionEdge {
    /// n·dl/dλ in the plane perpendicular to ω; it points to the + side.
    pub across: V3,
    /// Derivative of v·n dl/dλ with respect to the edge's point; negated, with respect to the point that sees it.
    pub by_point: V3,
    /// Derivative of v·n dl/dλ with respect to the axis ω.
    pub by_axis: V3,
}

/// Returns the boundary term of ∫ dω f(ω) ∫ K(q) V(ω + κq) dq, where V jumps at an edge.
///
/// The roles of ω and q are exchanged: the edge's point P is seen along u = r/|r|, and ω is sampled about u with the
/// density that K(q) has about ω. The ratio of the densities is cos³ of the angle between u and ω. `r` is P − x, and
/// `edge` is dP/dλ. Offsets perpendicular to ω are constant in its frame. If ω = u there is no blur.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn direction_edge(r: V3, edge: V3, axis: V3) -> DirectionEdge {
    let s = r.dot(axis);
    let inverse = 1.0 / s;
    let slope = (edge - r * (edge.dot(axis) * inverse)) * inverse;
    let across = slope.cross(axis);
    let cosine = s / r.length();
    let scale = cosine * cosine * cosine;
    DirectionEdge {
        across,
        by_point: (across - axis * (r.dot(across) * inverse)) * (inverse * scale),
        by_axis: -(across * scale),
    }
}

/// The motion of an edge's image across an axis, about which rays were bent and possibly mirrored at a surface.
#[apply(record!)]
pub struct DirectionJump {
    pub edge: DirectionEdge,
    /// The direction to the + side, at the edge itself.
    pub side: V3,
    mirrored: bool,
}

#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn mirrored(v: V3, normal: V3) -> V3 {
    v - normal * (2.0 * v.dot(normal))
}

/// Returns the motion of the image of an edge's point at `r` from the surface point that sees it; `normal` is the
/// surface normal.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn direction_jump(r: V3, along: V3, bend: &Bend, normal: V3) -> DirectionJump {
    // A mirrored axis sees the mirror image of the edge.
    let image = select_vector(bend.mirrored, mirrored(r, normal), r);
    let image_along = select_vector(bend.mirrored, mirrored(along, normal), along);
    let edge = direction_edge(image, image_along, bend.direction);
    let across = mirrored(edge.across, normal);
    DirectionJump {
        edge,
        side: select_vector(bend.mirrored, across, edge.across),
        mirrored: bend.mirrored,
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl DirectionJump {
    /// Returns the derivative with respect to r, times a jump `scale`; adds the derivative with respect to the
    /// normal.
    #[inline(always)]
    pub fn by_point(&self, r: V3, normal: V3, scale: f32, by_normal: &mut V3) -> V3 {
        let mut by_r = self.edge.by_point * scale;
        if self.mirrored {
            // r̃ = r − 2 (r·n) n.
            *by_normal -= by_r * (2.0 * r.dot(normal)) + r * (2.0 * by_r.dot(normal));
            by_r = mirrored(by_r, normal);
        }
        by_r
    }
}

/// Returns how a triangle's half-plane at an edge is seen: the side of the edge's image on which it lies, and how
/// fast its depth grows from there.
///
/// `inward` points from the edge into the triangle, in its plane. `view` is the direction in which the edge's point
/// is seen. `side` points across the edge's image. Of the result, x is > 0 if the half-plane lies toward `side`, and
/// y is the depth gained along `view` per unit of |x|.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn half_plane(inward: V3, edge: V3, view: V3, side: V3) -> V2 {
    let across = edge.reject_from_normalized(view);
    let g = inward - edge * (inward.dot(across) / across.length_squared());
    let lateral = g.dot(side);
    v2(lateral, g.dot(view) / lateral.abs())
}

/// Points closer to a plane than this, times the largest coordinate, touch it: about the rounding error of positions.
pub const TOUCHING: f32 = 4e-6;

/// Returns whether a point `place`, at the vector `to` from a surface point, lies above the surface plane, on the
/// side on which rays to it leave. In that plane surfaces are seen edge-on and rays of a cone are mirrored, so
/// nothing jumps there.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn is_above(shading: &Shading, to: V3, place: V3) -> bool {
    to.dot(shading.outer(to)) > TOUCHING * (0.1 + place.abs().max_element())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{frame::frame, v3};

    /// The area swept in the plane of the disk q, (P − x) ∝ ω + κq, against its numerical derivative.
    #[test]
    fn swept_area() {
        let axis = v3(0.1, 0.2, 1.0).normalize();
        let x = v3(0.3, -0.2, 0.1);
        let (a, b) = (v3(0.5, 0.2, 2.4), v3(0.9, 0.8, 2.9));
        let (w, v) = (frame(axis).tangent, frame(axis).bitangent);
        // The frame is constant while the axis moves.
        let q = |p: V3, x: V3, axis: V3| {
            let r = p - x;
            // r = s (ω + q₁ w + q₂ v): Cramer's rule.
            let det = axis.dot(w.cross(v));
            let s = r.dot(w.cross(v)) / det;
            let c = r * (1.0 / s) - axis;
            [c.dot(w), c.dot(v)]
        };
        let p = a + (b - a) * 0.3;
        let found = direction_edge(p - x, b - a, axis);
        let scale = (p - x).dot(axis) / (p - x).length();
        let scale = scale * scale * scale;
        let h = 1e-2;
        let slope = |f: &dyn Fn(f32) -> [f32; 2]| {
            let (up, down) = (f(h), f(-h));
            [(up[0] - down[0]) / (2.0 * h), (up[1] - down[1]) / (2.0 * h)]
        };
        let along = slope(&|h| q(a + (b - a) * (0.3 + h), x, axis));
        for d in [v3(1.0, 0.0, 0.0), v3(0.0, 1.0, 0.0), v3(0.0, 0.0, 1.0)] {
            let area = |moved: [f32; 2]| (moved[0] * along[1] - moved[1] * along[0]) * scale;
            let by_point = area(slope(&|h| q(p + d * h, x, axis)));
            assert!(
                (found.by_point.dot(d) - by_point).abs() < 1e-3,
                "{by_point}"
            );
            let by_origin = area(slope(&|h| q(p, x + d * h, axis)));
            assert!((found.by_point.dot(d) + by_origin).abs() < 1e-3);
            let d = d.reject_from_normalized(axis);
            let by_axis = area(slope(&|h| q(p, x, axis + d * h)));
            assert!((found.by_axis.dot(d) - by_axis).abs() < 1e-3, "{by_axis}");
        }
    }

    #[test]
    fn halves_of_a_ridge() {
        // A roof seen from above: one half on each side, both falling away.
        let (edge, view) = (v3(0.0, 0.0, 1.0), v3(0.0, -1.0, 0.0));
        let side = v3(1.0, 0.0, 0.0);
        let right = half_plane(v3(1.0, -0.5, 0.3), edge, view, side);
        let left = half_plane(v3(-1.0, -2.0, 0.1), edge, view, side);
        assert!((right.x - 1.0).abs() < 1e-6 && (right.y - 0.5).abs() < 1e-6);
        assert!((left.x + 1.0).abs() < 1e-6 && (left.y - 2.0).abs() < 1e-6);
    }
}
