//! Lists of a scene that GPUs alone need.

use super::jumps::OF_TREE;
use crate::accel::GpuTree;
use crate::kernel::{Root, View};
use crate::trace::Scene;

/// What GPUs need of a scene beside the lists that the host has.
#[derive(Default)]
pub(super) struct OfScene {
    pub tree: GpuTree,
    counted: Vec<u32>,
    vertex_starts: Vec<u32>,
    vertex_corners: Vec<u32>,
    edge_nodes: Vec<f32>,
    edge_children: Vec<u32>,
    edge_leaves: Vec<f32>,
    edges_of_leaves: Vec<u32>,
    edge_trees: Vec<[u32; OF_TREE as usize]>,
}

impl OfScene {
    pub fn new(view: &View) -> Self {
        let lists = &view.scene.lists;
        let background = lists.counted.len();
        let number = |o: usize| lists.counted.binary_search(&o).unwrap_or(background) as u32;
        let mut this = Self {
            tree: view.scene.hierarchy.for_gpu(),
            counted: (0..lists.objects.len()).map(number).collect(),
            ..Self::default()
        };
        if view.wanted.of.objects {
            this.add_vertex_corners(view);
        }
        if let Some(sets) = &view.edge_sets {
            let [all, moving] = [true, false].map(|rays_move| sets.seen_by(rays_move));
            this.add_edge_tree(&all);
            if std::ptr::eq(all.nodes, moving.nodes) && std::ptr::eq(all.leaves, moving.leaves) {
                let [a, b, c, d, ..] = this.edge_trees[0];
                this.edge_trees
                    .push([a, b, c, d, moving.start, moving.count]);
            } else {
                this.add_edge_tree(&moving);
            }
        }
        this
    }

    fn add_edge_tree(&mut self, root: &Root) {
        let lengths = [
            self.edge_nodes.len(),
            self.edge_children.len(),
            self.edge_leaves.len(),
            self.edges_of_leaves.len(),
        ];
        let [a, b, c, d] = lengths.map(|length| length as u32);
        self.edge_trees.push([a, b, c, d, root.start, root.count]);
        self.edge_nodes.extend(root.nodes);
        self.edge_children.extend(root.children);
        self.edge_leaves.extend(root.leaves);
        self.edges_of_leaves.extend(root.edges);
    }

    /// The corners of triangles at each vertex.
    fn add_vertex_corners(&mut self, view: &View) {
        let rows = view.scene.lists.vertex_rows.as_flattened();
        let count = view.scene.vertices();
        let mut starts = vec![0; count + 1];
        for &v in rows {
            starts[v as usize + 1] += 1;
        }
        for v in 0..count {
            starts[v + 1] += starts[v];
        }
        let mut next = starts.clone();
        let mut corners = vec![0; rows.len()];
        for (corner, &v) in rows.iter().enumerate() {
            let to: &mut u32 = &mut next[v as usize];
            corners[*to as usize] = corner as u32;
            *to += 1;
        }
        (self.vertex_starts, self.vertex_corners) = (starts, corners);
    }

    /// Adds them to the lists of a view.
    pub fn add_to<'a>(&'a self, scene: Scene<'a>) -> Scene<'a> {
        Scene {
            root: self.tree.root,
            boxes: self.tree.boxes.as_flattened(),
            children: self.tree.children.as_flattened(),
            leaves: self.tree.leaves.as_flattened(),
            hits: self.tree.hits.as_flattened(),
            hit_numbers: &self.tree.triangles,
            hit_count: self.tree.triangles.len() as u32,
            counted: &self.counted,
            vertex_starts: &self.vertex_starts,
            vertex_corners: &self.vertex_corners,
            edge_nodes: &self.edge_nodes,
            edge_children: &self.edge_children,
            edge_leaves: &self.edge_leaves,
            edges_of_leaves: &self.edges_of_leaves,
            edge_trees: self.edge_trees.as_flattened(),
            ..scene
        }
    }

    /// The numbers of all lists of floats.
    pub fn numbers(&self, view: &View) -> usize {
        let lists = self.add_to(view.lists());
        lists.float_lists().iter().map(|(_, list)| list.len()).sum()
    }
}
