//! The nodes of trees over triangles, which the device makes from vertices: a tree in parts, each by one thread. The
//! launches for all levels but the first also make the nodes of trees over edges.

use super::edge_nodes::{edge_tree_at, make_edge_part};
use super::hit::FAR;
use super::vertices::{
    At, CHILDREN_AT, EDGE_PARTS, OF_SCENE, PartsAt, TRIANGLE_PARTS, lists_at, parts_at, velocity,
    vertex,
};
use softray_kernels::accel::{CHILD, CHILDREN, LEAF, OF_NODE, OTHERS, ROUNDING};
use softray_kernels::cube::*;
use softray_kernels::model::{V3, splat, v3};
use softray_kernels::trace::{HEADER, HeaderWord, NONE};

/// The starts of a tree's lists in the buffers.
#[derive(CubeType, Clone, Copy)]
#[expand(derive(Clone, Copy))]
pub(super) struct TreeAt {
    nodes: u32,
    triangles: u32,
    children: u32,
    parts: PartsAt,
}

/// Returns the starts of the lists of a scene's tree, given the scene's place in the table.
#[cube]
pub(super) fn tree_at(words: &[u32], scene: u32) -> TreeAt {
    let header = words[scene as usize + 1] as usize * HEADER;
    let scene = scene as usize;
    TreeAt {
        nodes: words[header + comptime!(HeaderWord::nodes as usize)],
        triangles: words[header + comptime!(HeaderWord::hit_numbers as usize)],
        children: words[scene + CHILDREN_AT],
        parts: parts_at(words, scene + TRIANGLE_PARTS),
    }
}

/// A box, by its lower and its upper corner.
#[apply(record!)]
struct Around {
    low: V3,
    high: V3,
}

#[cube]
impl Around {
    /// Returns a box around triangles that is larger than the margins within which they are hit, so that hits do not depend
    /// on the tree. A ray that hits the box starts at most at the distance [`FAR`] plus that of the farthest corner from the
    /// origin of coordinates, which is at most √3 times the largest coordinate L. So a margin is at most [`ROUNDING`] ×
    /// (1 + [`FAR`] + √3 L) by the origin (`gpu/hit`), plus [`ROUNDING`] × 1.25 √3 L by lines (`gpu/made`). A half more
    /// covers the rounding of intersections with the box.
    fn with_margin(&self) -> Around {
        let largest = self.low.abs().max(self.high.abs()).max_element();
        let margin = splat(1.5 * ROUNDING * (1.0 + FAR + 3.5 * largest));
        Around {
            low: (self.low - margin).max(splat(-MOST)),
            high: (self.high + margin).min(splat(MOST)),
        }
    }
}

/// The largest coordinate of a box, so that no product with the inverse of a direction overflows. What is farther away is
/// not hit through a tree.
const MOST: f32 = 1e20;

/// Returns a box that contains nothing.
#[cube]
fn nothing() -> Around {
    Around {
        low: splat(f32::MAX),
        high: splat(-f32::MAX),
    }
}

/// Returns the box around a box and a triangle over the shutter time.
#[cube]
fn with_triangle(
    floats: &mut [f32],
    words: &[u32],
    at: At,
    triangle: u32,
    mut around: Around,
) -> Around {
    let v = velocity(floats, words, at, triangle);
    for corner in 0..3u32 {
        let row = words[(at.rows + 3 * triangle + corner) as usize];
        let p = vertex(floats, at, row);
        around.low = around.low.min(p).min(p + v);
        around.high = around.high.max(p).max(p + v);
    }
    around
}

/// Returns a box of a node.
#[cube]
fn box_at(floats: &mut [f32], first: u32) -> Around {
    let center = of_axes(floats, first);
    let half = of_axes(floats, first + 2);
    Around {
        low: center - half,
        high: center + half,
    }
}

/// Returns three numbers of a node, one for each axis.
#[cube]
fn of_axes(floats: &mut [f32], first: u32) -> V3 {
    let i = first as usize;
    v3(floats[i], floats[i + 4], floats[i + 8])
}

/// Sets three numbers of a node, one for each axis.
#[cube]
fn set_of_axes(floats: &mut [f32], first: u32, v: V3) {
    let i = first as usize;
    floats[i] = v.x;
    floats[i + 4] = v.y;
    floats[i + 8] = v.z;
}

/// Writes a node: the boxes of both children, around the triangles of leaves and the boxes of nodes, and the children.
/// Each box is enlarged by the rounding errors of its intersection with rays.
#[cube]
fn make_node(floats: &mut [f32], words: &[u32], at: At, tree: TreeAt, node: u32) {
    let to = tree.nodes + OF_NODE * node;
    for side in 0..2u32 {
        let child = words[(tree.children + 2 * node + side) as usize];
        let mut around = nothing();
        if child < LEAF {
            let below = tree.nodes + 4 * (child - CHILD);
            let first = box_at(floats, below);
            let second = box_at(floats, below + 1);
            around.low = first.low.min(second.low);
            around.high = first.high.max(second.high);
        } else {
            let mut place = tree.triangles + (child & comptime!((1u32 << OTHERS) - 1));
            let past = place + ((child >> OTHERS) & 3) + 1;
            while place < past {
                let triangle = words[place as usize];
                around = with_triangle(floats, words, at, triangle, around);
                place += 1;
            }
            around = around.with_margin();
        }
        let center = around.low * 0.5 + around.high * 0.5;
        let half = (around.high - center).max(center - around.low);
        set_of_axes(floats, to + side, center);
        set_of_axes(
            floats,
            to + 2 + side,
            half + (center.abs() + half) * ROUNDING,
        );
        floats[(to + CHILDREN + side) as usize] = f32::from_bits(child);
    }
}

/// Writes all nodes of a part.
#[cube]
pub(super) fn make_part(floats: &mut [f32], words: &[u32], at: At, tree: TreeAt, part: u32) {
    let mut k = words[(tree.parts.starts + part) as usize];
    let past = words[(tree.parts.starts + part) as usize + 1];
    while k < past {
        let node = words[(tree.parts.nodes + k) as usize];
        make_node(floats, words, at, tree, node);
        k += 1;
    }
}

/// Makes the nodes of a level of all scenes' trees, with `most` threads for the tree over triangles of each scene, and
/// those of the level before of their trees over edges, with `of_edges` threads for each scene. Each thread makes one
/// part.
#[cube(launch)]
pub(super) fn make_nodes(
    floats: &mut [f32],
    words: &[u32],
    table: u32,
    scenes: u32,
    level: u32,
    most: u32,
    of_edges: u32,
    #[comptime] moves: bool,
) {
    let index = ABSOLUTE_POS as u32;
    let all = scenes * most;
    if index < all {
        let scene = table + index / most * OF_SCENE as u32;
        let tree = tree_at(words, scene);
        let part = tree.parts.of_level(words, level, index % most);
        if part != NONE {
            let at = lists_at(words, scene, moves);
            make_part(floats, words, at, tree, part);
        }
    } else if index < all + scenes * of_edges {
        let own = index - all;
        let scene = table + own / of_edges * OF_SCENE as u32;
        let parts = parts_at(words, scene as usize + EDGE_PARTS);
        let part = parts.of_level(words, level - 1, own % of_edges);
        if part != NONE {
            make_edge_part(floats, words, edge_tree_at(words, scene), parts, part);
        }
    }
}
