//! Scenes from descriptions: the one place that says which of their parts this crate renders.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use burn::tensor::Device;
use glam::{DMat3, DVec3};

use super::LoadLimits;
use super::build_materials::{Materials, untextured};
use super::description::{
    CameraDescription, Description, LightDescription, LightKind, ObjectDescription,
    ProjectionDescription, attribute,
};
use crate::error::Result;
use crate::scene::{
    Camera, CornerAttribute, Light, List, Material, Mesh, Object, Scene, host_tensor,
};

/// Makes the scene of a file's description.
pub(super) fn scene(
    description: &Description,
    path: &Path,
    limits: &LoadLimits,
    device: &Device,
) -> Result<Scene> {
    let mut builder = Builder {
        description,
        device,
        materials: Materials::new(description, path, limits, device)?,
        lists: HashMap::new(),
        shared: HashMap::new(),
    };
    let objects = description.objects.iter();
    let scene = Scene {
        objects: objects.map(|o| builder.object(o)).collect::<Result<_>>()?,
        lights: description.lights.iter().map(light).collect(),
        ..Scene::new()
    };
    let dropped = builder.materials.dropped;
    if !dropped.is_empty() {
        let list: Vec<&str> = dropped.into_iter().collect();
        let list = list.join(", ");
        log::warn!("{}: these parts are not rendered: {list}", path.display());
    }
    Ok(scene)
}

/// A camera as a file describes it.
pub(super) fn camera(description: &CameraDescription) -> Camera {
    let CameraDescription {
        eye, forward, up, ..
    } = description;
    let camera = Camera::look_at(eye.to_array(), (*eye + *forward).to_array()).up(up.to_array());
    match description.projection {
        ProjectionDescription::Perspective { fov_y } => camera.fov_y(fov_y),
        ProjectionDescription::Orthographic { height } => camera.orthographic(height),
    }
}

fn light(from: &LightDescription) -> Light {
    let (position, direction) = (from.position.to_array(), from.direction.to_array());
    match from.kind {
        LightKind::Point => Light::point(position, from.intensity),
        LightKind::Spot { inner, outer } => {
            Light::spot(position, direction, from.intensity, [inner], [outer])
        }
        LightKind::Directional => Light::directional(direction, from.intensity),
    }
}

struct Builder<'a> {
    description: &'a Description,
    device: &'a Device,
    materials: Materials<'a>,
    /// The materials of each mesh that was built.
    lists: HashMap<usize, List<Material>>,
    /// What instances of a mesh have in common, if they are mirrored alike.
    shared: HashMap<(usize, bool), Arc<Common>>,
}

/// What all instances of a mesh share, wound as they are.
struct Common {
    faces: Arc<Vec<[u32; 3]>>,
    uvs: Option<CornerAttribute>,
    colours: Option<CornerAttribute>,
    normal_faces: Arc<Vec<[u32; 3]>>,
    tangent_faces: Arc<Vec<[u32; 3]>>,
    face_materials: Arc<Vec<u32>>,
}

impl Builder<'_> {
    fn object(&mut self, object: &ObjectDescription) -> Result<Object> {
        let mirrored = object.to_world.matrix3.determinant() < 0.0;
        let common = self.common(object.mesh, mirrored);
        let mesh = self.mesh(object, &common, mirrored);
        let materials = match self.lists.get(&object.mesh) {
            Some(list) => list.clone(),
            None => {
                let list = self.list(object, mesh.uvs.is_some())?;
                self.lists.insert(object.mesh, list.clone());
                list
            }
        };
        let mut built = Object::new(mesh).named(object.name.clone());
        if materials.len() > 1 {
            built.face_materials = common.face_materials.clone();
        }
        built.materials = materials;
        Ok(built)
    }

    /// The materials of an object's mesh.
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

    fn common(&mut self, mesh: usize, mirrored: bool) -> Arc<Common> {
        let (description, device) = (self.description, self.device);
        let common = self.shared.entry((mesh, mirrored)).or_insert_with(|| {
            let from = &description.meshes[mesh];
            let wound = |faces: &[[u32; 3]]| match mirrored {
                true => faces.iter().map(|&[a, b, c]| [a, c, b]).collect(),
                false => faces.to_vec(),
            };
            let count = from.faces.len();
            let (uvs, colours) = (&from.uvs, &from.colours);
            Arc::new(Common {
                uvs: attribute(&uvs.values, &Arc::new(wound(&uvs.faces)), count, device),
                colours: attribute(
                    &colours.values,
                    &Arc::new(wound(&colours.faces)),
                    count,
                    device,
                ),
                normal_faces: Arc::new(wound(&from.normals.faces)),
                tangent_faces: Arc::new(wound(&from.tangents.faces)),
                faces: Arc::new(wound(&from.faces)),
                face_materials: Arc::new(from.face_materials.clone()),
            })
        });
        common.clone()
    }

    /// A mesh at its place. A mirror image is wound the other way, so that its front stays outside.
    fn mesh(&self, object: &ObjectDescription, common: &Common, mirrored: bool) -> Mesh {
        let (from, to_world) = (&self.description.meshes[object.mesh], &object.to_world);
        let linear = to_world.matrix3;
        let place = |&p: &[f64; 3]| to_world.transform_point3(p.into()).to_array();
        let positions: Vec<[f64; 3]> = from.positions.iter().map(place).collect();
        let vertices = host_tensor(&positions, self.device);
        let mut mesh = Mesh::of_faces(vertices, common.faces.clone());
        mesh.uvs = common.uvs.clone();
        mesh.colours = common.colours.clone();
        let count = mesh.faces.len();
        let turn = of_normals(linear);
        let turned = |&n: &[f64; 3]| (turn * DVec3::from(n)).normalize_or_zero().to_array();
        let normals: Vec<[f64; 3]> = match linear == DMat3::IDENTITY {
            true => from.normals.values.clone(),
            false => from.normals.values.iter().map(turned).collect(),
        };
        if normals.contains(&[0.0; 3]) {
            let name = &object.name;
            log::warn!("{name}: it has normals of zero length, using none of its normals");
        } else {
            mesh.normals = attribute(&normals, &common.normal_faces, count, self.device);
        }
        let side = if mirrored { -1.0 } else { 1.0 };
        let placed = |&[x, y, z, w]: &[f64; 4]| {
            let [x, y, z] = (linear * DVec3::new(x, y, z)).to_array();
            [x, y, z, side * w]
        };
        let tangents: Vec<[f64; 4]> = from.tangents.values.iter().map(placed).collect();
        mesh.tangents = attribute(&tangents, &common.tangent_faces, count, self.device);
        mesh
    }
}

/// The matrix of normals for one of positions: its cofactors, which are its inverse's transpose times its
/// determinant, turned so that normals stay outside where it mirrors.
fn of_normals(m: DMat3) -> DMat3 {
    let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis];
    let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
    cofactors * m.determinant().signum()
}
