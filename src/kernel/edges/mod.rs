//! The edges at which visibility or colours jump, and the choice of one that is seen from a point.
//!
//! `meshes` finds those of meshes, `crossings` the lines in which triangles pass through each other; `tree` is built over
//! them, and `draw` draws one from it.

mod bounds;
mod crossings;
mod draw;
mod meshes;
mod tree;

use super::gradient::Wanted;
use super::scene::KernelScene;
use crate::model::V3;
use crate::scene::HostScene;
use crate::trace::{OF_EDGE, Scene};
use bounds::EdgeList;
pub(crate) use draw::{DrawnEdge, NO_EDGE, ROOM, Root, draw_edge};
use tree::EdgeTree;

/// Faces of an edge, at most; if there are more, the others count as what lies behind.
pub(in crate::kernel) const FACES: usize = 4;

/// An edge, in inner coordinates at the start of the shutter.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Edge {
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
            return self.faces[..2]
                .iter()
                .any(|&k| wanted.objects[scene.object_of(k) as usize] != 0);
        }
        wanted.objects[self.object as usize] != 0
    }

    /// Its words in a list ([`EdgePoint`](crate::trace::EdgePoint)).
    fn words(&self) -> [u32; OF_EDGE] {
        let crossing = u32::from(self.kind == Kind::Crossing) + u32::from(self.apart);
        let [[a, b], [c, d]] = self.rows;
        let [k, l, m, n] = self.faces;
        [k, l, m, n, a, b, c, d, self.object, crossing]
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
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
    pub(crate) edges: Vec<Edge>,
    /// What stages read of them.
    flat: Vec<[[f32; 3]; 2]>,
    words: Vec<[u32; OF_EDGE]>,
    any_apart: bool,
    all: EdgeTree,
    moving: Moving,
}

/// Where the tree over the edges that move is.
enum Moving {
    /// All move.
    All,
    /// One of its own.
    Own(EdgeTree),
    /// In the tree over all, from node 1 on.
    Part,
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
            (EdgeTree::joint(&source, moving, others), Moving::Part)
        };
        Self {
            any_apart: edges.iter().any(|e| e.apart),
            flat: edges
                .iter()
                .map(|e| [e.a, e.along].map(V3::to_array))
                .collect(),
            words: edges.iter().map(Edge::words).collect(),
            all,
            moving,
            edges,
        }
    }

    /// Adds them to the lists of a view.
    #[inline(always)]
    pub fn add_to<'a>(&'a self, scene: &mut Scene<'a>) {
        scene.edges = self.flat.as_flattened().as_flattened();
        scene.of_edges = self.words.as_flattened();
    }

    /// Whether a line of a crossing moves while the shutter is open.
    pub(crate) fn any_apart(&self) -> bool {
        self.any_apart
    }

    pub fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    /// The tree over the edges that matter to rays: all to rays that move, else those that move.
    pub(crate) fn seen_by(&self, rays_move: bool) -> Root<'_> {
        match &self.moving {
            Moving::Own(own) if !rays_move => own.root(0),
            Moving::Part if !rays_move => self.all.root(1),
            _ => self.all.root(0),
        }
    }
}
