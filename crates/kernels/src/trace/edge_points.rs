//! Sampled points of edges seen from a point, the faces on their two sides, and their derivatives.

use crate::cube::*;

use super::parts::{VELOCITIES, VERTICES};
#[cfg(feature = "gpu")]
use super::scene::SceneExpand;
use super::scene::{NONE, Scene};
use super::sums::Sums;
use crate::model::bsdf::Shading;
use crate::model::crossing::{Line, line_of_crossing};
use crate::model::edge::is_above;
use crate::model::edge_weight::Query;
use crate::model::jumps::{Sides, by_crossing_plane, farthest};
use crate::model::lists::vector;
use crate::model::segment::{clip_to_cone, point_by_angle};
use crate::model::{V3, select_vector};

/// Up to four triangles; [`NONE`] where there are fewer.
#[apply(zeroed!)]
pub struct Faces {
    pub a: u32,
    pub b: u32,
    pub c: u32,
    pub d: u32,
}

#[cfg_attr(feature = "gpu", cube)]
impl Faces {
    #[inline(always)]
    pub fn contains(self, triangle: u32) -> bool {
        triangle == self.a || triangle == self.b || triangle == self.c || triangle == self.d
    }
}

/// A point of an edge, seen from another point.
#[apply(zeroed!)]
pub struct EdgePoint {
    /// Index of the edge's first word.
    pub edge: u32,
    pub a: V3,
    pub along: V3,
    pub crossing: bool,
    pub faces: Faces,
    /// Its position on the edge, from a to b, and the reciprocal of its sampling density; 0 if there is no point.
    pub lambda: f32,
    pub per_density: f32,
    /// Whether the edge exists at its time.
    pub exists: bool,
    /// The vector to it from the point that sees it.
    pub to: V3,
    pub position: V3,
}

/// Words of an edge: its faces, the rows of its ends in the vertices of the first two faces, its object, and 1 for a
/// crossing, or 2 for a crossing whose line moves during the shutter.
pub const OF_EDGE: usize = 10;
pub const ROWS_OF_EDGE: u32 = 4;
const OBJECT_OF_EDGE: u32 = 8;
pub(super) const IS_CROSSING: u32 = 9;

/// Returns an edge at a time, without its object's motion; the point on it is not set yet.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn edge_of(scene: &Scene, index: u32, time: f32) -> EdgePoint {
    let edge = OF_EDGE as u32 * index;
    let list = &scene.of_edges[edge as usize..];
    let crossing = list[IS_CROSSING as usize];
    let mut p = EdgePoint::default();
    p.edge = edge;
    p.a = vector(scene.edges, 6 * index);
    p.along = vector(scene.edges, 6 * index + 3);
    p.crossing = crossing != 0;
    p.faces = Faces {
        a: list[0],
        b: list[1],
        c: list[2],
        d: list[3],
    };
    p.exists = true;
    if comptime!(scene.features.moves) && crossing == 2 {
        let shift = scene.shift(p.faces.a, time);
        let other = scene.shift(p.faces.b, time);
        let t = scene.triangle(p.faces.a).moved(shift);
        let s = scene.triangle(p.faces.b).moved(other);
        let line: Line = line_of_crossing(&t, &s);
        p.exists = line.exists;
        p.a = line.a - shift;
        p.along = line.b - line.a;
    }
    p
}

#[cfg_attr(feature = "gpu", cube)]
impl<'a> Scene<'a> {
    /// Returns whether derivatives with respect to the position of an edge are required.
    #[inline(always)]
    pub fn edge_moves(&self, edge: u32) -> bool {
        let list = &self.of_edges[OF_EDGE * edge as usize..];
        let mut moves = false;
        if list[IS_CROSSING as usize] != 0 {
            let first = self.is_wanted(self.object_of(list[0]));
            moves = first || self.is_wanted(self.object_of(list[1]));
        } else {
            moves = self.is_wanted(list[OBJECT_OF_EDGE as usize]);
        }
        moves
    }
}

/// Samples a point on a drawn edge, in the part that lies in the query's cone and above the surface that sees it.
/// `per_chance` is 1 over the edge's probability.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn edge_point(
    scene: &Scene,
    edge: u32,
    per_chance: f32,
    query: &Query,
    shading: &Shading,
    v: f32,
) -> EdgePoint {
    let mut p = edge_of(scene, edge, query.time);
    let a = p.a + scene.shift(p.faces.a, query.time) - query.x;
    let part = clip_to_cone(a, p.along, query.axis, query.cos);
    if p.exists && part.from < part.to {
        let on = point_by_angle(a, p.along, part, v);
        p.lambda = on.lambda;
        p.to = a + p.along * on.lambda;
        p.position = query.x + p.to;
        if is_above(shading, p.to, p.position) {
            p.per_density = on.per_density * per_chance;
        }
    }
    p
}

/// Returns the vector from a point of an edge's line to the corner of a face that is farthest from the line.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn into_face(scene: &Scene, face: u32, p: &EdgePoint, time: f32) -> V3 {
    let on = scene.triangle(face);
    let mut on_line = p.a;
    if comptime!(scene.features.moves) {
        if scene.of_edges[(p.edge + IS_CROSSING) as usize] == 2 {
            // Relative to the face at rest.
            on_line = p.position - scene.shift(face, time);
        }
    }
    farthest(on.a - on_line, on.b - on_line, on.c - on_line, p.along)
}

/// Returns the faces of an edge that are seen on its two sides; the + side lies toward `side`.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn sides(scene: &Scene, p: &EdgePoint, view: V3, side: V3, time: f32) -> Sides {
    let mut sides = Sides::new(p.along, view, side);
    // 1 for a crossing, which splits each face into two halves.
    let split = select(p.crossing, 1, 0u32);
    let mut i = 0u32;
    while i < 4u32 << split {
        let face = scene.of_edges[(p.edge + (i >> split)) as usize];
        if face != NONE && !scene.is_open_at(face, p.position, time) {
            let inward = into_face(scene, face, p, time);
            let inward = select_vector(i & split == 1, -inward, inward);
            sides.add(face, inward, p.along, view);
        }
        i += 1;
    }
    sides.pass(p.to, p.position);
    sides
}

/// Adds the derivative with respect to an edge's point to the parameters that move the edge.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn add_to_edge(scene: &Scene, sums: &Sums, p: &EdgePoint, g: V3, time: f32) {
    if p.crossing {
        // A point of the line in which two planes cross moves with both.
        let mut k = 0u32;
        while k < 2 {
            let face = scene.of_edges[(p.edge + k) as usize];
            let other = scene.of_edges[(p.edge + 1 - k) as usize];
            if scene.is_wanted(scene.object_of(face)) {
                let on = scene.triangle(face);
                let weights = on.weights(p.position - scene.shift(face, time));
                let by_plane = by_crossing_plane(on.normal, scene.triangle(other).normal, g);
                scene.add_to_corners(sums, face, weights, by_plane, time);
            }
            k += 1;
        }
    } else {
        let object = scene.of_edges[(p.edge + OBJECT_OF_EDGE) as usize];
        if scene.is_wanted(object) {
            let mut k = 0u32;
            while k < 4 {
                let row = scene.of_edges[(p.edge + ROWS_OF_EDGE + k) as usize];
                let weight = select(k & 1 == 1, 0.5 * p.lambda, 0.5 * (1.0 - p.lambda));
                sums.add_vector(3 * row, g * weight, VERTICES);
                k += 1;
            }
            if comptime!(sums.of.velocities) {
                sums.add_vector(3 * object, g * time, VELOCITIES);
            }
        }
    }
}
