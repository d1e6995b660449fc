//! The edges of a scene, with trees to draw from.

use super::edge::Edge;
use super::tree::EdgeTree;
use super::{crossings, meshes};
use crate::kernel::gradient::Wanted;
use crate::kernel::scene::KernelScene;
use crate::scene::HostScene;

/// Edges that something can jump at, and trees over them.
pub(crate) struct EdgeSets {
    pub(in crate::kernel) edges: Vec<Edge>,
    all: EdgeTree,
    /// A tree over those that move, unless that is all.
    moving: Option<EdgeTree>,
}

impl EdgeSets {
    pub fn new(host: &HostScene, scene: &KernelScene, wanted: &Wanted) -> Self {
        let mut edges = Vec::new();
        for (i, o) in host.objects.iter().enumerate() {
            edges.extend(meshes::of_object(scene, i, &o.positions, &o.faces));
        }
        edges.extend(crossings::find(scene));
        let tree = |which| EdgeTree::new(&edges, scene, which);
        let numbers = 0..edges.len() as u32;
        let moves = |&i: &u32| edges[i as usize].moves(scene, wanted);
        let moving: Vec<u32> = numbers.clone().filter(moves).collect();
        Self {
            moving: (moving.len() < edges.len()).then(|| tree(moving)),
            all: tree(numbers.collect()),
            edges,
        }
    }

    pub fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    /// The tree over the edges that matter to rays: all to rays that move, else those that move.
    pub(in crate::kernel) fn seen_by(&self, rays_move: bool) -> &EdgeTree {
        match &self.moving {
            Some(moving) if !rays_move => moving,
            _ => &self.all,
        }
    }
}
