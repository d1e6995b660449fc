//! The edges at which visibility or colors jump, and the choice of one that a point sees.
//!
//! `meshes` collects the edges of meshes, and `crossings` the lines in which triangles pass through each other. `tree`
//! is built over both, and `draw` draws an edge from it, by the numbers in `blocks`.

mod blocks;
mod bounds;
mod crossings;
mod draw;
mod meshes;
mod tree;

use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;

use super::gradient::Wanted;
use super::scene::KernelScene;
use crate::host::HostScene;
use crate::model::V3;
use crate::model::edge_weight::{BORDER, CLOSED, CROSSING, FOLD, FOLLOWED};
use crate::trace::{OF_EDGE, Scene};
#[cfg(feature = "gpu")]
pub use blocks::Blocks;
#[cfg(feature = "gpu")]
pub use bounds::Bounds;
use bounds::EdgeList;
use crossings::LastCrossings;
pub use draw::{DrawnEdge, NO_EDGE, ROOM, Root, draw_edge};
#[cfg(feature = "gpu")]
pub use draw::{LEAF, NODE, put_edge, put_subtree};
use meshes::MeshEdges;
#[cfg(feature = "gpu")]
pub use tree::TreeShape;
use tree::{Division, EdgeTree};

/// The largest number of faces of an edge. Further faces count as surfaces behind the edge.
pub(in crate::kernel) const FACES: usize = 4;

/// The distance at which directions follow glossy faces by half, in lengths of creases.
const FOLLOWED_BY_HALF: f64 = 2.0;

/// An edge, in inner coordinates at the start of the shutter.
#[derive(Clone, Copy, Debug)]
pub struct Edge {
    pub a: V3,
    /// The vector from a to its other end b.
    pub along: V3,
    /// Its triangles; unused places are `u32::MAX`.
    pub faces: [u32; FACES],
    /// The rows of its two ends among the vertices, for its first and its second face.
    pub rows: [[u32; 2]; 2],
    pub object: u32,
    pub kind: Kind,
    /// An upper bound, at most 1, of the jump of colors where both faces are visible.
    pub crease: f32,
    /// Whether the object itself hides everything behind the edge's faces.
    pub closed: bool,
    /// Whether bounces may follow both of its faces ([`Scene::is_followed`]).
    pub followed: bool,
    /// Whether its faces move apart while the shutter is open. Then the line of a crossing moves, too.
    pub apart: bool,
}

impl Edge {
    /// Returns whether derivatives with respect to its position are required.
    pub fn moves(&self, scene: &KernelScene, wanted: &Wanted) -> bool {
        if self.kind == Kind::Crossing {
            return self.faces[..2]
                .iter()
                .any(|&k| wanted.objects[scene.object_of(k) as usize] != 0);
        }
        wanted.objects[self.object as usize] != 0
    }

    /// Returns its word in [`Scene::edge_kinds`].
    fn kind_word(&self) -> u32 {
        let bit = |is_set: bool, bit: u32| if is_set { bit } else { 0 };
        self.kind as u32 | bit(self.closed, CLOSED) | bit(self.followed, FOLLOWED)
    }

    /// Returns its words in a list ([`EdgePoint`](crate::trace::EdgePoint)).
    fn words(&self) -> [u32; OF_EDGE] {
        let crossing = u32::from(self.kind == Kind::Crossing) + u32::from(self.apart);
        let [[a, b], [c, d]] = self.rows;
        let [k, l, m, n] = self.faces;
        [k, l, m, n, a, b, c, d, self.object, crossing]
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// An edge between two faces of opposite direction. It jumps where one face is seen from the front and one from
    /// behind.
    Fold = FOLD as isize,
    /// An edge of one face, of more than two, or of two faces of the same direction. It always jumps.
    Border = BORDER as isize,
    /// A line in which two triangles pass through each other. Colors jump there, but not whether light passes.
    Crossing = CROSSING as isize,
}

/// A list of edges.
#[derive(Default)]
pub(super) struct Edges {
    /// The number of edges. The lists may have room for more.
    pub count: usize,
    /// The numbers and words that stages read.
    flat: Vec<[[f32; 3]; 2]>,
    words: Vec<[u32; OF_EDGE]>,
    /// Values that only trees and films use: the kind and whether the object is closed, and the bound of the jump of
    /// colors.
    kinds: Vec<u32>,
    creases: Vec<f32>,
    /// Whether each edge differs from the last render's at the same place, or may do so.
    changed: Vec<bool>,
}

impl Edges {
    /// Adds `count` edges. `moved` is whether each triangle has moved since the last render, if that is known.
    fn extend(
        &mut self,
        count: usize,
        moved: Option<&[bool]>,
        edge: impl Fn(usize) -> Edge + Sync,
    ) {
        let first = self.count;
        self.count += count;
        if self.words.len() < self.count {
            self.resize();
        }
        let flat = self.flat[first..self.count].par_iter_mut();
        let all = flat
            .zip(&mut self.words[first..])
            .zip(&mut self.kinds[first..])
            .zip(&mut self.creases[first..])
            .zip(&mut self.changed[first..]);
        let has_moved = |&face: &u32| match moved {
            Some(moved) => moved.get(face as usize).copied().unwrap_or(false),
            None => true,
        };
        all.enumerate()
            .for_each(|(i, ((((flat, words), kind), crease), changed))| {
                let e = edge(i);
                let ends = [e.a, e.along].map(V3::to_array);
                let new = (ends, e.words(), e.kind_word(), e.crease);
                let last = (*flat, *words, *kind, *crease);
                *changed = new != last || e.faces[..2].iter().any(has_moved);
                (*flat, *words, *kind, *crease) = new;
            });
    }

    /// Fits the lists to the number of edges.
    fn resize(&mut self) {
        self.flat.resize(self.count, Default::default());
        self.words.resize(self.count, Default::default());
        self.kinds.resize(self.count, BORDER);
        self.creases.resize(self.count, 0.0);
        self.changed.resize(self.count, true);
    }

    pub fn get(&self, i: usize) -> Edge {
        let [k, l, m, n, a, b, c, d, object, crossing] = self.words[i];
        let [start, along] = self.flat[i].map(V3::from);
        Edge {
            a: start,
            along,
            faces: [k, l, m, n],
            rows: [[a, b], [c, d]],
            object,
            kind: self.kind(i),
            crease: self.creases[i],
            closed: self.kinds[i] & CLOSED != 0,
            followed: self.kinds[i] & FOLLOWED != 0,
            apart: crossing == 2,
        }
    }

    fn kind(&self, i: usize) -> Kind {
        match self.kinds[i] % CLOSED {
            FOLD => Kind::Fold,
            BORDER => Kind::Border,
            _ => Kind::Crossing,
        }
    }

    /// Returns 1 over the distance at which directions follow glossy faces by half: a multiple of the mean length of their
    /// creases, each of which counts as much as it may jump. It is 0 without creases.
    fn following(&self) -> f32 {
        let is_followed = |i: &usize| self.kinds[*i] & FOLLOWED != 0;
        let (mut creases, mut lengths) = (0.0, 0.0);
        // In order, so that the sums repeat to the bit.
        for i in (0..self.count).filter(is_followed) {
            let crease = f64::from(self.creases[i]);
            creases += crease;
            lengths += crease * f64::from(V3::from(self.flat[i][1]).length());
        }
        if lengths > 0.0 {
            (creases / (FOLLOWED_BY_HALF * lengths)) as f32
        } else {
            0.0
        }
    }

    /// Returns an identifier of an edge of a mesh: its first face, and the vertex row at which the edge begins.
    fn name(&self, i: u32) -> [u32; 2] {
        let words = &self.words[i as usize];
        [words[0], words[4]]
    }
}

/// The edges at which something can jump, and trees over them.
pub struct EdgeSets {
    /// The version of the hierarchy over the triangles.
    version: u64,
    pub(super) edges: Edges,
    tree: EdgeTree,
    moving: Moving,
    /// 1 over the distance at which directions follow glossy faces by half; 0 without creases of such faces.
    pub(in crate::kernel) following: f32,
}

/// Where the tree over the moving edges is stored.
enum Moving {
    /// All edges move, so it is the tree over all.
    Whole,
    /// A tree of its own.
    Separate(EdgeTree),
    /// The part of the tree over all that begins at node 1.
    Part,
}

/// Data of the last render's edges, which the next render reuses if the edges are the same or have only moved.
#[derive(Clone, Default)]
pub struct LastEdges(Arc<Mutex<Kept>>);

#[derive(Default)]
struct Kept {
    /// Its memory is reused unless another render still holds it.
    last: Option<Arc<EdgeSets>>,
    meshes: Vec<MeshEdges>,
    crossings: LastCrossings,
    /// Divisions of the edges that move, and of the others or of all.
    divisions: [Division; 2],
}

impl EdgeSets {
    /// Collects the edges of a scene and builds trees over them, `for_gpu` without the data that GPUs compute.
    pub fn new(
        host: &HostScene,
        scene: &KernelScene,
        wanted: &Wanted,
        last: &LastEdges,
        for_gpu: bool,
    ) -> Arc<Self> {
        let lock = || last.0.lock().unwrap_or_else(PoisonError::into_inner);
        let mut kept = std::mem::take(&mut *lock());
        kept.meshes
            .resize_with(host.objects.len(), MeshEdges::default);
        let (mut edges, mut last) = (Edges::default(), EdgeTree::default());
        let mut moved = None;
        if let Some(sets) = kept.last.take().and_then(Arc::into_inner) {
            (edges, last) = (sets.edges, sets.tree);
            edges.count = 0;
            moved = scene.hierarchy.moved_since(sets.version);
        }
        let of_objects = kept.meshes.par_iter_mut().zip(&host.objects).enumerate();
        of_objects.for_each(|(i, (mesh, object))| mesh.update(scene, i, object, moved));
        // The edges that do not move, and those that do.
        let mut parts = [Vec::new(), Vec::new()];
        for (i, mesh) in kept.meshes.iter().enumerate() {
            let first = edges.count as u32;
            mesh.add_to(&mut edges, scene, i, moved);
            let moves = wanted.objects[i] != 0;
            parts[usize::from(moves)].extend(first..edges.count as u32);
        }
        let crossings = kept.crossings.update(scene);
        for (i, edge) in (edges.count as u32..).zip(crossings) {
            parts[usize::from(edge.moves(scene, wanted))].push(i);
        }
        edges.extend(crossings.len(), moved, |i| crossings[i]);
        edges.resize();
        let [others, moving] = parts;
        let source = EdgeList {
            edges: &edges,
            scene,
            for_gpu,
        };
        let [first, second] = &mut kept.divisions;
        let (tree, moving) = if others.is_empty() {
            (EdgeTree::new(&source, &moving, first, last), Moving::Whole)
        } else if EdgeTree::is_list(&moving) {
            let tree = EdgeTree::new(&source, &moving, first, EdgeTree::default());
            let all: Vec<u32> = (0..edges.count as u32).collect();
            let whole = EdgeTree::new(&source, &all, second, last);
            (whole, Moving::Separate(tree))
        } else {
            let parts = [(&*moving, first), (&*others, second)];
            (EdgeTree::joint(&source, parts, last), Moving::Part)
        };
        let sets = Arc::new(Self {
            version: scene.hierarchy.version(),
            following: edges.following(),
            tree,
            moving,
            edges,
        });
        kept.last = Some(sets.clone());
        *lock() = kept;
        sets
    }

    /// Adds the edges to the lists of a view.
    #[inline(always)]
    pub fn add_to<'a>(&'a self, scene: &mut Scene<'a>) {
        scene.edges = self.edges.flat.as_flattened().as_flattened();
        scene.of_edges = self.edges.words.as_flattened();
        scene.edge_kinds = &self.edges.kinds;
        scene.creases = &self.edges.creases;
    }

    /// Returns the number of edges, and of mesh edges among these, which come first.
    #[cfg(feature = "gpu")]
    pub fn counts(&self) -> [u32; 2] {
        let edges = &self.edges;
        let meshes = |k: &u32| k % CLOSED != CROSSING;
        [edges.count, edges.kinds.partition_point(meshes)].map(|n| n as u32)
    }

    /// Returns whether derivatives are required with respect to a body that intersects another one.
    #[cfg(feature = "gpu")]
    pub fn crossings_move(&self, scene: &KernelScene, wanted: &Wanted) -> bool {
        // They come last.
        let edges = (0..self.edges.count).rev().map(|i| self.edges.get(i));
        let mut crossings = edges.take_while(|e| e.kind == Kind::Crossing);
        crossings.any(|e| e.moves(scene, wanted))
    }

    /// Returns the shapes of the tree over all edges and of the tree over those that move.
    #[cfg(feature = "gpu")]
    pub fn shapes(&self) -> [&Arc<TreeShape>; 2] {
        let moving = match &self.moving {
            Moving::Separate(tree) => &tree.shape,
            _ => &self.tree.shape,
        };
        [&self.tree.shape, moving]
    }

    /// Returns the tree over the edges that matter to rays: all edges for rays that move, otherwise the edges that
    /// move.
    pub fn seen_by(&self, rays_move: bool) -> Root<'_> {
        match &self.moving {
            Moving::Separate(tree) if !rays_move => tree.root(0),
            Moving::Part if !rays_move => self.tree.root(1),
            _ => self.tree.root(0),
        }
    }
}
