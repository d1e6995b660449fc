//! Points of edges drawn as a point sees them, the faces on their two sides, and their derivatives:
//! `kernel/boundary/edge_point` in a kernel of a GPU.

use crate::cube::*;

use super::Derivatives;
use super::crossing::{Line, line_of_crossing};
use super::edge_layout::{
    EDGES, IS_CROSSING, OBJECT_OF_EDGE, OF_EDGE, OF_EDGES, ROWS_OF_EDGE, root_of,
};
use super::hit::Unseen;
use super::holes::is_open_at;
use super::layout::{FIRST_SUMS, NONE, OF_TRIANGLE, OF_TRIANGLES, SURFACE_STRIDE, SURFACES};
use super::reading::Scene;
use super::reading::weights_in;
use super::sums::{Totals, VELOCITIES, VERTICES};
use super::surface::displacement;
use super::surface_backward::{add_to_corners, is_wanted};
use crate::kernel::{DrawnEdge, NO_EDGE, draw_edge};
use crate::model::bsdf::Shading;
use crate::model::choice::decided_by;
use crate::model::edge::is_above;
use crate::model::edge_weight::Query;
use crate::model::jumps::{Sides, by_crossing_plane, farthest};
use crate::model::segment::{clip_to_cone, point_by_angle};
use crate::model::{V3, splat};

/// A point of an edge that is seen from a point.
#[apply(record!)]
pub(super) struct EdgePoint {
    /// Where its words begin.
    pub edge: u32,
    pub a: V3,
    pub along: V3,
    pub crossing: bool,
    pub faces: Unseen,
    /// Its place on the edge, from a to b, and 1 over the density with which it was drawn; 0 if there is none.
    pub lambda: f32,
    pub per_density: f32,
    /// Whether it is there at its time.
    pub exists: bool,
    /// The vector from the point that sees it.
    pub to: V3,
    pub position: V3,
}

/// The object of a triangle.
#[cube]
pub(super) fn object_of(scene: &Scene, triangle: u32) -> u32 {
    scene.words[(scene.header[OF_TRIANGLES] + OF_TRIANGLE as u32 * triangle) as usize + 1]
}

/// The vector by which a triangle has moved at a time.
#[cube]
pub(super) fn shift_of(scene: &Scene, triangle: u32, time: f32) -> V3 {
    let mut shift = splat(0.0);
    if comptime!(scene.features.moves) {
        shift = displacement(scene, object_of(scene, triangle), time);
    }
    shift
}

/// An edge as it is at a time, but for its object's motion; not yet a point of it.
#[cube]
pub(super) fn edge_of(scene: &Scene, index: u32, time: f32) -> EdgePoint {
    let at = scene.header[EDGES] + 6 * index;
    let edge = scene.header[OF_EDGES] + OF_EDGE * index;
    let i = edge as usize;
    let crossing = scene.words[(edge + IS_CROSSING) as usize];
    let mut p = EdgePoint {
        edge,
        a: scene.vector(at),
        along: scene.vector(at + 3),
        crossing: crossing != 0,
        faces: Unseen {
            a: scene.words[i],
            b: scene.words[i + 1],
            c: scene.words[i + 2],
            d: scene.words[i + 3],
        },
        lambda: 0.0f32,
        per_density: 0.0f32,
        exists: true,
        to: splat(0.0),
        position: splat(0.0),
    };
    if comptime!(scene.features.flying_crossings) {
        if crossing == 2 {
            let first = p.faces.a;
            let second = p.faces.b;
            let shift = shift_of(scene, first, time);
            let other = shift_of(scene, second, time);
            let line: Line = line_of_crossing(scene, first, second, shift, other);
            p.exists = line.exists;
            p.a = line.a - shift;
            p.along = line.b - line.a;
        }
    }
    p
}

/// Draws a point of an edge in a cone of directions, above the surface that sees it.
#[cube]
pub(super) fn edge_point(
    scene: &Scene,
    room: &mut [u32],
    tree: usize,
    query: &Query,
    shading: &Shading,
    u: f32,
    v: f32,
    #[comptime] of: Derivatives,
) -> EdgePoint {
    let root = root_of(scene, tree, comptime!(of.edge_nodes));
    let drawn: DrawnEdge = draw_edge(&root, room, query, decided_by(u, v));
    let mut index = 0u32;
    if drawn.edge != NO_EDGE {
        index = drawn.edge;
    }
    let mut p = edge_of(scene, index, query.time);
    if drawn.edge != NO_EDGE && p.exists {
        let a = p.a + shift_of(scene, p.faces.a, query.time) - query.x;
        let part = clip_to_cone(a, p.along, query.axis, query.cos);
        if part.from < part.to {
            let on = point_by_angle(a, p.along, part, v);
            p.lambda = on.lambda;
            p.to = a + p.along * on.lambda;
            p.position = query.x + p.to;
            if is_above(shading, p.to, p.position) {
                p.per_density = on.per_density * drawn.per_chance;
            }
        }
    }
    p
}

/// The vector from a point of an edge's line to that corner of a face that is farthest from the line.
#[cube]
fn into_face(scene: &Scene, face: u32, p: &EdgePoint, time: f32) -> V3 {
    let at = scene.header[SURFACES] + SURFACE_STRIDE as u32 * face;
    let mut on_line = p.a;
    if comptime!(scene.features.flying_crossings) {
        if scene.words[(p.edge + IS_CROSSING) as usize] == 2 {
            // Where the face was at rest.
            on_line = p.position - shift_of(scene, face, time);
        }
    }
    farthest(
        scene.vector(at) - on_line,
        scene.vector(at + 3) - on_line,
        scene.vector(at + 6) - on_line,
        p.along,
    )
}

/// The faces of an edge that are seen on its two sides, the second towards `side`.
#[cube]
pub(super) fn sides(scene: &Scene, p: &EdgePoint, view: V3, side: V3, time: f32) -> Sides {
    let mut sides = Sides::new(p.along, view, side);
    // Of a crossing both halves of each face.
    let mut halves = 4u32;
    if p.crossing {
        halves = 8;
    }
    let mut i = 0u32;
    while i < halves {
        let mut k = i;
        if p.crossing {
            k = i / 2;
        }
        let face = scene.words[(p.edge + k) as usize];
        let mut there = face != NONE;
        if comptime!(scene.features.holes) {
            if there {
                let at_rest = p.position - shift_of(scene, face, time);
                there = !is_open_at(scene, face, at_rest);
            }
        }
        if there {
            let mut inward = into_face(scene, face, p, time);
            if p.crossing && i & 1 == 1 {
                inward = -inward;
            }
            sides.add(face, inward, p.along, view);
        }
        i += 1;
    }
    sides.pass(p.to, p.position);
    sides
}

/// Adds a derivative by an edge's point, to what the edge moves with.
#[cube]
pub(super) fn add_to_edge(scene: &Scene, sums: &Totals, p: &EdgePoint, g: V3, time: f32) {
    if p.crossing {
        // A point of a line in which two planes cross moves with both.
        let mut k = 0u32;
        while k < 2 {
            let mut face = p.faces.a;
            let mut other = p.faces.b;
            if k == 1 {
                face = p.faces.b;
                other = p.faces.a;
            }
            let object = object_of(scene, face);
            if is_wanted(scene, object) {
                let at = scene.header[SURFACES] + SURFACE_STRIDE as u32 * face;
                let beyond = scene.header[SURFACES] + SURFACE_STRIDE as u32 * other;
                let normal = scene.vector(at + 9);
                let crossed = scene.vector(beyond + 9);
                let at_rest = p.position - shift_of(scene, face, time);
                let weights = weights_in(scene, face, at_rest);
                let by_plane = by_crossing_plane(normal, crossed, g);
                add_to_corners(scene, sums, face, object, weights, by_plane, time);
            }
            k += 1;
        }
    } else {
        let object = scene.words[(p.edge + OBJECT_OF_EDGE) as usize];
        if is_wanted(scene, object) {
            let first = scene.header[FIRST_SUMS + VERTICES];
            let mut k = 0u32;
            while k < 4 {
                let row = scene.words[(p.edge + ROWS_OF_EDGE + k) as usize];
                let mut weight = 0.5 * (1.0 - p.lambda);
                if k & 1 == 1 {
                    weight = 0.5 * p.lambda;
                }
                let at = first + 3 * row;
                sums.add_vector(at, g * weight, VERTICES);
                k += 1;
            }
            if comptime!(sums.of.velocities) {
                let at = scene.header[FIRST_SUMS + VELOCITIES] + 3 * object;
                sums.add_vector(at, g * time, VELOCITIES);
            }
        }
    }
}
