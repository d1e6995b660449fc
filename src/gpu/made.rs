//! Lists that the device makes from vertices and from data that stays the same while vertices move: triangles for
//! paths, triangles for rays, edges, the leaves of trees over edges, and the nodes of trees over triangles.

use super::edge_nodes::{EdgeTreeAt, edge_tree_at};
use super::nodes::{make_part, tree_at};
use super::vertices::{At, LEAVES, OF_SCENE, between, lists_at, read, velocity, vertex, write};
use softray_kernels::accel::{LANES, ROUNDING, hit_stride};
use softray_kernels::cube::*;
use softray_kernels::kernel::{Bounds, LEAF, put_edge};
use softray_kernels::model::edge_weight::{Jumps, SeenEdge};
use softray_kernels::model::triangle::{NUMBERS, has_area};
use softray_kernels::model::{V3, splat, v3};
use softray_kernels::trace::{HEADER, HeaderWord, NONE, OF_EDGE, ROWS_OF_EDGE};

/// A triangle, computed from its vertices.
#[apply(record!)]
struct Face {
    a: V3,
    b: V3,
    c: V3,
    /// The vectors from each corner to the next.
    ab: V3,
    bc: V3,
    ca: V3,
    normal: V3,
    offset: f32,
    area: f32,
    /// Whether it has area.
    valid: bool,
}

#[cube]
fn face(floats: &mut [f32], words: &[u32], at: At, triangle: u32) -> Face {
    let rows = (at.rows + 3 * triangle) as usize;
    let (a, b, c) = (words[rows], words[rows + 1], words[rows + 2]);
    let ab = between(floats, at, a, b);
    let bc = between(floats, at, b, c);
    let ca = between(floats, at, c, a);
    // Scaled, so that products of tiny lengths do not underflow to zero.
    let size = ab.abs().max(ca.abs()).max_element();
    let scale = 1.0 / size.max(1e-37);
    let across = (ca * scale).cross(ab * scale);
    let doubled = across.length();
    let area = 0.5 * doubled * size * size;
    let valid = has_area(area);
    let corner = vertex(floats, at, a);
    let mut normal = v3(0.0, 0.0, 1.0);
    let mut offset = 0.0f32;
    if valid {
        normal = across * (1.0 / doubled);
        let rest = read(floats, at.vertices + 6 * a + 3);
        offset = normal.dot(corner) + normal.dot(rest);
    }
    Face {
        a: corner,
        b: vertex(floats, at, b),
        c: vertex(floats, at, c),
        ab,
        bc,
        ca,
        normal,
        offset,
        area: select(valid, area, 0.0),
        valid,
    }
}

/// Writes a triangle for paths ([`Triangle`](softray_kernels::model::triangle::Triangle)).
#[cube]
fn make_surface(floats: &mut [f32], to: u32, f: &Face) {
    write(floats, to, f.a);
    write(floats, to + 3, f.b);
    write(floats, to + 6, f.c);
    write(floats, to + 9, f.normal);
    floats[(to + 12) as usize] = f.offset;
    floats[(to + 13) as usize] = f.area;
}

/// Returns the unit vector across a side of a triangle, which points into it.
#[cube]
fn inwards(f: &Face, along: V3) -> V3 {
    let across = f.normal.cross(along);
    across * (1.0 / across.length())
}

/// Writes the line through a side of a triangle as a distance function that is positive inside, and larger than the
/// distance by an error.
#[cube]
fn make_line(floats: &mut [f32], to: u32, across: V3, distance: f32, error: f32) {
    write(floats, to, across);
    floats[to as usize + 3] = distance + error;
}

/// Writes a triangle for rays: its plane, the lines through its sides, and the displacement over the shutter time if
/// anything moves. A triangle that is never hit is written as zeros.
#[cube]
fn make_hit(floats: &mut [f32], to: u32, f: &Face, velocity: V3, #[comptime] moves: bool) {
    for i in 0..comptime!(hit_stride(moves)) {
        floats[(to + i) as usize] = 0.0;
    }
    if f.valid {
        write(floats, to, f.normal);
        floats[to as usize + 3] = -f.offset;
        let ab = inwards(f, f.ab);
        let bc = inwards(f, f.bc);
        let ca = inwards(f, f.ca);
        let from_ab = -ab.dot(f.a);
        let from_bc = -bc.dot(f.b);
        let from_ca = -ca.dot(f.c);
        // The rounding error of the distances, enlarged by that of their sums with it.
        let largest = from_ab.abs().max(from_bc.abs()).max(from_ca.abs());
        let error = 1.25 * ROUNDING * largest;
        make_line(floats, to + 4, ab, from_ab, error);
        make_line(floats, to + 8, bc, from_bc, error);
        make_line(floats, to + 12, ca, from_ca, error);
        if comptime!(moves) {
            write(floats, to + 16, velocity);
        }
    }
}

/// An edge: one end, and the vector to the other end.
#[apply(record!)]
struct Line {
    start: V3,
    along: V3,
}

#[cube]
fn edge(floats: &mut [f32], words: &[u32], at: At, index: u32) -> Line {
    let mut start = splat(0.0);
    let mut along = splat(0.0);
    if index < at.meshes {
        let rows = (at.of_edges + OF_EDGE as u32 * index + ROWS_OF_EDGE) as usize;
        start = vertex(floats, at, words[rows]);
        along = vertex(floats, at, words[rows + 1]) - start;
    } else {
        let crossing = at.crossings + 6 * (index - at.meshes);
        start = read(floats, crossing);
        along = read(floats, crossing + 3);
    }
    Line { start, along }
}

/// Returns an edge with its first face as trees over edges store it.
#[cube]
fn seen_edge(floats: &mut [f32], words: &[u32], at: At, index: u32, first: u32) -> SeenEdge {
    let line = edge(floats, words, at, index);
    let second = words[(at.of_edges + OF_EDGE as u32 * index) as usize + 1];
    let front = face(floats, words, at, first).normal;
    // An edge with one face has the normal of that face twice.
    let back = face(floats, words, at, select(second == NONE, first, second)).normal;
    let kind = words[(at.kinds + index) as usize];
    let crease = floats[(at.creases + index) as usize];
    SeenEdge {
        to: line.start + line.along * 0.5,
        half: 0.5 * line.along.length(),
        along: line.along,
        front,
        back,
        jumps: Jumps::of_kind(kind, crease),
    }
}

/// Writes the edges of a leaf, zeros at places that are empty, and the bounds of the edges if the leaf is below a node.
#[cube]
fn make_leaf(floats: &mut [f32], words: &[u32], at: At, tree: EdgeTreeAt, scene: u32, leaf: u32) {
    let header = words[scene as usize + 1] as usize * HEADER;
    let lanes = repeated(LANES, leaf) as u32;
    let edges = words[header + comptime!(HeaderWord::edges_of_leaves as usize)] + lanes * leaf;
    let leaves = words[header + comptime!(HeaderWord::edge_leaves as usize)];
    let block = leaves + LEAF as u32 * lanes * leaf;
    let mut bounds = Bounds::none();
    for lane in 0..lanes {
        let index = words[(edges + lane) as usize];
        let to = block + LEAF as u32 * lane;
        if index == NONE {
            for k in 0..LEAF as u32 {
                floats[(to + k) as usize] = 0.0;
            }
        } else {
            let first = words[(at.of_edges + OF_EDGE as u32 * index) as usize];
            let seen = seen_edge(floats, words, at, index, first);
            let v = velocity(floats, words, at, first);
            put_edge(floats, to as usize, &seen, v);
            bounds.add_edge(&seen, v);
        }
    }
    if leaf < tree.bounded {
        let bounds = bounds.over_leaf(floats, block as usize, LEAF);
        tree.put_leaf(floats, leaf, &bounds);
    }
}

/// Makes the lists of all scenes. Each thread makes one triangle, edge, leaf of edges, or part of the first level of a
/// tree over triangles.
#[cube(launch)]
pub(super) fn make_lists(
    floats: &mut [f32],
    words: &[u32],
    table: u32,
    scenes: u32,
    threads: u32,
    #[comptime] moves: bool,
) {
    let index = ABSOLUTE_POS as u32;
    if index < threads {
        let of_scene = OF_SCENE as u32;
        let mut scene = table;
        while scene + of_scene < table + scenes * of_scene
            && words[(scene + of_scene) as usize] <= index
        {
            scene += of_scene;
        }
        let s = scene as usize;
        let mut own = index - words[s];
        let header = words[s + 1] as usize * HEADER;
        let at = lists_at(words, scene, moves);
        let (faces, hits) = (words[s + 2], words[s + 3]);
        let (edges, leaves) = (words[s + 4], words[s + LEAVES]);
        if own < faces {
            let f = face(floats, words, at, own);
            let surfaces = words[header + comptime!(HeaderWord::surfaces as usize)];
            make_surface(floats, surfaces + NUMBERS as u32 * own, &f);
        } else if own < faces + hits {
            own -= faces;
            let numbers = words[header + comptime!(HeaderWord::hit_numbers as usize)];
            let triangle = words[(numbers + own) as usize];
            let f = face(floats, words, at, triangle);
            let v = velocity(floats, words, at, triangle);
            let to = words[header + comptime!(HeaderWord::hits as usize)];
            let stride = comptime!(hit_stride(moves));
            make_hit(floats, to + stride * own, &f, v, moves);
        } else if own < faces + hits + edges {
            own -= faces + hits;
            let line = edge(floats, words, at, own);
            write(floats, at.edges + 6 * own, line.start);
            write(floats, at.edges + 6 * own + 3, line.along);
        } else if own < faces + hits + edges + leaves {
            own -= faces + hits + edges;
            make_leaf(floats, words, at, edge_tree_at(words, scene), scene, own);
        } else {
            own -= faces + hits + edges + leaves;
            make_part(floats, words, at, tree_at(words, scene), own);
        }
    }
}
