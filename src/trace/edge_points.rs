//! Points of edges drawn as a point sees them, the faces on their two sides, and their derivatives.

use crate::cube::*;

use super::parts::{VELOCITIES, VERTICES};
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

/// Up to four triangles, [`NONE`] where there are no more.
#[apply(zeroed!)]
pub(crate) struct Faces {
    pub a: u32,
    pub b: u32,
    pub c: u32,
    pub d: u32,
}

#[cfg_attr(feature = "wgpu", cube)]
impl Faces {
    #[inline(always)]
    pub fn contains(self, triangle: u32) -> bool {
        triangle == self.a || triangle == self.b || triangle == self.c || triangle == self.d
    }
}

/// A point of an edge that is seen from a point.
#[apply(zeroed!)]
pub(crate) struct EdgePoint {
    /// Where its words begin.
    pub edge: u32,
    pub a: V3,
    pub along: V3,
    pub crossing: bool,
    pub faces: Faces,
    /// Its place on the edge, from a to b, and 1 over the density with which it was drawn; 0 if there is none.
    pub lambda: f32,
    pub per_density: f32,
    /// Whether it is there at its time.
    pub exists: bool,
    /// The vector from the point that sees it.
    pub to: V3,
    pub position: V3,
}

/// Words of an edge: its faces, the rows of its ends in the vertices of the first two faces, its object, and
/// 1 for a crossing, 2 for one whose line moves while the shutter is open.
pub(crate) const OF_EDGE: usize = 10;
pub(crate) const ROWS_OF_EDGE: u32 = 4;
const OBJECT_OF_EDGE: u32 = 8;
const IS_CROSSING: u32 = 9;

/// An edge as it is at a time, but for its object's motion; not yet a point of it.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn edge_of(scene: &Scene, index: u32, time: f32) -> EdgePoint {
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

/// A point of an edge that was drawn, and 1 over its probability, in a cone of directions above the surface that sees it.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn edge_point(
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

/// The vector from a point of an edge's line to that corner of a face that is farthest from the line.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
fn into_face(scene: &Scene, face: u32, p: &EdgePoint, time: f32) -> V3 {
    let on = scene.triangle(face);
    let mut on_line = p.a;
    if comptime!(scene.features.moves) {
        if scene.of_edges[(p.edge + IS_CROSSING) as usize] == 2 {
            // Where the face was at rest.
            on_line = p.position - scene.shift(face, time);
        }
    }
    farthest(on.a - on_line, on.b - on_line, on.c - on_line, p.along)
}

/// The faces of an edge that are seen on its two sides, the second towards `side`.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn sides(scene: &Scene, p: &EdgePoint, view: V3, side: V3, time: f32) -> Sides {
    let mut sides = Sides::new(p.along, view, side);
    // 1 where faces are split: of a crossing both halves of each are there.
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

/// Adds a derivative by an edge's point, to what the edge moves with.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn add_to_edge(scene: &Scene, sums: &Sums, p: &EdgePoint, g: V3, time: f32) {
    if p.crossing {
        // A point of a line in which two planes cross moves with both.
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
