//! The edges at which visibility or colours jump, and the choice of one that is seen from a point.
//!
//! `meshes` finds those of meshes, `crossings` the lines in which triangles pass through each other; `tree` is built over
//! them, and `draw` draws one from it.

mod bounds;
mod crossings;
mod draw;
mod meshes;
mod tree;

use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;

use super::gradient::Wanted;
use super::scene::KernelScene;
use crate::model::V3;
use crate::model::edge_weight::{BORDER, CROSSING, FOLD};
use crate::scene::HostScene;
#[cfg(feature = "wgpu")]
use crate::trace::CLOSED;
use crate::trace::{OF_EDGE, Scene};
use bounds::EdgeList;
pub(crate) use draw::{DrawnEdge, NO_EDGE, ROOM, Root, draw_edge};
#[cfg(feature = "wgpu")]
pub(crate) use draw::{LEAF, put_edge};
use meshes::MeshEdges;
use tree::{Division, EdgeTree};

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
    Fold = FOLD as isize,
    /// An edge of one face, or of more than two: it always jumps.
    Border = BORDER as isize,
    /// A line in which two triangles pass through each other: colours jump, but not whether light passes.
    Crossing = CROSSING as isize,
}

/// A list of edges.
#[derive(Default)]
pub(super) struct Edges {
    /// How many there are: there may be room for more.
    pub count: usize,
    /// What stages read of them.
    flat: Vec<[[f32; 3]; 2]>,
    words: Vec<[u32; OF_EDGE]>,
    /// What only trees and films ask for.
    kinds: Vec<(Kind, f32, bool)>,
}

impl Edges {
    /// Adds so many edges.
    fn extend(&mut self, count: usize, edge: impl Fn(usize) -> Edge + Sync) {
        let first = self.count;
        self.count += count;
        if self.words.len() < self.count {
            self.resize();
        }
        let flat = self.flat[first..self.count].par_iter_mut();
        let all = flat
            .zip(&mut self.words[first..])
            .zip(&mut self.kinds[first..]);
        all.enumerate().for_each(|(i, ((flat, words), kind))| {
            let e = edge(i);
            *flat = [e.a, e.along].map(V3::to_array);
            *words = e.words();
            *kind = (e.kind, e.crease, e.closed);
        });
    }

    /// Gives room to all edges, and to no more.
    fn resize(&mut self) {
        self.flat.resize(self.count, Default::default());
        self.words.resize(self.count, Default::default());
        self.kinds.resize(self.count, (Kind::Border, 0.0, false));
    }

    pub fn get(&self, i: usize) -> Edge {
        let [k, l, m, n, a, b, c, d, object, crossing] = self.words[i];
        let [start, along] = self.flat[i].map(V3::from);
        let (kind, crease, closed) = self.kinds[i];
        Edge {
            a: start,
            along,
            faces: [k, l, m, n],
            rows: [[a, b], [c, d]],
            object,
            kind,
            crease,
            closed,
            apart: crossing == 2,
        }
    }

    /// What tells edges of meshes apart: the first face, and where an edge begins there.
    fn name(&self, i: u32) -> [u32; 2] {
        let words = &self.words[i as usize];
        [words[0], words[4]]
    }
}

/// Edges that something can jump at, and trees over them.
pub(crate) struct EdgeSets {
    pub(super) edges: Edges,
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

/// What the edges of the last render leave for the next, where they are the same or moved.
#[derive(Clone, Default)]
pub(crate) struct LastEdges(Arc<Mutex<Kept>>);

#[derive(Default)]
struct Kept {
    /// Its memory is used again where no other render has it.
    last: Option<Arc<EdgeSets>>,
    meshes: Vec<MeshEdges>,
    /// Of the edges that move, and of the others or all.
    divisions: [Division; 2],
}

impl EdgeSets {
    pub fn new(
        host: &HostScene,
        scene: &KernelScene,
        wanted: &Wanted,
        last: &LastEdges,
    ) -> Arc<Self> {
        let lock = || last.0.lock().unwrap_or_else(PoisonError::into_inner);
        let mut kept = std::mem::take(&mut *lock());
        kept.meshes
            .resize_with(host.objects.len(), MeshEdges::default);
        let mut edges = Edges::default();
        if let Some(sets) = kept.last.take().and_then(Arc::into_inner) {
            edges = sets.edges;
            edges.count = 0;
            kept.divisions[0].room = sets.all.into_room();
        }
        for (i, (mesh, object)) in kept.meshes.iter_mut().zip(&host.objects).enumerate() {
            mesh.update(scene, i, object);
            mesh.add_to(&mut edges, scene, i);
        }
        let crossings = crossings::find(scene);
        edges.extend(crossings.len(), |i| crossings[i]);
        edges.resize();
        let all_move = wanted.objects.iter().all(|&object| object != 0);
        let moves = |&i: &u32| all_move || edges.get(i as usize).moves(scene, wanted);
        let numbers = 0..edges.count as u32;
        let (moving, others): (Vec<u32>, Vec<u32>) = numbers.clone().partition(moves);
        let source = EdgeList {
            edges: &edges,
            scene,
        };
        let [first, second] = &mut kept.divisions;
        let (all, moving) = if others.is_empty() {
            (EdgeTree::new(&source, &moving, first), Moving::All)
        } else if EdgeTree::is_list(&moving) {
            let own = EdgeTree::new(&source, &moving, first);
            let all: Vec<u32> = numbers.collect();
            (EdgeTree::new(&source, &all, second), Moving::Own(own))
        } else {
            let parts = [(&*moving, first), (&*others, second)];
            (EdgeTree::joint(&source, parts), Moving::Part)
        };
        let sets = Arc::new(Self { all, moving, edges });
        kept.last = Some(sets.clone());
        *lock() = kept;
        sets
    }

    /// Adds them to the lists of a view.
    #[inline(always)]
    pub fn add_to<'a>(&'a self, scene: &mut Scene<'a>) {
        scene.edges = self.edges.flat.as_flattened().as_flattened();
        scene.of_edges = self.edges.words.as_flattened();
    }

    /// The kinds of edges, by how much colours may jump at each, and the number of those of meshes, which come first.
    #[cfg(feature = "wgpu")]
    pub fn kinds(&self) -> (Vec<u32>, Vec<f32>, usize) {
        let kinds = &self.edges.kinds;
        let kind = |&(kind, _, closed): &(Kind, f32, bool)| match closed {
            true => kind as u32 | CLOSED,
            false => kind as u32,
        };
        let meshes = kinds.partition_point(|k| k.0 != Kind::Crossing);
        let creases = kinds.par_iter().map(|k| k.1).collect();
        (kinds.par_iter().map(kind).collect(), creases, meshes)
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
