//! Connectivity of the vertices, edges and faces of a mesh, by index.

use crate::error::{Error, Result};

/// The edges and pairs of adjacent faces of a mesh, in an order that depends on the faces alone.
///
/// Vertices are identified by their index; vertices at the same position are not welded. A face that lists a
/// vertex twice has no area and is left out.
#[derive(Clone, Debug)]
pub(crate) struct Connectivity {
    /// Vertex indices of each face, without faces that list a vertex twice.
    pub faces: Vec<[u32; 3]>,
    /// Each edge once, sorted; the smaller vertex index comes first.
    pub edges: Vec<[u32; 2]>,
    /// For each face the indices into `edges` of the edges opposite to its corners.
    pub opposite: Vec<[u32; 3]>,
    /// For each edge with exactly two faces: the two ends, then the third vertex of each face.
    pub hinges: Vec<[u32; 4]>,
}

impl Connectivity {
    /// Returns the connectivity of the faces of a mesh with `vertices` vertices.
    ///
    /// # Errors
    /// If no face has three different vertices, or an index is out of range.
    pub fn new(object: &str, faces: &[[u32; 3]], vertices: usize) -> Result<Self> {
        let outside = |f: &[u32; 3]| f.iter().any(|&v| v as usize >= vertices);
        if let Some(i) = faces.iter().position(outside) {
            let (field, expected) = (
                format!("vertices of face {i}"),
                format!("indices under {vertices}"),
            );
            let found = format!("{:?}", faces[i]);
            return Err(Error::invalid(object, field, found, expected));
        }
        let whole = |f: &&[u32; 3]| f[0] != f[1] && f[1] != f[2] && f[2] != f[0];
        let faces: Vec<[u32; 3]> = faces.iter().filter(whole).copied().collect();
        let (found, expected) = (
            "without a triangle",
            "at least one face of three different vertices",
        );
        Error::unless(!faces.is_empty(), object, "faces", found, expected)?;

        // The sides of all faces, sorted, so that the sides of one edge are adjacent.
        let mut sides: Vec<([u32; 2], usize, usize)> = Vec::with_capacity(3 * faces.len());
        for (f, face) in faces.iter().enumerate() {
            for corner in 0..3 {
                let (p, q) = (face[(corner + 1) % 3], face[(corner + 2) % 3]);
                sides.push(([p.min(q), p.max(q)], f, corner));
            }
        }
        sides.sort_unstable();
        let mut edges = Vec::with_capacity(sides.len() / 2 + 1);
        let mut opposite = vec![[0; 3]; faces.len()];
        let mut hinges = Vec::with_capacity(sides.len() / 2);
        for group in sides.chunk_by(|a, b| a.0 == b.0) {
            let edge = group[0].0;
            for &(_, f, corner) in group {
                opposite[f][corner] = edges.len() as u32;
            }
            if let [(_, f, i), (_, g, j)] = *group {
                hinges.push([edge[0], edge[1], faces[f][i], faces[g][j]]);
            }
            edges.push(edge);
        }
        Ok(Self {
            faces,
            edges,
            opposite,
            hinges,
        })
    }

    /// Returns the number of neighbors of each vertex.
    pub fn degrees(&self, vertices: usize) -> Vec<u32> {
        let mut degrees = vec![0; vertices];
        for &v in self.edges.iter().flatten() {
            degrees[v as usize] += 1;
        }
        degrees
    }
}
