//! What the jumps of visibility at edges contribute to a gradient.
//!
//! Where a path looks at light, an edge that lies in between makes the integrand jump, and where the edge
//! moves, the integral changes by the jump. So at points of a path an edge is drawn that can be seen from
//! there (`tree`), a point of it, and the light that arrives beside it on either side (`vertex`). Of what
//! the camera sees edges are drawn on the film (`film`).

mod crossings;
mod edges;
mod film;
mod tree;
mod vertex;

use super::gradient::Wanted;
use super::scene::KernelScene;
use crate::scene::HostScene;
use edges::Edge;
pub(crate) use film::PixelGradients;
use tree::EdgeTree;

/// Edges that something can jump at, and trees over them.
pub(crate) struct EdgeSets {
    edges: Vec<Edge>,
    all: EdgeTree,
    /// Over those that move, unless that is all.
    moving: Option<EdgeTree>,
}

impl EdgeSets {
    pub fn new(host: &HostScene, scene: &KernelScene, wanted: &Wanted) -> Self {
        let mut edges = Vec::new();
        for (i, o) in host.objects.iter().enumerate() {
            edges.extend(edges::of_object(scene, i, &o.positions, &o.faces));
        }
        edges.extend(crossings::find(scene));
        let normal = |k: u32| scene.triangles[k as usize].normal;
        let velocities = scene.velocities.as_deref();
        let tree = |which| EdgeTree::new(&edges, &normal, velocities, which);
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

    /// Edges that matter to rays: all to those that move, else those that move.
    fn seen_by(&self, rays_move: bool) -> &EdgeTree {
        match &self.moving {
            Some(moving) if !rays_move => moving,
            _ => &self.all,
        }
    }
}
