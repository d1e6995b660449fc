//! The table of the scenes whose lists the device makes, and the vertices that these lists are made from.

use softray_kernels::cube::*;
use softray_kernels::model::{V3, splat, v3};
use softray_kernels::trace::{HEADER, HeaderWord, NONE, TRIANGLE};

/// Number of words of a scene in the table: its first thread, the view whose header stores where its lists begin, and
/// the numbers of triangles, triangles for rays, edges, edges of meshes among these, leaves of trees over edges, those
/// below nodes among these, and parts of the first level of the tree over triangles. Then come the start of this tree's
/// children, and the parts of this tree and of the tree over edges: where their nodes, starts and levels begin, and the
/// number of levels ([`Parts`](softray_kernels::accel::Parts)).
pub(super) const OF_SCENE: usize = 18;
/// The places of some of these words: both numbers of leaves, the start of the children, and both parts.
pub(super) const LEAVES: usize = 6;
pub(super) const BOUNDED: usize = 7;
pub(super) const CHILDREN_AT: usize = 9;
pub(super) const TRIANGLE_PARTS: usize = 10;
pub(super) const EDGE_PARTS: usize = 14;

/// The starts of the lists of a tree's parts.
#[derive(CubeType, Clone, Copy)]
#[expand(derive(Clone, Copy))]
pub(super) struct PartsAt {
    pub nodes: u32,
    pub starts: u32,
    levels: u32,
    level_count: u32,
}

/// Returns the starts of the lists of parts, given their place in the table.
#[cube]
pub(super) fn parts_at(words: &[u32], place: usize) -> PartsAt {
    PartsAt {
        nodes: words[place],
        starts: words[place + 1],
        levels: words[place + 2],
        level_count: words[place + 3],
    }
}

#[cube]
impl PartsAt {
    /// Returns part `k` of a level, or [`NONE`].
    pub fn of_level(&self, words: &[u32], level: u32, k: u32) -> u32 {
        let mut part = NONE.runtime();
        if level < self.level_count {
            let first = (self.levels + level) as usize;
            let own = words[first] + k;
            if own < words[first + 1] {
                part = own;
            }
        }
        part
    }
}

/// The starts of a scene's lists in the buffers.
#[derive(CubeType, Clone, Copy)]
#[expand(derive(Clone, Copy))]
pub(super) struct At {
    pub vertices: u32,
    pub rows: u32,
    pub triangles: u32,
    pub velocities: u32,
    pub edges: u32,
    pub of_edges: u32,
    pub kinds: u32,
    pub creases: u32,
    pub crossings: u32,
    /// Number of edges of meshes.
    pub meshes: u32,
    #[cube(comptime)]
    pub moves: bool,
}

/// Returns the starts of the lists of a scene, given its place in the table.
#[cube]
pub(super) fn lists_at(words: &[u32], scene: u32, #[comptime] moves: bool) -> At {
    let header = words[scene as usize + 1] as usize * HEADER;
    At {
        vertices: words[header + comptime!(HeaderWord::vertices as usize)],
        rows: words[header + comptime!(HeaderWord::vertex_rows as usize)],
        triangles: words[header + comptime!(HeaderWord::triangles as usize)],
        velocities: words[header + comptime!(HeaderWord::velocities as usize)],
        edges: words[header + comptime!(HeaderWord::edges as usize)],
        of_edges: words[header + comptime!(HeaderWord::of_edges as usize)],
        kinds: words[header + comptime!(HeaderWord::edge_kinds as usize)],
        creases: words[header + comptime!(HeaderWord::creases as usize)],
        crossings: words[header + comptime!(HeaderWord::crossings as usize)],
        meshes: words[scene as usize + 5],
        moves,
    }
}

/// Reads three numbers of a list that the kernel also writes.
#[cube]
pub(super) fn read(floats: &mut [f32], at: u32) -> V3 {
    let i = at as usize;
    v3(floats[i], floats[i + 1], floats[i + 2])
}

#[cube]
pub(super) fn write(floats: &mut [f32], at: u32, v: V3) {
    let i = at as usize;
    floats[i] = v.x;
    floats[i + 1] = v.y;
    floats[i + 2] = v.z;
}

/// Returns the position of a vertex, rounded to f32. Each coordinate is stored as a sum of two numbers: the rounded
/// value and a remainder.
#[cube]
pub(super) fn vertex(floats: &mut [f32], at: At, row: u32) -> V3 {
    read(floats, at.vertices + 6 * row)
}

/// Returns the vector from one vertex to another, computed from both numbers of each coordinate.
#[cube]
pub(super) fn between(floats: &mut [f32], at: At, from: u32, to: u32) -> V3 {
    let (from, to) = (at.vertices + 6 * from, at.vertices + 6 * to);
    let coarse = read(floats, to) - read(floats, from);
    coarse + (read(floats, to + 3) - read(floats, from + 3))
}

/// Returns the displacement of a triangle over the shutter time.
#[cube]
pub(super) fn velocity(floats: &mut [f32], words: &[u32], at: At, triangle: u32) -> V3 {
    let mut v = splat(0.0);
    if comptime!(at.moves) {
        let object = words[(at.triangles + TRIANGLE * triangle) as usize + 1];
        v = read(floats, at.velocities + 3 * object);
    }
    v
}
