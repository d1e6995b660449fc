//! Scenes from descriptions: the one place that says which of their parts this crate renders.

use std::path::Path;
use std::sync::Arc;

use burn::tensor::Device;
use glam::{DAffine3, DMat3, DVec3};

use super::LoadLimits;
use super::build_materials::{Materials, untextured};
use super::description::{
    CameraDescription, Corners, Description, LightDescription, LightKind, MeshDescription,
    ObjectDescription, ProjectionDescription,
};
use crate::error::Result;
use crate::scene::{Camera, Light, Mesh, Object, Scene};

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
        materials: Materials::new(description, limits, device),
    };
    let mut scene = Scene::new();
    for object in &description.objects {
        scene = scene.with(builder.object(object)?);
    }
    for from in &description.lights {
        scene = scene.light(light(from));
    }
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
}

impl Builder<'_> {
    fn object(&mut self, object: &ObjectDescription) -> Result<Object> {
        let description = &self.description.meshes[object.mesh];
        let mesh = self.mesh(description, &object.to_world, &object.name);
        let mut built = Object::new(mesh).named(object.name.clone());
        let has_uvs = built.mesh.uvs.is_some();
        let materials = description.materials.iter().map(|&index| {
            let material = self.materials.get(index)?;
            Ok(match has_uvs {
                true => material,
                false => untextured(material, &object.name),
            })
        });
        built.materials = materials.collect::<Result<_>>()?;
        if built.materials.len() > 1 {
            built.face_materials = Arc::new(description.face_materials.clone());
        }
        Ok(built)
    }

    /// A mesh at its place. A mirror image is wound the other way, so that its front stays outside.
    fn mesh(&self, from: &MeshDescription, to_world: &DAffine3, name: &str) -> Mesh {
        let linear = to_world.matrix3;
        let mirrored = linear.determinant() < 0.0;
        let wound = |faces: &[[u32; 3]]| match mirrored {
            true => faces.iter().map(|&[a, b, c]| [a, c, b]).collect(),
            false => faces.to_vec(),
        };
        let place = |&p: &[f64; 3]| to_world.transform_point3(p.into()).to_array();
        let positions: Vec<[f64; 3]> = from.positions.iter().map(place).collect();
        let faces = wound(&from.faces);
        let count = faces.len();
        let mut mesh = Mesh::from_host(&positions, faces, self.device);
        let uvs = Corners {
            values: from.uvs.values.clone(),
            faces: wound(&from.uvs.faces),
        };
        mesh.uvs = uvs.attribute(count, self.device);
        let turn = of_normals(linear);
        let turned = |&n: &[f64; 3]| (turn * DVec3::from(n)).normalize_or_zero().to_array();
        let normals = Corners {
            values: match linear == DMat3::IDENTITY {
                true => from.normals.values.clone(),
                false => from.normals.values.iter().map(turned).collect(),
            },
            faces: wound(&from.normals.faces),
        };
        if normals.values.contains(&[0.0; 3]) {
            log::warn!("{name}: it has normals of zero length, using none of its normals");
        } else {
            mesh.normals = normals.attribute(count, self.device);
        }
        let colours = Corners {
            values: from.colours.values.clone(),
            faces: wound(&from.colours.faces),
        };
        mesh.colours = colours.attribute(count, self.device);
        let side = if mirrored { -1.0 } else { 1.0 };
        let placed = |&[x, y, z, w]: &[f64; 4]| {
            let [x, y, z] = (linear * DVec3::new(x, y, z)).to_array();
            [x, y, z, side * w]
        };
        let tangents = Corners {
            values: from.tangents.values.iter().map(placed).collect(),
            faces: wound(&from.tangents.faces),
        };
        mesh.tangents = tangents.attribute(count, self.device);
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
