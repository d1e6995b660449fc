//! Edges at which something may jump, and what draws them, in the buffers of a view ([`layout`](super::layout)).

use crate::cube::*;

use super::packed_scene::PackedScene;
use super::reading::Scene;
use crate::kernel::{Kind, Root, View};

/// The tree over all edges, then that over those that move, [`OF_TREE`] words each.
pub(super) const EDGE_TREES: usize = 56;
pub(super) const OF_TREE: usize = 6;
/// Of a tree ([`Root`]): floats of nodes, and words: their children.
const NODES: usize = 0;
const CHILDREN: usize = 1;
/// Of a tree: floats of leaves, and words: their edges.
const LEAVES: usize = 2;
const LEAF_EDGES: usize = 3;
/// Of a tree: the child that a draw starts at, and how many; none of a tree without edges.
pub(super) const START: usize = 4;
pub(super) const COUNT: usize = 5;
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

pub(super) const OF_EDGE: u32 = 10;
pub(super) const GROUP_STRIDE: u32 = 7;
pub(super) const OF_GROUP: u32 = 3;
/// Words of an edge: its faces, the rows of its ends in the vertices of the first two faces, its object, and
/// 1 for a crossing, 2 for one whose line moves while the shutter is open.
pub(super) const ROWS_OF_EDGE: u32 = 4;
pub(super) const OBJECT_OF_EDGE: u32 = 8;
pub(super) const IS_CROSSING: u32 = 9;

/// The part of a tree that edges are drawn from; the tree begins at a word of the header.
#[cube]
pub(super) fn root_of<'a>(scene: &Scene<'a>, tree: usize, #[comptime] has_nodes: bool) -> Root<'a> {
    Root::<'a> {
        nodes: &scene.floats[scene.header[tree + NODES] as usize..],
        children: &scene.words[scene.header[tree + CHILDREN] as usize..],
        leaves: &scene.floats[scene.header[tree + LEAVES] as usize..],
        edges: &scene.words[scene.header[tree + LEAF_EDGES] as usize..],
        start: scene.header[tree + START],
        count: scene.header[tree + COUNT],
        has_nodes,
        moves: comptime!(scene.features.moves),
    }
}

impl PackedScene {
    pub(super) fn add_edges(&mut self, view: &View) {
        let Some(sets) = &view.edge_sets else {
            return;
        };
        self.floats_at(EDGES);
        for e in &sets.edges {
            self.vector(e.a);
            self.vector(e.along);
        }
        self.words_at(OF_EDGES);
        for e in &sets.edges {
            self.words.extend(e.faces);
            self.words.extend(e.rows.as_flattened());
            let crossing = u32::from(e.kind == Kind::Crossing) + u32::from(e.apart);
            self.words.extend([e.object, crossing]);
        }
        let [all, moving] = [true, false].map(|rays_move| sets.seen_by(rays_move));
        self.add_edge_tree(EDGE_TREES, &all);
        let other = EDGE_TREES + OF_TREE;
        if std::ptr::eq(all.nodes, moving.nodes) && std::ptr::eq(all.leaves, moving.leaves) {
            self.repeat(EDGE_TREES..other);
        } else {
            self.add_edge_tree(other, &moving);
        }
        for (at, root) in [(EDGE_TREES, all), (other, moving)] {
            self.header[at + START] = root.start;
            self.header[at + COUNT] = root.count;
        }
        self.add_groups(view);
    }

    fn add_edge_tree(&mut self, at: usize, root: &Root) {
        self.floats_at(at + NODES);
        self.floats.extend(root.nodes);
        self.words_at(at + CHILDREN);
        self.words.extend(root.children);
        self.floats_at(at + LEAVES);
        self.floats.extend(root.leaves);
        self.words_at(at + LEAF_EDGES);
        self.words.extend(root.edges);
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
