//! Splits vertices at seams, for file formats with one row of each attribute per vertex.

use std::collections::HashMap;

use crate::error::Result;
use crate::geometry::host_values;
use crate::scene::{CornerAttribute, Mesh};

/// A mesh on the host whose vertices are split where an attribute has a seam.
pub(super) struct Split {
    pub positions: Vec<[f64; 3]>,
    pub uvs: Option<Vec<[f64; 2]>>,
    pub normals: Option<Vec<[f64; 3]>>,
    pub colors: Option<Vec<[f64; 3]>>,
    pub tangents: Option<Vec<[f64; 4]>>,
    pub faces: Vec<[u32; 3]>,
}

/// The row of a vertex in each attribute, in the order of [`Mesh::attributes`].
type Rows = [u32; 4];

impl Split {
    /// Splits a mesh. Vertices keep their indices, and vertices added at seams follow them.
    pub fn of(mesh: &Mesh) -> Result<Self> {
        let mut positions = mesh.host_vertices()?;
        let attributes = mesh.attributes().map(|(_, _, attribute)| attribute);
        // The attribute rows of each vertex so far.
        let mut known: Vec<Option<Rows>> = vec![None; positions.len()];
        let mut added: HashMap<(u32, Rows), u32> = HashMap::new();
        let mut faces = mesh.faces.to_vec();
        for (f, face) in faces.iter_mut().enumerate() {
            for (c, vertex) in face.iter_mut().enumerate() {
                let wanted = attributes.map(|a| a.map_or(0, |a| a.faces[f][c]));
                if *known[*vertex as usize].get_or_insert(wanted) == wanted {
                    continue;
                }
                let next = known.len() as u32;
                let at = *added.entry((*vertex, wanted)).or_insert(next);
                if at == next {
                    positions.push(positions[*vertex as usize]);
                    known.push(Some(wanted));
                }
                *vertex = at;
            }
        }
        let [uvs, normals, colors, tangents] = attributes;
        // Vertices without a face get default values. The default normal has a direction.
        Ok(Self {
            positions,
            uvs: rows(uvs, 0, &known, [0.0; 2])?,
            normals: rows(normals, 1, &known, [0.0, 0.0, 1.0])?,
            colors: rows(colors, 2, &known, [1.0; 3])?,
            tangents: rows(tangents, 3, &known, [1.0, 0.0, 0.0, 1.0])?,
            faces,
        })
    }

    /// Returns the part of the mesh that the given faces use.
    pub fn part(&self, faces: impl Iterator<Item = usize>) -> Self {
        let mut numbers: HashMap<u32, u32> = HashMap::new();
        let mut used: Vec<usize> = Vec::new();
        let faces = faces.map(|f| {
            self.faces[f].map(|v| {
                *numbers.entry(v).or_insert_with(|| {
                    used.push(v as usize);
                    used.len() as u32 - 1
                })
            })
        });
        let faces = faces.collect();
        Self {
            positions: used.iter().map(|&v| self.positions[v]).collect(),
            uvs: taken(self.uvs.as_deref(), &used),
            normals: taken(self.normals.as_deref(), &used),
            colors: taken(self.colors.as_deref(), &used),
            tangents: taken(self.tangents.as_deref(), &used),
            faces,
        }
    }
}

/// Returns the value of an attribute for each vertex, and `none` for vertices without a face.
fn rows<const C: usize>(
    attribute: Option<&CornerAttribute>,
    place: usize,
    known: &[Option<Rows>],
    none: [f64; C],
) -> Result<Option<Vec<[f64; C]>>> {
    let Some(attribute) = attribute else {
        return Ok(None);
    };
    let flat = host_values(&attribute.values)?;
    let row = |rows: &Option<Rows>| match rows {
        Some(rows) => {
            let first = C * rows[place] as usize;
            std::array::from_fn(|i| flat[first + i])
        }
        None => none,
    };
    Ok(Some(known.iter().map(row).collect()))
}

fn taken<T: Copy>(all: Option<&[T]>, used: &[usize]) -> Option<Vec<T>> {
    all.map(|all| used.iter().map(|&v| all[v]).collect())
}
