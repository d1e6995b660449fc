//! Builds scenes from descriptions. Only this step decides which parts of a description are rendered.

use std::collections::HashMap;
use std::sync::Arc;

use burn::tensor::Device;
use glam::{DAffine3, DMat3, DVec3};

use super::build_materials::{Materials, untextured};
use super::description::{Corners, Description, MeshDescription, ObjectDescription};
use super::files::Place;
use crate::error::Result;
use crate::scene::{CornerAttribute, List, Material, Mesh, Object, Scene, host_tensor};

const ZERO_NORMALS: &str = "objects have normals of zero length, so that none of theirs are used";

/// Builds the scene of a file from its description.
pub(super) fn scene(description: &Description, place: Place) -> Result<Scene> {
    let mut builder = Builder {
        description,
        device: place.device,
        materials: Materials::new(description, place)?,
        lists: HashMap::new(),
        templates: HashMap::new(),
    };
    let objects = description.objects.iter();
    Ok(Scene {
        objects: objects.map(|o| builder.object(o)).collect::<Result<_>>()?,
        lights: description.lights.iter().cloned().collect(),
        ..Scene::new()
    })
}

struct Builder<'a> {
    description: &'a Description,
    device: &'a Device,
    materials: Materials<'a>,
    /// The materials of each mesh that was built, and the index of each face's material.
    lists: HashMap<usize, (List<Material>, Arc<Vec<u32>>)>,
    /// Meshes before their transform, by index and by whether the instance is mirrored.
    templates: HashMap<(usize, bool), Mesh>,
}

impl Builder<'_> {
    fn object(&mut self, object: &ObjectDescription) -> Result<Object> {
        let mesh = self.mesh(object);
        let (materials, face_materials) = match self.lists.get(&object.mesh) {
            Some(list) => list.clone(),
            None => {
                let of_faces = &self.description.meshes[object.mesh].face_materials;
                let of_faces = Arc::new(of_faces.clone());
                let list = (self.list(object, mesh.uvs.is_some())?, of_faces);
                self.lists.insert(object.mesh, list.clone());
                list
            }
        };
        let mut built = Object::new(mesh).with_name(object.name.clone());
        if materials.len() > 1 {
            built.face_materials = face_materials;
        }
        built.materials = materials;
        Ok(built)
    }

    /// Returns the materials of an object's mesh.
    fn list(&mut self, object: &ObjectDescription, has_uvs: bool) -> Result<List<Material>> {
        let used = self.description.meshes[object.mesh].materials.iter();
        let materials = used.map(|&index| {
            let material = self.materials.get(index)?;
            Ok(match has_uvs {
                true => material,
                false => untextured(material, &object.name),
            })
        });
        materials.collect()
    }

    /// Returns the mesh of an object in world space. If the transform mirrors, the winding is reversed, so that the
    /// front stays outside.
    fn mesh(&mut self, object: &ObjectDescription) -> Mesh {
        let (description, device) = (self.description, self.device);
        let (from, to_world) = (&description.meshes[object.mesh], &object.to_world);
        let linear = to_world.matrix3;
        let mirrored = linear.determinant() < 0.0;
        let shared = self.templates.entry((object.mesh, mirrored));
        let shared = shared.or_insert_with(|| template(from, mirrored, device));
        let mut mesh = shared.clone();
        if *to_world != DAffine3::IDENTITY {
            let place = |&p: &[f64; 3]| to_world.transform_point3(p.into()).to_array();
            let positions: Vec<[f64; 3]> = from.positions.iter().map(place).collect();
            mesh.vertices = host_tensor(&positions, device);
        }
        if let Some(of_mesh) = &mut mesh.normals {
            let turn = of_normals(linear);
            let turned = |&n: &[f64; 3]| (turn * DVec3::from(n)).normalize_or_zero().to_array();
            let normals: Vec<[f64; 3]> = match linear == DMat3::IDENTITY {
                true => from.normals.values.clone(),
                false => from.normals.values.iter().map(turned).collect(),
            };
            match normals.contains(&[0.0; 3]) {
                false => of_mesh.values = host_tensor(&normals, device),
                true => {
                    description.notes.add(ZERO_NORMALS, &object.name);
                    mesh.normals = None;
                }
            }
        }
        if let Some(of_mesh) = &mut mesh.tangents {
            let side = if mirrored { -1.0 } else { 1.0 };
            let placed = |&[x, y, z, w]: &[f64; 4]| {
                let [x, y, z] = (linear * DVec3::new(x, y, z)).to_array();
                [x, y, z, side * w]
            };
            let tangents: Vec<[f64; 4]> = from.tangents.values.iter().map(placed).collect();
            of_mesh.values = host_tensor(&tangents, device);
        }
        mesh
    }
}

/// Returns a mesh before its transform.
fn template(from: &MeshDescription, mirrored: bool, device: &Device) -> Mesh {
    let faces = wound(&from.faces, mirrored);
    let mut mesh = Mesh::of_faces(host_tensor(&from.positions, device), faces);
    let count = mesh.faces.len();
    mesh.uvs = attribute(&from.uvs, count, mirrored, device);
    mesh.normals = attribute(&from.normals, count, mirrored, device);
    mesh.colors = attribute(&from.colors, count, mirrored, device);
    mesh.tangents = attribute(&from.tangents, count, mirrored, device);
    mesh
}

/// Returns an attribute of a mesh with `faces` faces, or `None` unless every face has it.
fn attribute<const C: usize>(
    corners: &Corners<C>,
    faces: usize,
    mirrored: bool,
    device: &Device,
) -> Option<CornerAttribute> {
    let is_whole = faces > 0 && corners.faces.len() == faces;
    is_whole.then(|| CornerAttribute {
        values: host_tensor(&corners.values, device),
        faces: wound(&corners.faces, mirrored),
    })
}

fn wound(faces: &[[u32; 3]], mirrored: bool) -> Arc<Vec<[u32; 3]>> {
    Arc::new(match mirrored {
        true => faces.iter().map(|&[a, b, c]| [a, c, b]).collect(),
        false => faces.to_vec(),
    })
}

/// Returns the matrix that transforms normals when `m` transforms positions: the cofactors of `m`, which are its
/// inverse transpose times its determinant. If `m` mirrors, the sign is flipped, so that normals stay outside.
fn of_normals(m: DMat3) -> DMat3 {
    let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis];
    let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
    cofactors * m.determinant().signum()
}
