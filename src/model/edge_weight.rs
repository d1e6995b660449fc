//! Estimates of what edges and trees over them contribute, as a point sees them: jump times angle over distance times
//! lobe.

use super::V3;
use crate::cube::*;

/// A search for an edge: a point, a cone of directions seen from it, and a purpose.
#[apply(record!)]
pub(crate) struct Query {
    pub x: V3,
    pub time: f32,
    pub axis: V3,
    /// Cosine and sine of the half-angle of the cone, at most 90°.
    pub cos: f32,
    pub sin: f32,
    /// Contributions grow about as cosⁿ of the angle to the axis.
    pub exponent: f32,
    /// Whether only edges count at which jumps whether light passes.
    pub shadows: bool,
}

/// The most that may jump at edges, by what makes it jump; of one edge between 0 and 1.
#[apply(zeroed!)]
pub(crate) struct Jumps {
    /// Colours that always jump, and jumps of whether light passes.
    pub seen_always: f32,
    pub passes_always: f32,
    /// Jumps of folds that are silhouettes.
    pub fold: f32,
    /// Jumps where both faces of a fold are seen.
    pub crease: f32,
    /// 1 where all folds are of closed objects.
    pub closed: f32,
}

/// Bounds of a subtree.
#[apply(record!)]
pub(crate) struct Subtree {
    pub centre: V3,
    pub radius: f32,
    /// A cone of the normals of folds.
    pub axis: V3,
    pub cos: f32,
    pub sin: f32,
    pub jumps: Jumps,
}

/// An edge as a point sees it.
#[apply(record!)]
pub(crate) struct SeenEdge {
    /// The vector to its middle, and half its length.
    pub to: V3,
    pub half: f32,
    /// The vector along it.
    pub along: V3,
    /// Normals of both faces.
    pub front: V3,
    pub back: V3,
    pub jumps: Jumps,
}

/// An estimate of what a subtree contributes, 0 only if it can't, and whether it is to be entered: it lies in the
/// query's cone in part, or is near.
#[apply(record!)]
pub(crate) struct Estimate {
    pub weight: f32,
    pub enter: bool,
}

/// Lengths that are divided by are at least this.
const TINY: f32 = 1e-30;

/// Kinds of edges: of a fold one face may be seen from the front and one from behind, at a border something always jumps,
/// and at a crossing colours alone.
pub(crate) const FOLD: u32 = 0;
pub(crate) const BORDER: u32 = 1;
pub(crate) const CROSSING: u32 = 2;

#[cfg_attr(feature = "wgpu", cube)]
impl Jumps {
    /// Of an edge of a kind, by how much colours may jump where both of its faces are seen, and whether its object is closed.
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

    /// The jumps that are there wherever the edge is seen from.
    #[inline(always)]
    fn always(&self, q: &Query) -> f32 {
        let mut always = self.seen_always;
        if q.shadows {
            always = self.passes_always;
        }
        always
    }

    /// Jumps where both faces are seen.
    #[inline(always)]
    fn of_crease(&self, q: &Query) -> f32 {
        let mut crease = self.crease;
        if q.shadows {
            crease = 0.0f32;
        }
        crease
    }
}

#[cfg_attr(feature = "wgpu", cube)]
impl Query {
    /// About cosⁿ of the angle to the axis.
    #[inline(always)]
    fn lobe(&self, cosine: f32) -> f32 {
        let mut value = 1.0f32;
        if self.exponent != 0.0 {
            let s = (1.0 - cosine) * (self.exponent - 1.0).max(0.0) + 1.0;
            value = (cosine + 1e-3) / (s * s);
        }
        value
    }
}

#[cfg_attr(feature = "wgpu", cube)]
impl Subtree {
    /// Its estimate; subtrees that are seen under an angle whose sine is over `large` are to be entered.
    #[inline(always)]
    pub fn estimate(&self, q: &Query, large: f32) -> Estimate {
        let r = self.centre - q.x;
        let radius = self.radius;
        let squared = r.length_squared();
        let distance = squared.sqrt();
        let along = r.dot(q.axis);
        let across = (squared - along * along).max(0.0).sqrt();
        let beside = across * q.cos - along * q.sin;
        // The angle under which the sphere is seen.
        let sin_seen = (radius / distance.max(1e-20)).min(1.0);
        let cos_seen = (1.0 - sin_seen * sin_seen).max(0.0).sqrt();
        let sin_sum = self.sin * cos_seen + self.cos * sin_seen;
        let cos_sum = self.cos * cos_seen - self.sin * sin_seen;
        let facing = self.axis.dot(r) / distance.max(1e-20);
        // Where normals and directions spread over more than a half-space anything is possible.
        let narrow = cos_sum > 0.0 && distance >= radius;
        let mut fold = self.jumps.fold / (sin_sum.abs() + 0.05);
        if narrow && sin_sum < facing.abs() {
            fold = 0.0f32;
        }
        let mut crease = self.jumps.of_crease(q);
        if narrow && sin_sum < facing && self.jumps.closed > 0.0 {
            crease = 0.0f32;
        }
        let nearest = ((along + radius) / (distance + radius).max(TINY))
            .max(0.0)
            .min(1.0);
        let jump = self.jumps.always(q) + fold + crease;
        let mut weight = jump * q.lobe(nearest) / (squared + radius * radius).max(1e-37);
        if radius < beside {
            weight = 0.0f32;
        }
        Estimate {
            weight,
            enter: beside + radius >= 0.0 || sin_seen >= large,
        }
    }
}

/// How an edge lies to a point and the axis of a query.
#[apply(record!)]
struct Span {
    /// The vector along the edge times that to it, and its length: that of the edge times the distance from its line.
    c: V3,
    swept: f32,
    /// The distance from the edge, and the angle under which it is seen, about.
    near: f32,
    angle: f32,
    /// The heights of the middle over the plane across the axis, and of one end over the middle.
    along: f32,
    rise: f32,
}

#[cfg_attr(feature = "wgpu", cube)]
impl SeenEdge {
    /// An estimate of what it contributes, by how much jumps at it; 0 only if it can't, in the cone of a query that is
    /// narrower than a half-space.
    #[inline(always)]
    pub fn weight_in_cone(&self, jump: f32, q: &Query) -> f32 {
        let mut weight = 0.0f32;
        if jump > 0.0 {
            weight = jump * self.in_cone(q);
        }
        weight
    }

    /// The same in a half-space.
    #[inline(always)]
    pub fn weight_over_horizon(&self, jump: f32, q: &Query) -> f32 {
        let mut weight = 0.0f32;
        if jump > 0.0 {
            weight = jump * self.over_horizon(q);
        }
        weight
    }

    /// A length that is not less than the distance to any point of it.
    #[inline(always)]
    fn away(&self) -> f32 {
        self.to.abs().element_sum() + self.half
    }

    /// The most that may jump at it.
    #[inline(always)]
    pub fn jump(&self, q: &Query) -> f32 {
        // The point's height over both faces.
        let front = -self.front.dot(self.to);
        let back = -self.back.dot(self.to);
        let mut jump = self.jumps.of_crease(q);
        if self.jumps.closed > 0.0 && front <= 0.0 && back <= 0.0 {
            jump = 0.0f32;
        }
        if front * back < 0.0 {
            jump = self.jumps.fold;
        }
        // Edges of a plane that the point lies in are seen from the side alone.
        if front.abs().min(back.abs()) < self.away() * 1e-6 {
            jump = 0.0f32;
        }
        jump + self.jumps.always(q)
    }

    #[inline(always)]
    fn span(&self, q: &Query) -> Span {
        let c = self.along.cross(self.to);
        let swept = c.length();
        let length = (self.half + self.half).max(TINY);
        let line = swept / length;
        let beyond = (self.along.dot(self.to).abs() / length - self.half).max(0.0);
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

    /// Angle over distance times lobe, of the part of it in the query's cone.
    #[inline(always)]
    fn in_cone(&self, q: &Query) -> f32 {
        let s = self.span(q);
        let a = self.to - self.along * 0.5;
        let b = self.to + self.along * 0.5;
        let far_a = a.length() + TINY;
        let far_b = b.length() + TINY;
        let cos_a = (s.along - s.rise) / far_a;
        let cos_b = (s.along + s.rise) / far_b;
        // The sine of the angle between the axis and the plane of the edge, and whether the axis lies between its ends.
        let sine = q.axis.dot(s.c) / (s.swept + TINY);
        let outside = a.cross(q.axis).dot(s.c) > 0.0 || q.axis.cross(b).dot(s.c) > 0.0;
        let by_ends = cos_a.max(cos_b);
        let chord = (q.sin * q.sin - sine * sine).max(1e-12).sqrt();
        let part = s.angle.min(chord + chord);
        let mut by_end = far_a;
        if cos_a < cos_b {
            by_end = far_b;
        }
        let mut distance = (s.swept * s.swept) / (self.along.cross(q.axis).dot(s.c).abs() + TINY);
        let mut cosine = (1.0 - sine * sine).max(0.0).sqrt();
        if outside {
            cosine = by_ends;
            distance = by_end;
        }
        let mut weight = part / (distance + TINY) * q.lobe(cosine.max(0.0));
        if by_ends < q.cos && (outside || q.sin < sine.abs()) {
            weight = 0.0f32;
        }
        weight
    }

    /// Angle over distance, times about cos θ where the query has a lobe, of an edge over the horizon.
    #[inline(always)]
    fn over_horizon(&self, q: &Query) -> f32 {
        let s = self.span(q);
        // The sum of the heights of both ends.
        let height = (s.along + s.rise).max(0.0) + (s.along - s.rise).max(0.0);
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
