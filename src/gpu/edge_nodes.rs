//! The bounds of edges, and the nodes of trees over edges, which the device makes from leaves: a tree in parts, each by
//! one thread.

use super::vertices::{BOUNDED, LEAVES, PartsAt, read, write};
use softray_kernels::accel::LANES;
use softray_kernels::cube::*;
use softray_kernels::kernel::{Bounds, LEAF, NODE, put_subtree};
use softray_kernels::model::edge_weight::Jumps;
use softray_kernels::trace::{HEADER, HeaderWord, NONE};

/// The number of numbers of bounds: corners of the box, sum of normals, sine, jumps, number of folds.
pub(super) const BOUNDS: u32 = 17;

/// The starts of the lists of a scene's tree over edges in the buffers. The bounds of leaves and then those of nodes are
/// behind the leaves of all trees.
#[derive(CubeType, Clone, Copy)]
#[expand(derive(Clone, Copy))]
pub(super) struct EdgeTreeAt {
    nodes: u32,
    children: u32,
    bounds: u32,
    /// The number of leaves below nodes. Only these have bounds.
    pub bounded: u32,
}

/// Returns the starts of the lists of a scene's tree over edges, given the scene's place in the table.
#[cube]
pub(super) fn edge_tree_at(words: &[u32], scene: u32) -> EdgeTreeAt {
    let header = words[scene as usize + 1] as usize * HEADER;
    let leaves = words[header + comptime!(HeaderWord::edge_leaves as usize)];
    EdgeTreeAt {
        nodes: words[header + comptime!(HeaderWord::edge_nodes as usize)],
        children: words[header + comptime!(HeaderWord::edge_children as usize)],
        bounds: leaves + (LANES * LEAF) as u32 * words[scene as usize + LEAVES],
        bounded: words[scene as usize + BOUNDED],
    }
}

#[cube]
impl EdgeTreeAt {
    /// Returns where the bounds of a child begin.
    fn bounds_of(&self, child: u32) -> u32 {
        let before = select(child & 1 == 1, 0u32, self.bounded);
        self.bounds + BOUNDS * (before + child / 2)
    }

    /// Writes the bounds of a leaf.
    pub fn put_leaf(&self, floats: &mut [f32], leaf: u32, b: &Bounds) {
        put_bounds(floats, self.bounds_of(2 * leaf + 1), b);
    }

    /// Writes a node: the bounds of its branches. Branches that are missing are zeros.
    fn put_node(&self, floats: &mut [f32], words: &[u32], node: u32) {
        let lanes = repeated(LANES, node) as u32;
        let children = self.children + lanes * node;
        let block = self.nodes + lanes * NODE as u32 * node;
        let mut all = Bounds::none();
        for i in 0..lanes {
            let child = words[(children + i) as usize];
            let to = block + NODE as u32 * i;
            if child == NONE {
                for k in 0..NODE as u32 {
                    floats[(to + k) as usize] = 0.0;
                }
            } else {
                let part = bounds_at(floats, self.bounds_of(child));
                let subtree = part.subtree();
                put_subtree(floats, to as usize, &subtree);
                all.add_part(&part);
            }
        }
        let axis = all.axis();
        let mut sin_half = 0.0f32;
        for i in 0..lanes {
            let child = words[(children + i) as usize];
            if child != NONE {
                let part = bounds_at(floats, self.bounds_of(child));
                sin_half = max(sin_half, part.reach(axis));
            }
        }
        let bounds = all.with_cone(sin_half);
        put_bounds(floats, self.bounds_of(2 * node), &bounds);
    }
}

/// Returns bounds from a list.
#[cube]
fn bounds_at(floats: &mut [f32], at: u32) -> Bounds {
    let rest = at as usize + 9;
    Bounds {
        low: read(floats, at),
        high: read(floats, at + 3),
        folds: floats[rest + 6],
        normals: read(floats, at + 6),
        sin_half: floats[rest],
        jumps: Jumps {
            seen_always: floats[rest + 1],
            passes_always: floats[rest + 2],
            fold: floats[rest + 3],
            crease: floats[rest + 4],
            followed: floats[rest + 7],
            closed: floats[rest + 5],
        },
    }
}

#[cube]
fn put_bounds(floats: &mut [f32], at: u32, b: &Bounds) {
    write(floats, at, b.low);
    write(floats, at + 3, b.high);
    write(floats, at + 6, b.normals);
    let rest = at as usize + 9;
    floats[rest] = b.sin_half;
    floats[rest + 1] = b.jumps.seen_always;
    floats[rest + 2] = b.jumps.passes_always;
    floats[rest + 3] = b.jumps.fold;
    floats[rest + 4] = b.jumps.crease;
    floats[rest + 5] = b.jumps.closed;
    floats[rest + 6] = b.folds;
    floats[rest + 7] = b.jumps.followed;
}

/// Writes all nodes of a part.
#[cube]
pub(super) fn make_edge_part(
    floats: &mut [f32],
    words: &[u32],
    tree: EdgeTreeAt,
    parts: PartsAt,
    part: u32,
) {
    let mut k = words[(parts.starts + part) as usize];
    let past = words[(parts.starts + part) as usize + 1];
    while k < past {
        let node = words[(parts.nodes + k) as usize];
        tree.put_node(floats, words, node);
        k += 1;
    }
}
