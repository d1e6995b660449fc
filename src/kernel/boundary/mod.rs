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
    /// All of them, and those that move.
    all: EdgeTree,
    moving: EdgeTree,
}

impl EdgeSets {
    pub fn new(host: &HostScene, scene: &KernelScene, wanted: &Wanted) -> Self {
        let mut edges = Vec::new();
        for (i, o) in host.objects.iter().enumerate() {
            edges.extend(edges::of_object(scene, i, &o.positions, &o.faces));
        }
        // Rays that turn where nothing moves meet edges that stand still.
        let rays_move = wanted.camera || wanted.turns() || wanted.objects.contains(&true);
        edges.extend(crossings::find(scene, &|_| rays_move));
        let normal = |k: u32| scene.triangles[k as usize].normal;
        let velocities = scene.velocities.as_deref();
        let tree = |keep: &dyn Fn(&Edge) -> bool| {
            let which = (0..edges.len() as u32).filter(|&i| keep(&edges[i as usize]));
            EdgeTree::new(&edges, &normal, velocities, which.collect())
        };
        Self {
            all: tree(&|_| rays_move),
            moving: tree(&|e| e.moves(scene, wanted)),
            edges,
        }
    }

    pub fn is_empty(&self) -> bool {
        self.all.is_empty()
    }
}
