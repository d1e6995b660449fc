//! Estimates of what edges contribute, as a point sees them: `kernel/edges/node` in a kernel of a GPU.

use crate::cube::*;

use super::reading::Scene;
use crate::model::V3;

/// A search for an edge: a point, a cone of directions seen from it, and a purpose.
#[apply(record!)]
pub(super) struct Query {
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

/// About cosⁿ of the angle to the axis.
#[cube]
fn lobe(q: &Query, cosine: f32) -> f32 {
    let mut value = 1.0f32;
    if q.exponent != 0.0 {
        let s = (1.0 - cosine) * (q.exponent - 1.0).max(0.0) + 1.0;
        value = (cosine + 1e-3) / (s * s);
    }
    value
}

/// The most that may jump at edges, by what makes it jump (`Jumps`), as far as it counts for a query.
#[apply(record!)]
struct Jumps {
    always: f32,
    fold: f32,
    crease: f32,
    closed: bool,
}

#[cube]
fn jumps_of(scene: &Scene, at: u32, q: &Query) -> Jumps {
    let i = at as usize;
    let mut always = scene.floats[i];
    let mut crease = scene.floats[i + 3];
    if q.shadows {
        always = scene.floats[i + 1];
        crease = 0.0f32;
    }
    Jumps {
        always,
        fold: scene.floats[i + 2],
        crease,
        closed: scene.floats[i + 4] > 0.0,
    }
}

/// An estimate of what a subtree contributes, 0 only if it can't, and whether it is to be entered.
#[apply(record!)]
pub(super) struct Subtree {
    pub weight: f32,
    pub enter: bool,
}

/// Of a lane of a node; `large` is the sine of the angle under which subtrees are entered.
#[cube]
pub(super) fn subtree(scene: &Scene, at: u32, q: &Query, large: f32) -> Subtree {
    let i = at as usize;
    let r = scene.vector(at) - q.x;
    let radius = scene.floats[i + 3];
    let cos = scene.floats[i + 7];
    let sin = scene.floats[i + 8];
    let jumps = jumps_of(scene, at + 9, q);
    let squared = r.length_squared();
    let distance = squared.sqrt();
    let along = r.dot(q.axis);
    let across = (squared - along * along).max(0.0).sqrt();
    let beside = across * q.cos - along * q.sin;
    // The angle under which the sphere is seen.
    let sin_seen = (radius / distance.max(1e-20)).min(1.0);
    let cos_seen = (1.0 - sin_seen * sin_seen).max(0.0).sqrt();
    let sin_sum = sin * cos_seen + cos * sin_seen;
    let cos_sum = cos * cos_seen - sin * sin_seen;
    let facing = scene.vector(at + 4).dot(r) / distance.max(1e-20);
    // Where normals and directions spread over more than a half-space anything is possible.
    let narrow = cos_sum > 0.0 && distance >= radius;
    let mut fold = jumps.fold / (sin_sum.abs() + 0.05);
    if narrow && sin_sum < facing.abs() {
        fold = 0.0f32;
    }
    let mut crease = jumps.crease;
    if narrow && sin_sum < facing && jumps.closed {
        crease = 0.0f32;
    }
    let nearest = ((along + radius) / (distance + radius).max(1e-30))
        .max(0.0)
        .min(1.0);
    let mut weight =
        (jumps.always + fold + crease) * lobe(q, nearest) / (squared + radius * radius).max(1e-37);
    if radius < beside {
        weight = 0.0f32;
    }
    Subtree {
        weight,
        enter: beside + radius >= 0.0 || sin_seen >= large,
    }
}

/// Lengths that are divided by are at least this.
const TINY: f32 = 1e-30;

/// An estimate of what an edge contributes, of a lane of a leaf; 0 only if it can't.
#[cube]
pub(super) fn weight_of_edge(scene: &Scene, at: u32, q: &Query) -> f32 {
    let mut r = scene.vector(at) - q.x;
    if comptime!(scene.features.moves) {
        r += scene.vector(at + 12) * q.time;
    }
    let e = scene.vector(at + 3);
    let half = scene.floats[at as usize + 15];
    let jumps = jumps_of(scene, at + 16, q);
    // A length that is not less than the distance to any point of the edge.
    let away = r.abs().element_sum() + half;
    // The point's height over both faces: r leads from it to the edge's middle, which lies in both.
    let front = -scene.vector(at + 6).dot(r);
    let back = -scene.vector(at + 9).dot(r);
    let mut jump = 0.0f32;
    // Edges of a plane that the point lies in are seen from the side alone.
    if front.abs().min(back.abs()) >= away * 1e-6 {
        if front * back < 0.0 {
            jump = jumps.fold;
        } else if !(jumps.closed && front <= 0.0 && back <= 0.0) {
            jump = jumps.crease;
        }
    }
    jump += jumps.always;
    let mut weight = 0.0f32;
    if jump > 0.0 {
        if q.cos > 0.0 {
            weight = jump * in_cone(q, r, e, half);
        } else {
            weight = jump * over_horizon(q, r, e, half, away);
        }
    }
    weight
}

/// The angle under which an edge is seen, about, and its distance.
#[apply(record!)]
struct Seen {
    angle: f32,
    near: f32,
}

#[cube]
fn seen(r: V3, e: V3, half: f32) -> Seen {
    let length = (half + half).max(TINY);
    let swept = e.cross(r).length();
    let line = swept / length;
    let beyond = (e.dot(r).abs() / length - half).max(0.0);
    let near = (line * line + beyond * beyond).sqrt() + 1e-20;
    Seen {
        angle: swept / (near * (near + length)),
        near,
    }
}

/// Angle over distance times lobe, of the part of an edge in the query's cone.
#[cube]
fn in_cone(q: &Query, r: V3, e: V3, half: f32) -> f32 {
    let c = e.cross(r);
    let swept = c.length();
    let along = r.dot(q.axis);
    let rise = e.dot(q.axis) * 0.5;
    let a = r - e * 0.5;
    let b = r + e * 0.5;
    let far_a = a.length() + TINY;
    let far_b = b.length() + TINY;
    let cos_a = (along - rise) / far_a;
    let cos_b = (along + rise) / far_b;
    // The sine of the angle between the axis and the plane of the edge, and whether the axis lies between its
    // ends.
    let sine = q.axis.dot(c) / (swept + TINY);
    let outside = a.cross(q.axis).dot(c) > 0.0 || q.axis.cross(b).dot(c) > 0.0;
    let by_ends = cos_a.max(cos_b);
    let mut weight = 0.0f32;
    if by_ends >= q.cos || (!outside && q.sin >= sine.abs()) {
        let chord = (q.sin * q.sin - sine * sine).max(1e-12).sqrt();
        let part = seen(r, e, half).angle.min(chord + chord);
        let mut distance = (swept * swept) / (e.cross(q.axis).dot(c).abs() + TINY);
        let mut cosine = (1.0 - sine * sine).max(0.0).sqrt();
        if outside {
            cosine = by_ends;
            distance = far_a;
            if cos_a < cos_b {
                distance = far_b;
            }
        }
        weight = part / (distance + TINY) * lobe(q, cosine.max(0.0));
    }
    weight
}

/// Angle over distance, times about cos θ where the query has a lobe, of an edge over the horizon.
#[cube]
fn over_horizon(q: &Query, r: V3, e: V3, half: f32, away: f32) -> f32 {
    let along = r.dot(q.axis);
    let rise = e.dot(q.axis) * 0.5;
    // The sum of the heights of both ends.
    let height = (along + rise).max(0.0) + (along - rise).max(0.0);
    let mut weight = 0.0f32;
    if height > 0.0 {
        let s = seen(r, e, half);
        weight = s.angle / s.near;
        if q.exponent > 0.0 {
            weight *= height / (away + away);
        }
    }
    weight
}
