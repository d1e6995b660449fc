use std::collections::HashMap;
use std::sync::Arc;

use burn::tensor::{DType, Device, Int, Tensor, TensorData};

use super::Transform;
use super::corners::CornerAttribute;
use super::parameter::{Range, without_tape};
use super::transform::Mistake;
use crate::error::{Error, Result};
use crate::geometry::host_values;
use crate::meshing::TriangleMesh;

/// A triangle mesh. Faces share vertices: a gradient step on a vertex moves every face at it.
#[derive(Clone)]
#[cfg_attr(feature = "remote", derive(serde::Serialize, serde::Deserialize))]
pub struct Mesh {
    /// Positions `[V, 3]`, in scene units.
    #[cfg_attr(feature = "remote", serde(with = "super::slots::tensor"))]
    pub vertices: Tensor<2>,
    /// Rows of `vertices` for the corners of each face, counter-clockwise seen from the front.
    #[cfg_attr(feature = "remote", serde(with = "super::slots::faces"))]
    pub faces: Arc<Vec<[u32; 3]>>,
    /// Texture coordinates `[_, 2]`. (0, 0) is the lower left of an image.
    pub uvs: Option<CornerAttribute>,
    /// Shading normals `[_, 3]`, of any length but 0.
    pub normals: Option<CornerAttribute>,
    /// Colors `[_, 3]`, linear RGB. The diffuse albedo of materials is multiplied by them.
    pub colors: Option<CornerAttribute>,
    /// Tangents `[_, 4]` for normal maps: x, y, z, and the sign of the bitangent, 1 or −1.
    pub tangents: Option<CornerAttribute>,
    /// The first mistake in building the mesh. A render returns it as an error.
    pub(crate) mistake: Option<Mistake>,
}

impl TryFrom<&Mesh> for TriangleMesh {
    type Error = Error;

    /// Reads the vertices back to the host, and checks the mesh as [`TriangleMesh::check`] does.
    fn try_from(mesh: &Mesh) -> Result<Self> {
        Self::new(mesh.host_vertices()?, mesh.faces.to_vec())
    }
}

impl Mesh {
    /// Creates a mesh from vertices `[V, 3]` and faces.
    pub fn new(vertices: Tensor<2>, faces: Vec<[u32; 3]>) -> Self {
        Self::of_faces(vertices, Arc::new(faces))
    }

    pub(crate) fn of_faces(vertices: Tensor<2>, faces: Arc<Vec<[u32; 3]>>) -> Self {
        Self {
            vertices,
            faces,
            uvs: None,
            normals: None,
            colors: None,
            tangents: None,
            mistake: None,
        }
    }

    /// Creates a mesh of constant vertices on a device, in the device's default float type.
    pub fn from_host(vertices: &[[f64; 3]], faces: Vec<[u32; 3]>, device: &Device) -> Self {
        Self::new(host_tensor(vertices, device), faces)
    }

    /// Sets texture coordinates `[V, 2]`, one row per vertex.
    pub fn with_uvs(mut self, uvs: Tensor<2>) -> Self {
        self.uvs = Some(CornerAttribute::new(uvs, self.faces.clone()));
        self
    }

    /// Sets shading normals `[V, 3]`, one row per vertex. They need not be of unit length.
    pub fn with_normals(mut self, normals: Tensor<2>) -> Self {
        self.normals = Some(CornerAttribute::new(normals, self.faces.clone()));
        self
    }

    /// Replaces the vertices by a tensor `[V, 3]`.
    /// Faces and attributes stay unchanged. Shading normals may therefore no longer fit the shape (see
    /// [`smooth_normals`](Self::smooth_normals)).
    pub fn with_vertices(mut self, vertices: Tensor<2>) -> Self {
        self.vertices = vertices;
        self
    }

    /// Casts all tensors to a float type.
    pub fn cast(mut self, dtype: DType) -> Self {
        self.vertices = self.vertices.cast(dtype);
        for attribute in self.attributes_mut().into_iter().flatten() {
            attribute.values = attribute.values.clone().cast(dtype);
        }
        self
    }

    /// Applies a transform to vertices, shading normals and tangents.
    /// If the transform mirrors the mesh, the winding of faces is reversed, as in [`scaled`](Self::scaled).
    pub fn transformed(mut self, transform: &Transform) -> Self {
        if let Some(mistake) = transform.mistake() {
            let found = format!("transformed by {}", mistake.found);
            return self.mistaken(Mistake::new(found, &mistake.expected));
        }
        self.vertices = transform.apply(self.vertices);
        if let Some(normals) = &mut self.normals {
            normals.values = transform.apply_to_normals(normals.values.clone());
        }
        self.turn_tangents(|t| transform.apply_to_directions(t));
        if transform.mirrors() {
            self.mirrored()
        } else {
            self
        }
    }

    /// Records a mistake unless one is recorded already.
    pub(super) fn mistaken(mut self, mistake: Mistake) -> Self {
        self.mistake.get_or_insert(mistake);
        self
    }

    /// Splits every face into four coplanar faces, so that the shape stays the same.
    /// The new vertices are in the graph of the old vertices. Texture coordinates, normals, colors and tangents are
    /// dropped.
    ///
    /// # Errors
    /// If the vertices are not `[V, 3]` or a face has an index out of range.
    pub fn subdivided(&self) -> Result<Self> {
        check_indices("mesh", "vertices", self.vertices.dims(), 3, &self.faces)?;
        let count = self.vertices.dims()[0] as u32;
        let mut ends: Vec<(u32, u32)> = Vec::new();
        let faces = split_in_four(&self.faces, |i, j| {
            ends.push((i, j));
            count + ends.len() as u32 - 1
        });
        let at = |f: fn(&(u32, u32)) -> u32| {
            let rows: Vec<i32> = ends.iter().map(|e| f(e) as i32).collect();
            let rows = Tensor::from_ints(rows.as_slice(), &self.vertices.device().inner());
            self.vertices.clone().select(0, rows)
        };
        let middles = (at(|e| e.0) + at(|e| e.1)) * 0.5;
        let vertices = Tensor::cat(vec![self.vertices.clone(), middles], 0);
        Ok(Self {
            mistake: self.mistake.clone(),
            ..Self::new(vertices, faces)
        })
    }

    /// Reads the vertices back to the host.
    ///
    /// # Errors
    /// If the vertices can't be read.
    pub fn host_vertices(&self) -> Result<Vec<[f64; 3]>> {
        Ok(host_values(&self.vertices)?
            .chunks_exact(3)
            .map(|v| [v[0], v[1], v[2]])
            .collect())
    }

    /// Reads the vertices back to the host. Checks that they are finite and that the indices of the faces are in range.
    pub(crate) fn checked_vertices(&self, object: &str) -> Result<Vec<[f64; 3]>> {
        if let Some(mistake) = &self.mistake {
            let Mistake { found, expected } = mistake;
            return Err(Error::invalid(object, "mesh", found, expected));
        }
        let flat = check_table(object, "vertices", &self.vertices, 3, &self.faces)?;
        Ok(flat.chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect())
    }

    pub(crate) fn check(&self, object: &str) -> Result<()> {
        self.checked_vertices(object)?;
        for (name, width, attribute) in self.attributes() {
            let Some(attribute) = attribute else { continue };
            let rows = self.check_attribute(object, name, attribute, width)?;
            let wrong = |row: u32, of: usize, expected: &str| {
                let (field, found) = (format!("{name} {row}"), &rows[width * row as usize..]);
                Err(Error::invalid(
                    object,
                    field,
                    format!("{:?}", &found[..of]),
                    expected,
                ))
            };
            let mut used = attribute.faces.iter().flatten().copied();
            let row = |row: u32| &rows[width * row as usize..][..width];
            match name {
                "normals" => {
                    if let Some(zero) = used.find(|&i| row(i) == [0.0; 3]) {
                        return wrong(zero, 3, "a vector that is not 0");
                    }
                }
                "tangents" => {
                    if let Some(other) = used.find(|&i| row(i)[3].abs() != 1.0) {
                        return wrong(
                            other,
                            4,
                            "1 or −1 as the fourth number, the bitangent's side",
                        );
                    }
                }
                // Tracked colors may be below 0 for a step of a fit.
                "colors" if !attribute.values.is_tracked() => {
                    let negative = |&i: &u32| row(i).iter().any(|&v| v < 0.0);
                    if let Some(dark) = used.find(negative) {
                        return wrong(dark, 3, "numbers ≥ 0");
                    }
                }
                _ => {}
            }
        }
        Ok(())
    }

    pub(super) fn check_attribute(
        &self,
        object: &str,
        field: &str,
        a: &CornerAttribute,
        width: usize,
    ) -> Result<Vec<f64>> {
        if a.faces.len() != self.faces.len() {
            let (field, found) = (format!("{field} faces"), a.faces.len());
            let expected = format!("one entry for each of the {} faces", self.faces.len());
            return Err(Error::invalid(object, field, found, expected));
        }
        check_table(object, field, &a.values, width, &a.faces)
    }
}

/// Splits each face into four. `middle` adds the vertex in the middle of an edge and returns its index.
pub(super) fn split_in_four(
    faces: &[[u32; 3]],
    mut middle: impl FnMut(u32, u32) -> u32,
) -> Vec<[u32; 3]> {
    let mut middles = HashMap::new();
    let mut of_edge = |i: u32, j: u32| {
        let edge = middles.entry((i.min(j), i.max(j)));
        *edge.or_insert_with(|| middle(i, j))
    };
    let split = |&[a, b, c]: &[u32; 3]| {
        let (ab, bc, ca) = (of_edge(a, b), of_edge(b, c), of_edge(c, a));
        [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
    };
    faces.iter().flat_map(split).collect()
}

/// Returns the rows `[N, C]` of `values` with these indices.
pub(crate) fn take_rows(values: &Tensor<2>, rows: impl Iterator<Item = u32>) -> Tensor<2> {
    let [_, width] = values.dims();
    let index: Vec<i32> = rows.map(|row| row as i32).collect();
    let n = index.len();
    let values = without_tape(values);
    let device = values.device().inner();
    let index = Tensor::<2, Int>::from_data(TensorData::new(index, [n, 1]), &device);
    // `gather`, not `select`: the backward pass of `select` over a long index is serial on GPUs.
    values.gather(0, index.expand([n, width]))
}

/// Creates a tensor from host rows, in the device's default float type.
pub(crate) fn host_tensor<const C: usize>(rows: &[[f64; C]], device: &Device) -> Tensor<2> {
    let flat: Vec<f64> = rows.iter().flatten().copied().collect();
    Tensor::from_data(TensorData::new(flat, [rows.len(), C]), device)
}

/// Reads values back to the host. Checks their shape, that they are finite and that the indices of the faces are in
/// range.
fn check_table(
    object: &str,
    field: &str,
    values: &Tensor<2>,
    width: usize,
    faces: &[[u32; 3]],
) -> Result<Vec<f64>> {
    check_indices(object, field, values.dims(), width, faces)?;
    let host = host_values(values)?;
    let row = host.iter().position(|&v| !(v as f32).is_finite());
    if let Some(i) = row.map(|i| i / width) {
        Range::Finite.check(object, &format!("{field} {i}"), &host[i * width..][..width])?;
    }
    Ok(host)
}

pub(super) fn check_indices(
    object: &str,
    field: &str,
    [rows, columns]: [usize; 2],
    width: usize,
    faces: &[[u32; 3]],
) -> Result<()> {
    if columns != width {
        let found = format!("of shape [{rows}, {columns}]");
        return Err(Error::invalid(
            object,
            field,
            found,
            format!("shape [_, {width}]"),
        ));
    }
    let outside = |f: &[u32; 3]| f.iter().any(|&v| v as usize >= rows);
    let Some(i) = faces.iter().position(outside) else {
        return Ok(());
    };
    let (field, found) = (format!("{field} of face {i}"), format!("{:?}", faces[i]));
    let expected = format!("indices under {rows}, counted from 0");
    Err(Error::invalid(object, field, found, expected))
}
