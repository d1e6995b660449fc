//! Intersection segments of two triangles.

use super::V3;
use super::edge::TOUCHING;
use super::triangle::Triangle;
use crate::cube::*;

/// Returns the largest absolute coordinate of a triangle's corners.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn size(t: &Triangle) -> f32 {
    let a = t.a.abs().max_element();
    max(max(a, t.b.abs().max_element()), t.c.abs().max_element())
}

/// A segment of a line, with the coordinates of its ends along that line.
#[apply(zeroed!)]
struct Segment {
    from: f32,
    to: f32,
    start: V3,
    end: V3,
    /// Number of ends found: two if the segment exists.
    ends: u32,
}

#[cfg_attr(feature = "gpu", cube)]
impl Segment {
    /// Processes one side of a triangle, whose ends p and q have the signed distances `above` and `below` from a
    /// plane.
    #[inline(always)]
    fn pass(&mut self, p: V3, q: V3, above: f32, below: f32, along: V3) {
        let passes = (above > 0.0 && below <= 0.0) || (above <= 0.0 && below > 0.0);
        if passes && self.ends < 2 {
            let point = p + (q - p) * (above / (above - below));
            let place = along.dot(point);
            if self.ends == 0 {
                self.from = place;
                self.start = point;
            } else {
                self.to = place;
                self.end = point;
            }
            self.ends += 1;
        }
    }
}

/// Returns the segment in which triangle `t` intersects the plane of triangle `of`, if it crosses by more than a
/// tolerance.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn through_plane(t: &Triangle, of: &Triangle, along: V3, tolerance: f32) -> Segment {
    let mut found = Segment::default();
    let at_a = of.normal.dot(t.a - of.a);
    let at_b = of.normal.dot(t.b - of.a);
    let at_c = of.normal.dot(t.c - of.a);
    let low = min(min(at_a, at_b), at_c);
    let high = max(max(at_a, at_b), at_c);
    if low <= -tolerance && high >= tolerance {
        found.pass(t.a, t.b, at_a, at_b, along);
        found.pass(t.b, t.c, at_b, at_c, along);
        found.pass(t.c, t.a, at_c, at_a, along);
        if found.from > found.to {
            let from = found.to;
            let start = found.end;
            found.to = found.from;
            found.end = found.start;
            found.from = from;
            found.start = start;
        }
    }
    found
}

/// The ends of an intersection segment.
#[apply(record!)]
pub struct Line {
    pub a: V3,
    pub b: V3,
    pub exists: bool,
}

/// Returns the segment in which two triangles intersect, if they do so by more than rounding errors.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn line_of_crossing(t: &Triangle, s: &Triangle) -> Line {
    let tolerance = TOUCHING * max(max(size(t), size(s)), 0.1);
    let along = t.normal.cross(s.normal);
    let of_second: Segment = through_plane(s, t, along, tolerance);
    let of_first: Segment = through_plane(t, s, along, tolerance);
    let mut from = of_first.from;
    let mut to = of_first.to;
    let mut line = Line {
        a: of_first.start,
        b: of_first.end,
        exists: of_first.ends == 2 && of_second.ends == 2,
    };
    if of_second.from > from {
        from = of_second.from;
        line.a = of_second.start;
    }
    if of_second.to < to {
        to = of_second.to;
        line.b = of_second.end;
    }
    if from >= to || (line.b - line.a).length() <= tolerance {
        line.exists = false;
    }
    line
}
