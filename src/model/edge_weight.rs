//! Importance of edges, and of nodes of trees over edges, for a point that sees them: jump × angle / distance × lobe.

use super::V3;
use crate::cube::*;

/// A query for an edge: a point, a cone of directions from it, and a purpose.
#[apply(record!)]
pub(crate) struct Query {
    pub x: V3,
    pub time: f32,
    pub axis: V3,
    /// Cosine and sine of the half-angle of the cone, at most 90°.
    pub cos: f32,
    pub sin: f32,
    /// Contributions are roughly proportional to cosⁿ of the angle to the axis.
    pub exponent: f32,
    /// Whether only edges at which visibility jumps count.
    pub shadows: bool,
}

/// Upper bounds of jumps at edges by their cause, between 0 and 1 for one edge.
#[apply(zeroed!)]
pub(crate) struct Jumps {
    /// Jumps of color, and jumps of visibility, that do not depend on where the edge is seen from.
    pub seen_always: f32,
    pub passes_always: f32,
    /// Jumps at folds that are silhouettes.
    pub fold: f32,
    /// Jumps where both faces of a fold are seen.
    pub crease: f32,
    /// 1 if all folds belong to closed objects.
    pub closed: f32,
}

/// Bounds of the edges in a subtree.
#[apply(record!)]
pub(crate) struct Subtree {
    pub center: V3,
    pub radius: f32,
    /// A cone of the face normals at folds.
    pub axis: V3,
    pub cos: f32,
    pub sin: f32,
    pub jumps: Jumps,
}

/// An edge as seen from a point.
#[apply(record!)]
pub(crate) struct SeenEdge {
    /// The vector to its midpoint, and half its length.
    pub to: V3,
    pub half: f32,
    /// The vector along it.
    pub along: V3,
    /// Normals of both faces.
    pub front: V3,
    pub back: V3,
    pub jumps: Jumps,
}

/// The estimated contribution of a subtree, 0 only if it contributes nothing, and whether a traversal enters it: it
/// lies partly in the query's cone, or is near.
#[apply(record!)]
pub(crate) struct Estimate {
    pub weight: f32,
    pub enter: bool,
}

/// Lower bound of lengths that are divided by.
const TINY: f32 = 1e-30;

/// Kinds of edges. A fold may show one face from the front and one from behind. At a border something always jumps.
/// At a crossing of two triangles only color jumps.
pub(crate) const FOLD: u32 = 0;
pub(crate) const BORDER: u32 = 1;
pub(crate) const CROSSING: u32 = 2;

#[cfg_attr(feature = "gpu", cube)]
impl Jumps {
    /// Returns the jumps of an edge of a kind. `crease` bounds the jump of color where both faces are seen, and
    /// `closed` is true for an edge of a closed object.
    #[inline(always)]
    pub fn of_kind(kind: u32, crease: f32, closed: bool) -> Jumps {
        let fold = kind == FOLD;
        Jumps {
            seen_always: select(fold, 0.0, 1.0),
            passes_always: select(kind == BORDER, 1.0, 0.0),
            fold: select(fold, 1.0, 0.0),
            crease: select(fold, crease, 0.0),
            closed: select(closed, 1.0, 0.0),
        }
    }

    /// Returns the jumps that do not depend on where the edge is seen from.
    #[inline(always)]
    fn always(&self, q: &Query) -> f32 {
        let mut always = self.seen_always;
        if q.shadows {
            always = self.passes_always;
        }
        always
    }

    /// Returns the jump where both faces are seen.
    #[inline(always)]
    fn of_crease(&self, q: &Query) -> f32 {
        let mut crease = self.crease;
        if q.shadows {
            crease = 0.0f32;
        }
        crease
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Query {
    /// Returns approximately cosⁿ of the angle to the axis.
    #[inline(always)]
    fn lobe(&self, cosine: f32) -> f32 {
        let mut value = 1.0f32;
        if self.exponent != 0.0 {
            let s = (1.0 - cosine) * max(self.exponent - 1.0, 0.0) + 1.0;
            value = (cosine + 1e-3) / (s * s);
        }
        value
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Subtree {
    /// Returns its estimate. A traversal enters subtrees that are seen under an angle whose sine is at least `large`.
    #[inline(always)]
    pub fn estimate(&self, q: &Query, large: f32) -> Estimate {
        let r = self.center - q.x;
        let radius = self.radius;
        let squared = r.length_squared();
        let distance = squared.sqrt();
        let along = r.dot(q.axis);
        let across = max(squared - along * along, 0.0).sqrt();
        let beside = across * q.cos - along * q.sin;
        // The angle under which the sphere is seen.
        let sin_seen = min(radius / max(distance, 1e-20), 1.0);
        let cos_seen = max(1.0 - sin_seen * sin_seen, 0.0).sqrt();
        let sin_sum = self.sin * cos_seen + self.cos * sin_seen;
        let cos_sum = self.cos * cos_seen - self.sin * sin_seen;
        let facing = self.axis.dot(r) / max(distance, 1e-20);
        // If normals and directions spread over more than a half-space, no case can be excluded.
        let narrow = cos_sum > 0.0 && distance >= radius;
        let mut fold = self.jumps.fold / (sin_sum.abs() + 0.05);
        if narrow && sin_sum < facing.abs() {
            fold = 0.0f32;
        }
        let mut crease = self.jumps.of_crease(q);
        if narrow && sin_sum < facing && self.jumps.closed > 0.0 {
            crease = 0.0f32;
        }
        let nearest = min(
            max((along + radius) / max(distance + radius, TINY), 0.0),
            1.0,
        );
        let jump = self.jumps.always(q) + fold + crease;
        let mut weight = jump * q.lobe(nearest) / max(squared + radius * radius, 1e-37);
        if radius < beside {
            weight = 0.0f32;
        }
        Estimate {
            weight,
            enter: beside + radius >= 0.0 || sin_seen >= large,
        }
    }
}

/// The geometry of an edge relative to the point and axis of a query.
#[apply(record!)]
struct Span {
    /// The cross product of the vector along the edge and the vector to it, and its length: the edge's length times
    /// the distance from its line.
    c: V3,
    swept: f32,
    /// The approximate distance from the edge, and the approximate angle under which it is seen.
    near: f32,
    angle: f32,
    /// Height of the midpoint above the plane perpendicular to the axis, and height of one end above the midpoint.
    along: f32,
    rise: f32,
}

#[cfg_attr(feature = "gpu", cube)]
impl SeenEdge {
    /// Returns the estimated contribution for a jump at the edge, 0 only if there is none, in the cone of a query
    /// that is narrower than a half-space.
    #[inline(always)]
    pub fn weight_in_cone(&self, jump: f32, q: &Query) -> f32 {
        let mut weight = 0.0f32;
        if jump > 0.0 {
            weight = jump * self.in_cone(q);
        }
        weight
    }

    /// [`SeenEdge::weight_in_cone`] for a query over a half-space.
    #[inline(always)]
    pub fn weight_over_horizon(&self, jump: f32, q: &Query) -> f32 {
        let mut weight = 0.0f32;
        if jump > 0.0 {
            weight = jump * self.over_horizon(q);
        }
        weight
    }

    /// Returns an upper bound of the distance to any point of the edge.
    #[inline(always)]
    fn away(&self) -> f32 {
        self.to.abs().element_sum() + self.half
    }

    /// Returns an upper bound of the jump at the edge.
    #[inline(always)]
    pub fn jump(&self, q: &Query) -> f32 {
        // The point's heights above both faces.
        let front = -self.front.dot(self.to);
        let back = -self.back.dot(self.to);
        let mut jump = self.jumps.of_crease(q);
        if self.jumps.closed > 0.0 && front <= 0.0 && back <= 0.0 {
            jump = 0.0f32;
        }
        if front * back < 0.0 {
            jump = self.jumps.fold;
        }
        // If the point lies in the plane of a face, it sees that face edge-on.
        if min(front.abs(), back.abs()) < self.away() * 1e-6 {
            jump = 0.0f32;
        }
        jump + self.jumps.always(q)
    }

    #[inline(always)]
    fn span(&self, q: &Query) -> Span {
        let c = self.along.cross(self.to);
        let swept = c.length();
        let length = max(self.half + self.half, TINY);
        let line = swept / length;
        let beyond = max(self.along.dot(self.to).abs() / length - self.half, 0.0);
        let near = (line * line + beyond * beyond).sqrt() + 1e-20;
        Span {
            c,
            swept,
            near,
            angle: swept / (near * (near + length)),
            along: self.to.dot(q.axis),
            rise: self.along.dot(q.axis) * 0.5,
        }
    }

    /// Returns angle over distance times lobe, for the part of the edge in the query's cone.
    #[inline(always)]
    fn in_cone(&self, q: &Query) -> f32 {
        let s = self.span(q);
        let a = self.to - self.along * 0.5;
        let b = self.to + self.along * 0.5;
        let far_a = a.length() + TINY;
        let far_b = b.length() + TINY;
        let cos_a = (s.along - s.rise) / far_a;
        let cos_b = (s.along + s.rise) / far_b;
        // The sine of the angle between the axis and the plane of the edge, and whether the axis lies outside of the
        // edge's ends.
        let sine = q.axis.dot(s.c) / (s.swept + TINY);
        let outside = a.cross(q.axis).dot(s.c) > 0.0 || q.axis.cross(b).dot(s.c) > 0.0;
        let by_ends = max(cos_a, cos_b);
        let chord = max(q.sin * q.sin - sine * sine, 1e-12).sqrt();
        let part = min(s.angle, chord + chord);
        let mut by_end = far_a;
        if cos_a < cos_b {
            by_end = far_b;
        }
        let mut distance = (s.swept * s.swept) / (self.along.cross(q.axis).dot(s.c).abs() + TINY);
        let mut cosine = max(1.0 - sine * sine, 0.0).sqrt();
        if outside {
            cosine = by_ends;
            distance = by_end;
        }
        let mut weight = part / (distance + TINY) * q.lobe(max(cosine, 0.0));
        if by_ends < q.cos && (outside || q.sin < sine.abs()) {
            weight = 0.0f32;
        }
        weight
    }

    /// Returns angle over distance for an edge above the horizon, times approximately cos θ if the query has a lobe.
    #[inline(always)]
    fn over_horizon(&self, q: &Query) -> f32 {
        let s = self.span(q);
        // The sum of the heights of both ends.
        let height = max(s.along + s.rise, 0.0) + max(s.along - s.rise, 0.0);
        let away = self.away();
        let mut lobe = 0.0f32;
        if height > 0.0 {
            lobe = 1.0f32;
            if q.exponent > 0.0 {
                lobe = height / (away + away);
            }
        }
        s.angle / s.near * lobe
    }
}
