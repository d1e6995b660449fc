//! OBJ files, read.

use std::path::Path;
use std::sync::Arc;

use burn::tensor::Device;
use glam::DVec3;

use super::LoadLimits;
use super::description::Corners;
use super::notes::Notes;
use super::obj_materials::Materials;
use super::obj_text::{ObjText, ObjectText};
use super::polygon::Polygons;
use super::srgb::srgb_to_linear;
use crate::error::{Error, Result};
use crate::scene::{Mesh, Object, Scene};

/// Reads an OBJ file with its MTL files; see [`Scene::load`].
pub(super) fn read(path: &Path, device: &Device, limits: &LoadLimits) -> Result<Scene> {
    let mut notes = Notes::default();
    let mut text = ObjText::read(path, limits, &mut notes)?;
    let mesh = text.parse(path)?;
    let triangles = triangles(&text, &mesh, limits).map_err(|(face, message)| {
        let line = text.line_of_face(face);
        Error::format(path, format!("line {line}: {message}"))
    })?;
    if triangles.iter().all(Vec::is_empty) {
        return Err(Error::NoTriangles {
            path: Some(path.into()),
            objects: 0,
        });
    }
    let objects = std::mem::take(&mut text.objects);
    let mut builder = Builder {
        device,
        colours: colours(&mesh.vertex_color),
        vertices: Renumbered::new(mesh.positions.len() / 3),
        uvs: Renumbered::new(mesh.texcoords.len() / 2),
        normals: Renumbered::new(mesh.normals.len() / 3),
        used: Renumbered::new(text.materials.all.len()),
        mesh: &mesh,
        materials: Materials::new(path, &text, limits, device, &mut notes)?,
    };
    let mut scene = Scene::new();
    scene.objects.reserve_exact(objects.len());
    for (object, triangles) in objects.into_iter().zip(triangles) {
        scene.objects.push(builder.object(object, triangles)?);
    }
    notes.warn(path);
    Ok(scene)
}

/// A triangle of an object.
struct Triangle {
    /// Among the corners of all faces.
    corners: [u32; 3],
    material: u32,
}

/// The triangles of each object; else the number of a face, and what is wrong with it.
fn triangles(
    text: &ObjText,
    mesh: &tobj::Mesh,
    limits: &LoadLimits,
) -> std::result::Result<Vec<Vec<Triangle>>, (usize, String)> {
    let mut of_object: Vec<Vec<Triangle>> = Vec::new();
    of_object.resize_with(text.objects.len(), Vec::new);
    let mut polygons = Polygons::new(limits);
    let (mut runs, mut first, mut face) = (text.runs.iter().peekable(), 0, 0);
    while let Some(run) = runs.next() {
        let into = &mut of_object[run.object as usize];
        let end = runs.peek().map(|next| next.first_face);
        while first < mesh.indices.len() && end.is_none_or(|end| face < end) {
            // Without a list all faces have three.
            let count = mesh.face_arities.get(face).map_or(3, |&n| n as usize);
            let places = mesh.indices[first..first + count].iter();
            let places = places.map(|&i| DVec3::from(row(&mesh.positions, i)));
            let filled = polygons.triangles(&places.collect::<Vec<_>>());
            let filled = filled.map_err(|message| (face, message))?;
            into.extend(filled.into_iter().map(|t| Triangle {
                corners: t.map(|c| (first + c) as u32),
                material: run.material,
            }));
            first += count;
            face += 1;
        }
    }
    Ok(of_object)
}

/// Linear colours of vertices, white for those without one. Numbers of files are sRGB, as exporters write them; where
/// any is above 1 they are bytes.
fn colours(flat: &[f64]) -> Vec<[f64; 3]> {
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

/// Row i of flat values.
fn row<const C: usize>(flat: &[f64], i: u32) -> [f64; C] {
    let start = C * i as usize;
    std::array::from_fn(|c| flat[start + c])
}

/// Numbers of rows in the order of their first use.
struct Renumbered {
    number: Vec<u32>,
    /// The rows that have a number.
    used: Vec<u32>,
}

impl Renumbered {
    fn new(rows: usize) -> Self {
        Self {
            number: vec![u32::MAX; rows],
            used: Vec::new(),
        }
    }

    fn of(&mut self, row: u32) -> u32 {
        let number = &mut self.number[row as usize];
        if *number == u32::MAX {
            *number = self.used.len() as u32;
            self.used.push(row);
        }
        *number
    }

    /// The rows that were used, each at its number; then none is.
    fn take(&mut self) -> Vec<u32> {
        for &row in &self.used {
            self.number[row as usize] = u32::MAX;
        }
        std::mem::take(&mut self.used)
    }

    /// The values of corners with these indices.
    fn corners<const C: usize>(&mut self, flat: &[f64], faces: Vec<[u32; 3]>) -> Corners<C> {
        let faces = faces.into_iter().map(|f| f.map(|i| self.of(i))).collect();
        let values = self.take().into_iter().map(|i| row(flat, i)).collect();
        Corners { values, faces }
    }
}

/// Makes the objects of a file.
struct Builder<'a> {
    device: &'a Device,
    mesh: &'a tobj::Mesh,
    /// Of the vertices, if they have any.
    colours: Vec<[f64; 3]>,
    vertices: Renumbered,
    uvs: Renumbered,
    normals: Renumbered,
    used: Renumbered,
    materials: Materials<'a>,
}

impl Builder<'_> {
    fn object(&mut self, text: ObjectText, triangles: Vec<Triangle>) -> Result<Object> {
        let (all, n) = (self.mesh, triangles.len());
        let of_corners = |indices: &[u32]| -> Vec<[u32; 3]> {
            let of = |t: &Triangle| t.corners.map(|c| indices[c as usize]);
            triangles.iter().map(of).collect()
        };
        let faces = of_corners(&all.indices).into_iter();
        let faces = faces.map(|f| f.map(|i| self.vertices.of(i))).collect();
        let rows = self.vertices.take();
        let positions: Vec<[f64; 3]> = rows.iter().map(|&i| row(&all.positions, i)).collect();
        let mut mesh = Mesh::from_host(&positions, faces, self.device);
        if text.uvs && !all.texcoord_indices.is_empty() {
            let faces = of_corners(&all.texcoord_indices);
            let corners: Corners<2> = self.uvs.corners(&all.texcoords, faces);
            mesh.uvs = corners.attribute(n, self.device);
        }
        if text.normals && !all.normal_indices.is_empty() {
            let faces = of_corners(&all.normal_indices);
            let corners: Corners<3> = self.normals.corners(&all.normals, faces);
            match corners.values.contains(&[0.0; 3]) {
                true => self.materials.notes.add(ZERO_NORMALS, &text.name),
                false => mesh.normals = corners.attribute(n, self.device),
            }
        }
        if !self.colours.is_empty() {
            let corners = Corners {
                values: rows.iter().map(|&i| self.colours[i as usize]).collect(),
                faces: mesh.faces.to_vec(),
            };
            // White ones change nothing.
            if corners.values.iter().any(|c| *c != [1.0; 3]) {
                mesh.colours = corners.attribute(n, self.device);
            }
        }
        let of_faces = triangles.iter().map(|t| self.used.of(t.material));
        let face_materials: Vec<u32> = of_faces.collect();
        let textured = mesh.uvs.is_some();
        let mut object = Object::new(mesh).named(text.name);
        let used = self.used.take().into_iter();
        let materials = used.map(|m| self.materials.get(m, textured));
        object.materials = materials.collect::<Result<_>>()?;
        if object.materials.len() > 1 {
            object.face_materials = Arc::new(face_materials);
        }
        Ok(object)
    }
}

const ZERO_NORMALS: &str = "objects have normals of zero length, so that none of theirs are used";
