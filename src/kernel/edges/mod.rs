//! The edges at which visibility or colours jump, and the choice of one that is seen from a point.
//!
//! `meshes` finds those of meshes, `crossings` the lines in which triangles pass through each other; a `tree`
//! draws one.

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
pub(super) use query::Query;
pub(super) use tree::EdgeTree;

/// Surfaces that lie within this share of the coordinates of an edge touch it.
pub(in crate::kernel) const TOUCHING: f32 = 4e-6;
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
