//! Reads meshes: the triangles of primitives, with vertices at the same position joined again.

use std::collections::HashMap;

use glam::DVec3;
use serde_json::Value;

use super::Document;
use super::accessors::Accessor;
use super::materials::{Coordinates, Material};
use super::schema::{Mesh, Primitive};
use crate::error::Result;
use crate::io::description::MeshDescription;

/// How corners form triangles.
#[derive(Clone, Copy, PartialEq)]
enum Mode {
    Triangles,
    Strip,
    Fan,
}

impl Mode {
    /// Returns the mode of a primitive, `None` for points and lines.
    fn of(primitive: &Primitive) -> Option<Self> {
        match primitive.mode {
            None | Some(4) => Some(Self::Triangles),
            Some(5) => Some(Self::Strip),
            Some(6) => Some(Self::Fan),
            _ => None,
        }
    }

    /// Returns the number of triangles that `corners` corners form.
    fn triangles(self, corners: u64) -> u64 {
        match self {
            Self::Triangles => corners / 3,
            _ => corners.saturating_sub(2),
        }
    }

    /// Returns the corners of triangle `t`.
    fn corners(self, t: usize) -> [usize; 3] {
        match self {
            Self::Triangles => [3 * t, 3 * t + 1, 3 * t + 2],
            Self::Fan => [0, t + 1, t + 2],
            Self::Strip if t.is_multiple_of(2) => [t, t + 1, t + 2],
            Self::Strip => [t + 1, t, t + 2],
        }
    }
}

/// Returns an upper bound of the number of triangles of a mesh, from its primitives' numbers of corners.
pub(super) fn most_triangles(document: &Document, mesh: &Mesh) -> u64 {
    let of = |primitive: &Primitive| {
        let corners = primitive.indices.or_else(|| position(primitive));
        let corners = corners.and_then(|i| document.root.accessors.get(i));
        let mode = Mode::of(primitive);
        let count = corners.and_then(|a| a["count"].as_u64()).unwrap_or(0);
        mode.map_or(0, |mode| mode.triangles(count))
    };
    let each = mesh.primitives.iter().map(of);
    each.fold(0, u64::saturating_add)
}

/// Reads a mesh. glTF splits vertices where any attribute has a seam. Vertices at the same position are joined here,
/// so that a closed surface stays closed.
pub(super) fn mesh(
    document: &Document,
    index: usize,
    materials: &[Material],
) -> Result<MeshDescription> {
    let json = &document.root.meshes[index];
    let any = |name: &str| {
        let mut names = json.primitives.iter().flat_map(|p| p.attributes.keys());
        names.any(|n| n.starts_with(name))
    };
    let mut builder = Builder {
        document,
        mesh: MeshDescription::default(),
        at: HashMap::new(),
        normals: any("NORMAL"),
        uvs: any("TEXCOORD_"),
        colors: any("COLOR_0"),
    };
    for (i, primitive) in json.primitives.iter().enumerate() {
        let place = format!("meshes[{index}].primitives[{i}]");
        builder.add(primitive, &place, materials)?;
    }
    Ok(builder.mesh)
}

struct Builder<'a> {
    document: &'a Document<'a>,
    mesh: MeshDescription,
    /// The vertex at each position, by the bits of the position.
    at: HashMap<[u64; 3], u32>,
    /// Attributes that any primitive has. Primitives without them get default values.
    normals: bool,
    uvs: bool,
    colors: bool,
}

/// The arrays that a primitive refers to.
struct Arrays {
    positions: Accessor,
    indices: Option<Accessor>,
    normals: Option<Accessor>,
    uvs: Option<(Accessor, Option<Coordinates>)>,
    colors: Option<Accessor>,
    tangents: Option<Accessor>,
}

/// The vertex of the mesh for a vertex of a primitive, and its row in each attribute.
#[derive(Clone, Copy)]
struct Rows {
    place: u32,
    normal: u32,
    uv: u32,
    color: u32,
    tangent: u32,
}

impl<'a> Builder<'a> {
    fn add(&mut self, primitive: &Primitive, place: &str, materials: &[Material]) -> Result<()> {
        let document = self.document;
        let Some(mode) = Mode::of(primitive) else {
            if let Some(mode @ 7..) = primitive.mode {
                let message = format!("is {mode}, expected 0 to 6");
                return Err(document.fail(format!("{place}.mode"), message));
            }
            document.skip("points and lines");
            return Ok(());
        };
        if !primitive.targets.is_empty() {
            document.skip("morph targets");
        }
        let material = match primitive.material {
            Some(index) => {
                let field = format!("{place}.material");
                document.get(&document.root.materials, index, field, "materials")?;
                Some(index)
            }
            None => None,
        };
        let coordinates = material.and_then(|m| materials[m].coordinates);
        let arrays = self.arrays(primitive, place, coordinates)?;
        let known = self.mesh.materials.iter().position(|&m| m == material);
        let material = known.unwrap_or_else(|| {
            self.mesh.materials.push(material);
            self.mesh.materials.len() - 1
        });
        let count = arrays.indices.as_ref().unwrap_or(&arrays.positions).count;
        let mut rows = HashMap::new();
        for t in 0..mode.triangles(count as u64) as usize {
            let corners = mode.corners(t);
            let vertices = match &arrays.indices {
                Some(indices) => corners.map(|c| indices.index(c)),
                None => corners.map(|c| c as u32),
            };
            let [a, b, c] = vertices;
            if mode == Mode::Strip && (a == b || b == c || a == c) {
                // Strips contain triangles without area to continue elsewhere.
                continue;
            }
            if let Some(c) = vertices
                .iter()
                .position(|&v| v as usize >= arrays.positions.count)
            {
                let message = format!(
                    "has the index {} at {}, but there are {} positions",
                    vertices[c], corners[c], arrays.positions.count
                );
                return Err(document.fail(format!("{place}.indices"), message));
            }
            let found = vertices.map(|v| match rows.get(&v) {
                Some(&rows) => rows,
                None => {
                    let new = self.vertex(&arrays, v as usize);
                    rows.insert(v, new);
                    new
                }
            });
            self.face(&arrays, found);
        }
        let faces = self.mesh.faces.len();
        self.mesh.face_materials.resize(faces, material as u32);
        Ok(())
    }

    fn arrays(
        &self,
        primitive: &Primitive,
        place: &str,
        coordinates: Option<Coordinates>,
    ) -> Result<Arrays> {
        let document = self.document;
        let Some(index) = position(primitive) else {
            return Err(document.fail(format!("{place}.attributes"), "has no POSITION"));
        };
        let is_empty = |a: &Value| a["bufferView"].is_null() && a["sparse"].is_null();
        if primitive
            .extensions
            .contains_key("KHR_draco_mesh_compression")
            && document.root.accessors.get(index).is_some_and(is_empty)
        {
            let message = "is compressed by Draco (KHR_draco_mesh_compression), expected a file without compression";
            return Err(document.fail(place, message));
        }
        let positions = document.accessor(index, &format!("{place}.attributes.POSITION"))?;
        let width = |accessor: &Accessor, widths: &[usize], name: &str| {
            let valid = widths.contains(&accessor.width);
            let message = format_args!("has rows of {}, expected {widths:?}", accessor.width);
            document.unless(valid, format_args!("{place}.attributes.{name}"), message)
        };
        width(&positions, &[3], "POSITION")?;
        let attribute = |name: &str, widths: &[usize]| {
            let Some(&index) = primitive.attributes.get(name) else {
                return Ok(None);
            };
            let field = format!("{place}.attributes.{name}");
            let found = document.accessor(index, &field)?;
            width(&found, widths, name)?;
            let (count, expected) = (found.count, positions.count);
            let message = format_args!("has {count} rows, but there are {expected} positions");
            document.unless(count == expected, field, message)?;
            Ok(Some(found))
        };
        let set = coordinates.map_or(0, |c| c.set);
        let uvs = attribute(&format!("TEXCOORD_{set}"), &[2])?;
        let indices = match primitive.indices {
            Some(index) => {
                let field = format!("{place}.indices");
                let indices = document.accessor(index, &field)?;
                let message = "are no scalars of unsigned integers";
                document.unless(indices.is_index(), field, message)?;
                Some(indices)
            }
            None => None,
        };
        let normals = attribute("NORMAL", &[3])?;
        let tangents = attribute("TANGENT", &[4])?;
        Ok(Arrays {
            // Without normals, faces are flat, and their tangents would differ.
            tangents: tangents.filter(|_| normals.is_some()),
            normals,
            uvs: uvs.map(|uvs| (uvs, coordinates)),
            colors: attribute("COLOR_0", &[3, 4])?,
            indices,
            positions,
        })
    }

    /// Adds a vertex of a primitive with its attributes.
    fn vertex(&mut self, arrays: &Arrays, index: usize) -> Rows {
        let mesh = &mut self.mesh;
        // Turns −0 into 0, which is the same position.
        let position = arrays.positions.row::<3>(index).map(|v| v + 0.0);
        let next = mesh.positions.len() as u32;
        let place = *self.at.entry(position.map(f64::to_bits)).or_insert(next);
        if place == next {
            mesh.positions.push(position);
        }
        let normal = arrays.normals.as_ref().map(|n| n.row(index));
        let uv = arrays.uvs.as_ref().map(|(uvs, coordinates)| {
            let [u, v] = uvs.row(index);
            coordinates.map_or([u, 1.0 - v], |c| c.apply([u, v]))
        });
        let color = arrays.colors.as_ref().map(|c| c.row(index));
        let tangent = arrays.tangents.as_ref().map(|t| {
            let [x, y, z, w] = t.row(index);
            [x, y, z, if w < 0.0 { -1.0 } else { 1.0 }]
        });
        Rows {
            place,
            normal: normal.map_or(0, |n| mesh.normals.push(n)),
            tangent: tangent.map_or(0, |t| mesh.tangents.push(t)),
            // Primitives without coordinates get zeros as placeholders.
            uv: if self.uvs {
                mesh.uvs.push(uv.unwrap_or([0.0; 2]))
            } else {
                0
            },
            color: if self.colors {
                mesh.colors.push(color.unwrap_or([1.0; 3]))
            } else {
                0
            },
        }
    }

    fn face(&mut self, arrays: &Arrays, corners: [Rows; 3]) {
        let mesh = &mut self.mesh;
        let face = corners.map(|c| c.place);
        mesh.faces.push(face);
        if self.uvs {
            mesh.uvs.faces.push(corners.map(|c| c.uv));
        }
        if self.colors {
            mesh.colors.faces.push(corners.map(|c| c.color));
        }
        // If any primitive has no tangents, the tangents of the whole mesh are computed instead.
        if arrays.tangents.is_some() {
            mesh.tangents.faces.push(corners.map(|c| c.tangent));
        }
        if !self.normals {
            return;
        }
        let rows = match arrays.normals {
            Some(_) => corners.map(|c| c.normal),
            // A primitive without normals is flat.
            None => {
                let [a, b, c] = face.map(|v| DVec3::from(mesh.positions[v as usize]));
                let normal = (b - a).cross(c - a).try_normalize();
                [mesh.normals.push(normal.unwrap_or(DVec3::Z).to_array()); 3]
            }
        };
        mesh.normals.faces.push(rows);
    }
}

fn position(primitive: &Primitive) -> Option<usize> {
    primitive.attributes.get("POSITION").copied()
}
