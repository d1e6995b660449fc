//! Builds the meshes of an OBJ file's objects.

use glam::DVec3;

use super::Reader;
use crate::error::Result;
use crate::io::description::{Corners, MeshDescription};
use crate::io::polygon::Polygons;
use crate::io::srgb::srgb_to_linear;

impl Reader<'_> {
    /// Returns the meshes of the objects. Their materials are indices of the names in `usemtl` statements.
    pub fn meshes(&self, all: &tobj::Mesh) -> Result<Vec<MeshDescription>> {
        let mut meshes: Vec<MeshDescription> = Vec::new();
        meshes.resize_with(self.objects.names.len(), MeshDescription::default);
        let mut polygons = Polygons::new(&self.files);
        let mut first = 0;
        for (i, face) in self.faces.iter().enumerate() {
            // An empty list means that all faces have three corners.
            let count = all.face_arities.get(i).map_or(3, |&n| n as usize);
            let places = all.indices[first..first + count].iter();
            let places = places.map(|&v| DVec3::from(row(&all.positions, v)));
            let triangles = polygons.triangles(&places.collect::<Vec<_>>());
            let mesh = &mut meshes[face.object as usize];
            for corners in triangles.map_err(|m| self.fail(face.line, m))? {
                let of = |indices: &[u32]| corners.map(|c| indices[first + c]);
                mesh.faces.push(of(&all.indices));
                if face.uvs {
                    mesh.uvs.faces.push(of(&all.texcoord_indices));
                }
                if face.normals {
                    mesh.normals.faces.push(of(&all.normal_indices));
                }
                mesh.face_materials.push(face.material);
            }
            first += count;
        }
        let rows = [&all.positions, &all.texcoords, &all.normals].map(|rows| rows.len());
        let most = rows.into_iter().max().unwrap_or(0);
        let mut numbers = Numbers(vec![u32::MAX; most.max(self.materials.names.len())]);
        let colors = colors(&all.vertex_color);
        for mesh in &mut meshes {
            let vertices = numbers.renumber(mesh.faces.as_flattened_mut());
            mesh.positions = vertices.iter().map(|&v| row(&all.positions, v)).collect();
            numbers.take(&mut mesh.uvs, &all.texcoords);
            numbers.take(&mut mesh.normals, &all.normals);
            let of_vertices = vertices.iter().filter_map(|&v| colors.get(v as usize));
            let of_vertices: Vec<[f64; 3]> = of_vertices.copied().collect();
            // Colors that are all white change nothing.
            if of_vertices.iter().any(|c| *c != [1.0; 3]) {
                mesh.colors = Corners {
                    values: of_vertices,
                    faces: mesh.faces.clone(),
                };
            }
            let used = numbers.renumber(&mut mesh.face_materials);
            mesh.materials = used.into_iter().map(|m| Some(m as usize)).collect();
        }
        Ok(meshes)
    }
}

/// Returns the linear colors of vertices; vertices without a color are white. Colors of files are sRGB, as exporters
/// write them. If any number is above 1, they are bytes.
fn colors(flat: &[f64]) -> Vec<[f64; 3]> {
    let one = match flat.iter().any(|&v| v > 1.0) {
        true => 255.0,
        false => 1.0,
    };
    let linear = |v: f64| match v.is_nan() {
        true => 1.0,
        false => f64::from(srgb_to_linear((v / one).clamp(0.0, 1.0) as f32)),
    };
    let rows = flat.chunks_exact(3);
    rows.map(|c| [c[0], c[1], c[2]].map(linear)).collect()
}

/// Returns row `i` of a flat table.
fn row<const C: usize>(flat: &[f64], i: u32) -> [f64; C] {
    let start = C * i as usize;
    std::array::from_fn(|c| flat[start + c])
}

/// New indices of rows; `u32::MAX` for rows without one.
struct Numbers(Vec<u32>);

impl Numbers {
    /// Replaces indices by new ones in the order of their first use, and returns the old ones in that order.
    fn renumber(&mut self, indices: &mut [u32]) -> Vec<u32> {
        let mut used = Vec::new();
        for index in indices {
            let number = &mut self.0[*index as usize];
            if *number == u32::MAX {
                *number = used.len() as u32;
                used.push(*index);
            }
            *index = *number;
        }
        used.iter().for_each(|&row| self.0[row as usize] = u32::MAX);
        used
    }

    /// Renumbers the indices of corners, and copies the values that they use.
    fn take<const C: usize>(&mut self, corners: &mut Corners<C>, flat: &[f64]) {
        let used = self.renumber(corners.faces.as_flattened_mut());
        corners.values = used.iter().map(|&i| row(flat, i)).collect();
    }
}
