//! What a mesh is like.

use super::crossing::crossing_pairs;
use super::edges::{Connectivity, by_edge, components, sides};
use super::mesh::TriangleMesh;
use crate::error::Result;

/// Properties of a mesh, from [`TriangleMesh::statistics`].
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct MeshStatistics {
    /// Whether each edge has exactly two faces.
    pub closed: bool,
    /// Whether no edge has more than two faces.
    pub edge_manifold: bool,
    /// Whether the faces at each vertex are one fan, connected by edges.
    pub vertex_manifold: bool,
    /// Whether the two faces of each edge pass it in opposite directions.
    pub oriented: bool,
    /// Vertices − edges + faces, of the vertices that faces have.
    pub euler_characteristic: i64,
    /// The number of connected parts.
    pub components: usize,
    /// The number of handles of all parts together, if the mesh is closed, oriented and manifold.
    pub genus: Option<usize>,
    /// The median length of the edges, in scene units (0 without edges).
    pub median_edge: f64,
    /// The share of edges whose length is within 0.5 and 2 times the median, from 0 to 1.
    pub even_edges: f64,
    /// The number of pairs of faces that pass through each other; at most 64 for each face are counted.
    pub crossings: usize,
    /// The number of edges at which the normals of the two faces differ by more than 120°.
    pub folds: usize,
    /// The enclosed volume in cubic scene units, negative if the faces point inwards.
    pub volume: f64,
    /// The area in square scene units.
    pub area: f64,
}

impl MeshStatistics {
    /// Whether the mesh is closed, manifold at edges and vertices, and oriented.
    pub fn is_solid(&self) -> bool {
        self.closed && self.edge_manifold && self.vertex_manifold && self.oriented
    }
}

impl TriangleMesh {
    /// Computes the properties of the mesh.
    ///
    /// # Errors
    /// [`Error::Invalid`](crate::Error::Invalid) as [`check`](Self::check) returns it.
    pub fn statistics(&self) -> Result<MeshStatistics> {
        self.check()?;
        let found = Connectivity::of(self);
        let (_, components) = components(self);
        let euler = found.vertices as i64 - found.edges as i64 + self.faces.len() as i64;
        let handles = (2 * components as i64 - euler) / 2;
        let lengths = edge_lengths(self);
        let median_edge = median(&lengths);
        let is_even = |&&length: &&f64| (0.5 * median_edge..=2.0 * median_edge).contains(&length);
        let even = lengths.iter().filter(is_even).count();
        Ok(MeshStatistics {
            closed: found.closed,
            edge_manifold: found.edge_manifold,
            vertex_manifold: found.vertex_manifold,
            oriented: found.oriented,
            euler_characteristic: euler,
            components,
            genus: found.is_solid().then_some(handles.max(0) as usize),
            median_edge,
            even_edges: even as f64 / lengths.len().max(1) as f64,
            crossings: crossing_pairs(self).len(),
            folds: folds(self).len(),
            volume: self.volume(),
            area: self.area(),
        })
    }
}

/// The length of each edge.
pub(super) fn edge_lengths(mesh: &TriangleMesh) -> Vec<f64> {
    let sides = sides(mesh);
    let length = |edge: &[super::edges::Side]| {
        let [a, b] = edge[0].ends.map(|v| mesh.at(v));
        a.distance(b)
    };
    by_edge(&sides).map(length).collect()
}

/// The median of a list, 0 of an empty one.
pub(crate) fn median(values: &[f64]) -> f64 {
    let mut values = values.to_vec();
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// The cosine of the angle between normals above which an edge is a fold.
const FOLD: f64 = -0.5;

/// The pairs of faces at edges where the surface turns by more than 120°, or at which a face has no area.
pub(super) fn folds(mesh: &TriangleMesh) -> Vec<[u32; 2]> {
    let sides = sides(mesh);
    let mut found = Vec::new();
    for edge in by_edge(&sides) {
        if let [a, b] = edge {
            let [n, m] = [a.face, b.face].map(|k| mesh.area_vector(k).normalize_or_zero());
            let m = if a.forward == b.forward { -m } else { m };
            if n.dot(m) < FOLD {
                found.push([a.face, b.face]);
            }
        }
    }
    found
}
