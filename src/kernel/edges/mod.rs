//! The edges at which visibility or colours jump, and the choice of one that is seen from a point.
//!
//! `meshes` finds those of meshes, `crossings` the lines in which triangles pass through each other; a `tree`
//! draws one.

mod bounds;
mod crossings;
#[cfg(feature = "wgpu")]
mod flat;
mod meshes;
mod node;
mod query;
mod tree;

use super::gradient::Wanted;
use super::scene::KernelScene;
use crate::model::V3;
use crate::scene::HostScene;
#[cfg(feature = "wgpu")]
pub(crate) use flat::FlatTree;
use query::EdgeList;
pub(super) use query::Query;
use tree::EdgeTree;
pub(super) use tree::Root;

/// Faces of an edge, at most; if there are more, the others count as what lies behind.
pub(in crate::kernel) const FACES: usize = 4;

/// An edge, in inner coordinates at the start of the shutter.
#[derive(Clone, Copy, Debug)]
pub(in crate::kernel) struct Edge {
    pub a: V3,
    /// The vector from a to b.
    pub along: V3,
    /// Its triangles, `u32::MAX` where there are no more.
    pub faces: [u32; FACES],
    /// Rows of the two ends in the vertices of its first and second face.
    pub rows: [[u32; 2]; 2],
    pub object: u32,
    pub kind: Kind,
    /// The most by which colours may jump at it where both faces are seen, up to 1.
    pub crease: f32,
    /// Whether all that is behind its faces is hidden by the object itself.
    pub closed: bool,
    /// Whether its faces move apart while the shutter is open: then the line of a crossing moves too.
    pub apart: bool,
}

impl Edge {
    /// Whether it has derivatives.
    pub fn moves(&self, scene: &KernelScene, wanted: &Wanted) -> bool {
        if self.kind == Kind::Crossing {
            return self.faces[..2].iter().any(|&k| {
                let object = scene.triangles[k as usize].object;
                wanted.objects[object as usize]
            });
        }
        wanted.objects[self.object as usize]
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::kernel) enum Kind {
    /// An edge between two faces of opposite direction: it jumps where one is seen from the front, one from
    /// behind.
    Fold,
    /// An edge of one face, or of more than two: it always jumps.
    Border,
    /// A line in which two triangles pass through each other: colours jump, but not whether light passes.
    Crossing,
}

/// Edges that something can jump at, and trees over them.
pub(crate) struct EdgeSets {
    pub(in crate::kernel) edges: Vec<Edge>,
    all: EdgeTree,
    moving: Moving,
}

/// Where the tree over the edges that move is.
enum Moving {
    /// All move.
    All,
    /// One of its own.
    Own(EdgeTree),
    /// In the tree over all, from node 1 and leaf 0 on: so many nodes and leaves.
    Part(
        #[cfg_attr(
            not(feature = "wgpu"),
            expect(dead_code, reason = "kernels of GPUs have it apart")
        )]
        [usize; 2],
    ),
}

impl EdgeSets {
    pub fn new(host: &HostScene, scene: &KernelScene, wanted: &Wanted) -> Self {
        let mut edges = Vec::new();
        for (i, o) in host.objects.iter().enumerate() {
            edges.extend(meshes::of_object(scene, i, &o.positions, &o.faces));
        }
        edges.extend(crossings::find(scene));
        let moves = |&i: &u32| edges[i as usize].moves(scene, wanted);
        let numbers = 0..edges.len() as u32;
        let (moving, others): (Vec<u32>, Vec<u32>) = numbers.clone().partition(moves);
        let source = EdgeList::new(&edges, scene);
        let (all, moving) = if others.is_empty() {
            (EdgeTree::new(&source, moving), Moving::All)
        } else if EdgeTree::is_list(&moving) {
            let own = EdgeTree::new(&source, moving);
            (EdgeTree::new(&source, numbers.collect()), Moving::Own(own))
        } else {
            let (all, size) = EdgeTree::joint(&source, moving, others);
            (all, Moving::Part(size))
        };
        Self { all, moving, edges }
    }

    pub fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    /// The tree over the edges that matter to rays: all to rays that move, else those that move.
    pub(in crate::kernel) fn seen_by(&self, rays_move: bool) -> Root<'_> {
        let (tree, node) = match &self.moving {
            Moving::Own(own) if !rays_move => (own, 0),
            Moving::Part(_) if !rays_move => (&self.all, 1),
            _ => (&self.all, 0),
        };
        Root { tree, node }
    }
}
