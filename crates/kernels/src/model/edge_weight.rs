//! Importance of edges, and of nodes of trees over edges, for a point that sees them: jump × angle / distance × lobe.
//!
//! What a condition needs is computed before it: kernels execute `&&` and `||` with a call on their right side as a branch.

use super::V3;
use crate::cube::*;

/// A query for an edge: a point, a cone of directions from it, and a purpose.
#[apply(record!)]
pub struct Query {
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
    /// 1 over the distance at which directions follow the material by half ([`left_of_crease`]).
    pub following: f32,
}

/// Returns the part of a crease's jump that is left where directions follow the material: 1/(1 + ρ⁴), with ρ the
/// distance over the one at which they do so by half. Without these (`following` is 0) it is 1.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn left_of_crease(distance: f32, following: f32) -> f32 {
    let near = distance * following;
    let square = near * near;
    1.0 / (square * square + 1.0)
}

/// Upper bounds of jumps at edges by their cause, between 0 and 1 for one edge.
#[apply(zeroed!)]
pub struct Jumps {
    /// Jumps of color, and jumps of visibility, that do not depend on where the edge is seen from.
    pub seen_always: f32,
    pub passes_always: f32,
    /// Jumps at folds that are silhouettes.
    pub fold: f32,
    /// Jumps where both faces of a fold are seen, and those of them whose faces directions may follow.
    pub crease: f32,
    pub followed: f32,
    /// 1 if all folds belong to closed objects.
    pub closed: f32,
}

/// Bounds of the edges in a subtree.
#[apply(record!)]
pub struct Subtree {
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
pub struct SeenEdge {
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
pub struct Estimate {
    pub weight: f32,
    pub enter: bool,
}

/// Lower bound of lengths that are divided by.
const TINY: f32 = 1e-30;

/// Kinds of edges. A fold may show one face from the front and one from behind. At a border something always jumps.
/// At a crossing of two triangles only color jumps.
pub const FOLD: u32 = 0;
pub const BORDER: u32 = 1;
pub const CROSSING: u32 = 2;
/// Bits beside an edge's kind: its object is closed, and directions may follow both of its faces.
pub const CLOSED: u32 = 4;
pub const FOLLOWED: u32 = 8;

#[cfg_attr(feature = "gpu", cube)]
impl Jumps {
    /// Returns the jumps of an edge of a kind, with its bits [`CLOSED`] and [`FOLLOWED`]. `crease` bounds the jump of
    /// color where both faces are seen.
    #[inline(always)]
    pub fn of_kind(kind: u32, crease: f32) -> Jumps {
        let fold = kind % CLOSED == FOLD;
        Jumps {
            seen_always: select(fold, 0.0, 1.0),
            passes_always: select(kind % CLOSED == BORDER, 1.0, 0.0),
            fold: select(fold, 1.0, 0.0),
            crease: select(fold, crease, 0.0),
            followed: select(fold && kind & FOLLOWED != 0, crease, 0.0),
            closed: select(kind & CLOSED != 0, 1.0, 0.0),
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

    /// Returns the jump where both faces are seen, from at least a distance.
    #[inline(always)]
    fn of_crease(&self, q: &Query, distance: f32) -> f32 {
        let left = left_of_crease(distance, q.following);
        let mut crease = self.crease - self.followed + self.followed * left;
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

/// Returns whether the sphere of a subtree is outside of the cone of a query by more than rounding errors. The weight of the
/// subtree is then 0.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn is_outside(center: V3, radius: f32, q: &Query) -> bool {
    let r = center - q.x;
    let along = r.dot(q.axis);
    let across = r.length_squared() - along * along;
    let limit = radius + along * q.sin + (radius + along.abs()) * 1e-5;
    limit < 0.0 || across * (q.cos * q.cos) > limit * limit
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
        let turned = facing.abs();
        // If normals and directions spread over more than a half-space, no case can be excluded.
        let narrow = cos_sum > 0.0 && distance >= radius;
        let no_fold = narrow && sin_sum < turned;
        let fold = select(no_fold, 0.0, self.jumps.fold / (sin_sum.abs() + 0.05));
        let no_crease = narrow && sin_sum < facing && self.jumps.closed > 0.0;
        let crease = select(
            no_crease,
            0.0,
            self.jumps.of_crease(q, max(distance - radius, 0.0)),
        );
        let nearest = min(
            max((along + radius) / max(distance + radius, TINY), 0.0),
            1.0,
        );
        let jump = self.jumps.always(q) + fold + crease;
        let weight = jump * q.lobe(nearest) / max(squared + radius * radius, 1e-37);
        Estimate {
            weight: select(radius < beside, 0.0, weight),
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
        select(jump > 0.0, jump * self.in_cone(q), 0.0)
    }

    /// [`SeenEdge::weight_in_cone`] for a query over a half-space.
    #[inline(always)]
    pub fn weight_over_horizon(&self, jump: f32, q: &Query) -> f32 {
        select(jump > 0.0, jump * self.over_horizon(q), 0.0)
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
        let unseen = self.jumps.closed > 0.0 && front <= 0.0 && back <= 0.0;
        let crease = select(unseen, 0.0, self.jumps.of_crease(q, self.to.length()));
        let jump = select(front * back < 0.0, self.jumps.fold, crease);
        // If the point lies in the plane of a face, it sees that face edge-on.
        let edge_on = min(front.abs(), back.abs()) < self.away() * 1e-6;
        select(edge_on, 0.0, jump) + self.jumps.always(q)
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
        let before = a.cross(q.axis).dot(s.c);
        let behind = q.axis.cross(b).dot(s.c);
        let outside = before > 0.0 || behind > 0.0;
        let by_ends = max(cos_a, cos_b);
        let chord = max(q.sin * q.sin - sine * sine, 1e-12).sqrt();
        let part = min(s.angle, chord + chord);
        let by_end = select(cos_a < cos_b, far_b, far_a);
        let between = (s.swept * s.swept) / (self.along.cross(q.axis).dot(s.c).abs() + TINY);
        let distance = select(outside, by_end, between);
        let cosine = select(outside, by_ends, max(1.0 - sine * sine, 0.0).sqrt());
        let weight = part / (distance + TINY) * q.lobe(max(cosine, 0.0));
        let apart = sine.abs();
        let misses = by_ends < q.cos && (outside || q.sin < apart);
        select(misses, 0.0, weight)
    }

    /// Returns angle over distance for an edge above the horizon, times approximately cos θ if the query has a lobe.
    #[inline(always)]
    fn over_horizon(&self, q: &Query) -> f32 {
        let s = self.span(q);
        // The sum of the heights of both ends.
        let height = max(s.along + s.rise, 0.0) + max(s.along - s.rise, 0.0);
        let away = self.away();
        let lobe = select(q.exponent > 0.0, height / (away + away), 1.0);
        s.angle / s.near * select(height > 0.0, lobe, 0.0)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::model::v3;

    proptest! {
        /// A subtree outside of a cone has weight 0. All that are more than 0.01 and less than 1.57 rad away are found.
        #[test]
        fn nothing_outside_of_a_cone_counts(
            center in prop::array::uniform3(-3.0f32..3.0),
            x in prop::array::uniform3(-3.0f32..3.0),
            axis in prop::array::uniform3(-1.0f32..1.0),
            (radius, half) in (0.0f32..1.0, 0.0f32..1.57),
        ) {
            let axis = V3::from(axis);
            prop_assume!(axis.length() > 0.01);
            let query = Query {
                x: V3::from(x),
                time: 0.0,
                axis: axis.normalize(),
                cos: half.cos(),
                sin: half.sin(),
                exponent: 0.0,
                shadows: true,
                following: 0.0,
            };
            let subtree = Subtree {
                center: V3::from(center),
                radius,
                axis: v3(0.0, 0.0, 1.0),
                cos: 1.0,
                sin: 0.0,
                jumps: Jumps::of_kind(BORDER, 0.0),
            };
            let weight = subtree.estimate(&query, 0.1).weight;
            let outside = is_outside(subtree.center, radius, &query);
            prop_assert!(!outside || weight == 0.0);
            // The angle between the sphere and the cone, if the point is not in the sphere.
            let to = subtree.center - query.x;
            let away = (to.dot(query.axis) / to.length()).acos() - half;
            let apart = away - (radius / to.length()).min(1.0).asin();
            prop_assert!(outside || radius >= to.length() || apart < 0.01 || away > 1.57);
        }
    }
}
