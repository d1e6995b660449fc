//! Which vertices, edges and faces of a mesh touch, by index.

use crate::error::{Error, Result};

/// Edges and pairs of faces of a mesh, in an order that depends on the faces alone.
///
/// Vertices are the same if their indices are: those of equal position are not welded. A face that
/// names a vertex twice has no area and no part in this.
#[derive(Clone, Debug)]
pub(crate) struct Connectivity {
    /// Rows of the vertices.
    pub faces: Vec<[u32; 3]>,
    /// Each edge once, the lesser index first, ascending.
    pub edges: Vec<[u32; 2]>,
    /// For each face the rows of `edges` opposite to its corners.
    pub opposite: Vec<[u32; 3]>,
    /// For each edge of exactly two faces: its ends, and the third vertices of the faces.
    pub hinges: Vec<[u32; 4]>,
}

impl Connectivity {
    /// The connectivity of the faces of a mesh of `vertices` vertices.
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

        // The sides of the faces, sorted: those of one edge follow each other.
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

    /// The number of neighbours of each vertex.
    pub fn degrees(&self, vertices: usize) -> Vec<u32> {
        let mut degrees = vec![0; vertices];
        for &v in self.edges.iter().flatten() {
            degrees[v as usize] += 1;
        }
        degrees
    }
}
