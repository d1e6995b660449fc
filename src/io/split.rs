//! Meshes with one row of each attribute for each vertex, as formats without seams have them.

use std::collections::HashMap;

use burn::tensor::Tensor;

use crate::error::Result;
use crate::geometry::host_values;
use crate::scene::Mesh;

/// A mesh on the host, its vertices split where an attribute has a seam.
pub(super) struct Split {
    pub positions: Vec<[f64; 3]>,
    pub uvs: Option<Vec<[f64; 2]>>,
    pub normals: Option<Vec<[f64; 3]>>,
    pub faces: Vec<[u32; 3]>,
}

impl Split {
    /// Vertices keep their numbers; those that a seam adds come after them.
    pub fn of(mesh: &Mesh) -> Result<Self> {
        let mut positions = mesh.host_vertices()?;
        let uvs = mesh.uvs.as_ref();
        let normals = mesh.normals.as_ref();
        let of_uvs = uvs.map(|a| rows::<2>(&a.values)).transpose()?;
        let of_normals = normals.map(|a| rows::<3>(&a.values)).transpose()?;
        // The attributes' rows of each vertex that is there so far.
        let mut known: Vec<Option<[u32; 2]>> = vec![None; positions.len()];
        let mut added: HashMap<(u32, [u32; 2]), u32> = HashMap::new();
        let mut faces = mesh.faces.to_vec();
        for (f, face) in faces.iter_mut().enumerate() {
            for (c, vertex) in face.iter_mut().enumerate() {
                let row =
                    |a: Option<&crate::scene::CornerAttribute>| a.map_or(0, |a| a.faces[f][c]);
                let wanted = [row(uvs), row(normals)];
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
        // Vertices without a face have none, but normals have a direction.
        let row = |rows: Option<[u32; 2]>, i: usize| rows.map(|r| r[i] as usize);
        let uvs = of_uvs.map(|all| {
            let of = |&k: &Option<[u32; 2]>| row(k, 0).map_or([0.0; 2], |r| all[r]);
            known.iter().map(of).collect()
        });
        let normals = of_normals.map(|all| {
            let of = |&k: &Option<[u32; 2]>| row(k, 1).map_or([0.0, 0.0, 1.0], |r| all[r]);
            known.iter().map(of).collect()
        });
        Ok(Self {
            positions,
            uvs,
            normals,
            faces,
        })
    }

    /// The part of it that some of its faces have.
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
            uvs: self
                .uvs
                .as_ref()
                .map(|all| used.iter().map(|&v| all[v]).collect()),
            normals: self
                .normals
                .as_ref()
                .map(|all| used.iter().map(|&v| all[v]).collect()),
            faces,
        }
    }
}

fn rows<const C: usize>(values: &Tensor<2>) -> Result<Vec<[f64; C]>> {
    let flat = host_values(values)?;
    let rows = flat
        .chunks_exact(C)
        .map(|row| std::array::from_fn(|i| row[i]));
    Ok(rows.collect())
}
