//! The edges that a tree is built over.

use crate::kernel::edges::edge::Edge;
use crate::kernel::scene::KernelScene;
use crate::model::V3;

/// Edges with the triangles that they belong to.
pub(super) struct EdgeList<'a> {
    pub edges: &'a [Edge],
    pub scene: &'a KernelScene,
}

impl EdgeList<'_> {
    /// The way of an edge over the shutter.
    pub fn velocity(&self, e: &Edge) -> V3 {
        let all = &self.scene.velocities;
        all.as_ref().map_or(V3::ZERO, |v| v[e.object as usize])
    }

    pub fn middle(&self, index: u32) -> V3 {
        let e = &self.edges[index as usize];
        e.a + e.along * 0.5
    }

    /// The normals of the first two faces; twice that of the only one.
    pub fn normals(&self, e: &Edge) -> [V3; 2] {
        let [first, second, ..] = e.faces;
        let second = if second == u32::MAX { first } else { second };
        [first, second].map(|k| self.scene.triangles[k as usize].normal)
    }
}
