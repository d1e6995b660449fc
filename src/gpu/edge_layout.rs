//! Edges at which something may jump, and what draws them, in the buffers of a view ([`layout`](super::layout)).

use super::packed_scene::PackedScene;
use crate::kernel::{FlatTree, View};

/// The tree over all edges, then that over those that move, [`OF_TREE`] words each.
pub(super) const EDGE_TREES: usize = 56;
pub(super) const OF_TREE: usize = 6;
/// Of a tree: floats of nodes, [`NODE_STRIDE`] for each of eight lanes, and words: their children.
pub(super) const NODES: usize = 0;
pub(super) const CHILDREN: usize = 1;
/// Of a tree: floats of leaves, [`LEAF_STRIDE`] for each of eight lanes, and words: their edges.
pub(super) const LEAVES: usize = 2;
pub(super) const LEAF_EDGES: usize = 3;
pub(super) const NODE_COUNT: usize = 4;
pub(super) const LEAF_COUNT: usize = 5;
/// Floats: a and b − a of each edge. Words: [`OF_EDGE`] each.
pub(super) const EDGES: usize = 68;
pub(super) const OF_EDGES: usize = 69;
/// Seeds of the random numbers for edges, and for paths on both sides of them.
pub(super) const SEED_OF_EDGES: usize = 70;
pub(super) const SEED_OF_SIDES: usize = 72;
/// Groups of emitters. Floats: centre, radius and velocity. Words: first member, number of members, and whether
/// any of them moves.
pub(super) const GROUPS: usize = 74;
pub(super) const OF_GROUPS: usize = 75;
/// Words: the group of each emitter.
pub(super) const GROUP_OF_EMITTERS: usize = 76;

/// The seed of the random numbers of samples on the film.
pub(super) const SEED_OF_FILM: usize = 78;

pub(super) const NODE_STRIDE: u32 = 14;
pub(super) const LEAF_STRIDE: u32 = 21;
pub(super) const OF_EDGE: u32 = 10;
pub(super) const GROUP_STRIDE: u32 = 7;
pub(super) const OF_GROUP: u32 = 3;
/// Words of an edge: its faces, the rows of its ends in the vertices of the first two faces, its object, and
/// what crossing it is (`FlatEdges`).
pub(super) const ROWS_OF_EDGE: u32 = 4;
pub(super) const OBJECT_OF_EDGE: u32 = 8;
pub(super) const IS_CROSSING: u32 = 9;

impl PackedScene {
    pub(super) fn add_edges(&mut self, view: &View) {
        let Some(sets) = &view.edge_sets else {
            return;
        };
        let flat = sets.flat();
        self.floats_at(EDGES);
        self.floats.extend(flat.ends.iter().flatten());
        self.words_at(OF_EDGES);
        self.words.extend(flat.numbers.iter().flatten());
        for (i, tree) in flat.trees.iter().enumerate() {
            self.add_edge_tree(EDGE_TREES + OF_TREE * i, tree);
        }
        if flat.trees.len() == 1 {
            self.repeat(EDGE_TREES..EDGE_TREES + OF_TREE);
        }
        self.add_groups(view);
    }

    fn add_edge_tree(&mut self, at: usize, tree: &FlatTree) {
        self.floats_at(at + NODES);
        self.floats.extend(tree.nodes.iter().flatten());
        self.words_at(at + CHILDREN);
        self.words.extend(&tree.children);
        self.floats_at(at + LEAVES);
        self.floats.extend(tree.leaves.iter().flatten());
        self.words_at(at + LEAF_EDGES);
        self.words.extend(&tree.edges);
        self.header[at + NODE_COUNT] = tree.children.len() as u32 / 8;
        self.header[at + LEAF_COUNT] = tree.edges.len() as u32 / 8;
    }

    fn add_groups(&mut self, view: &View) {
        let emitters = &view.scene.emitters;
        self.floats_at(GROUPS);
        for g in &emitters.groups {
            self.vector(g.centre);
            self.floats.push(g.radius);
            self.vector(g.velocity);
        }
        self.words_at(OF_GROUPS);
        for g in &emitters.groups {
            // Members follow each other.
            let moves = g.members.iter().any(|&k| match emitters.light(k as usize) {
                None => view.wanted.objects[emitters.get(k as usize).object as usize],
                Some(light) => view.wanted.moving_lights[light],
            });
            let count = g.members.len() as u32;
            self.words.extend([g.members[0], count, u32::from(moves)]);
        }
        self.words_at(GROUP_OF_EMITTERS);
        let count = emitters.all().len() + emitters.lights().len();
        self.words
            .extend((0..count).map(|k| emitters.group_of(k) as u32));
    }
}
