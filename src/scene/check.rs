//! Checks of a scene and a camera. Errors name the object and the field.

use burn::tensor::{DType, Device, Tensor};

use super::material::{Channel, ChannelValue};
use super::parameters::{ParameterId, Visit, visit_camera, visit_scene};
use super::{Albedo, Camera, Object, Scene};
use crate::device::label;
use crate::error::{Error, Result};
use crate::geometry::Context;

/// Checks that all tensors are of one device and float type, and that values are finite and in range.
pub(crate) fn check_scene(scene: &Scene) -> Result<Context> {
    if let Some((name, expected)) = &scene.mistake {
        let name = format!("{name:?}");
        let field = "the name given to map_object";
        return Err(Error::invalid("scene", field, name, expected));
    }
    let triangles: usize = scene.objects.iter().map(|o| o.mesh.faces.len()).sum();
    if triangles == 0 {
        return Err(Error::NoTriangles {
            path: None,
            objects: scene.objects.len(),
        });
    }
    let first = &scene.objects[0].mesh.vertices;
    let context = Context {
        device: first.device().inner(),
        dtype: first.dtype(),
    };
    let visit = |same: &mut SameKind<'_>| visit_scene(&mut scene.clone(), same);
    same_kind(&context, visit, |id| scene.place_of(id))?;
    for object in &scene.objects {
        let name = &object.name;
        let mesh = &object.mesh;
        mesh.check(name)?;
        if object.materials.is_empty() {
            return Err(Error::invalid(
                name,
                "materials",
                "empty",
                "at least one material",
            ));
        }
        let count = object.materials.len();
        let of_face = &object.face_materials;
        if !of_face.is_empty() && of_face.len() != mesh.faces.len() {
            return Err(Error::invalid(
                name,
                "face_materials",
                format!("of length {}", of_face.len()),
                format!("one for each of the {} faces, or empty", mesh.faces.len()),
            ));
        }
        if let Some(f) = of_face.iter().position(|&m| m as usize >= count) {
            return Err(Error::invalid(
                name,
                format!("material of face {f}"),
                of_face[f],
                format!("an index under {count}"),
            ));
        }
        for material in &object.materials {
            material.check(name)?;
        }
        check_textures(object)?;
    }
    scene.environment.check()?;
    Ok(context)
}

/// Checks that the camera's tensors are of the scene's device and float type, and its values finite and in range.
pub(crate) fn check_camera(camera: &Camera, context: &Context) -> Result<()> {
    let visit = |same: &mut SameKind<'_>| visit_camera(&mut camera.clone(), same);
    same_kind(context, visit, |id| ("camera".into(), id.field().into()))?;
    camera.check()
}

/// Finds the first tensor of another device or float type.
struct SameKind<'a> {
    context: &'a Context,
    other: Option<(ParameterId, Device, DType)>,
}

impl Visit for SameKind<'_> {
    fn visit<const D: usize>(&mut self, id: ParameterId, tensor: &mut Tensor<D>) {
        let (device, dtype) = (tensor.device(), tensor.dtype());
        let same = device == self.context.device && dtype == self.context.dtype;
        if !same && self.other.is_none() {
            self.other = Some((id, device, dtype));
        }
    }
}

/// `place` gives the names of the object and the field of a tensor.
fn same_kind(
    context: &Context,
    visit: impl FnOnce(&mut SameKind<'_>),
    place: impl FnOnce(ParameterId) -> (String, String),
) -> Result<()> {
    let mut same = SameKind {
        context,
        other: None,
    };
    visit(&mut same);
    let Some((id, device, dtype)) = same.other else {
        return Ok(());
    };
    let (object, field) = place(id);
    let like = "like the scene's first object";
    let (found, expected) = if device == context.device {
        let expected = format!("{:?} {like}: Tensor::cast changes it", context.dtype);
        (format!("of dtype {dtype:?}"), expected)
    } else {
        let there = label(&context.device);
        let expected = format!("{there} {like}: make it there, or move it by Tensor::to_device");
        (format!("on the device {}", label(&device)), expected)
    };
    Err(Error::invalid(object, field, found, expected))
}

impl Scene {
    /// The names of the object and the field of a tensor, for messages.
    fn place_of(&self, id: ParameterId) -> (String, String) {
        use ParameterId::{Material, Normals, Uvs, Velocity, Vertices};
        let field = id.field().to_string();
        let object = match id {
            Vertices(i) | Uvs(i) | Normals(i) | Velocity(i) => self.objects[i].name.clone(),
            Material(m, _) => {
                let all = self.objects.iter().flat_map(|o| {
                    let of = |m: &super::Material| format!("{}, material {}", o.name, m.name);
                    o.materials.iter().map(of)
                });
                all.into_iter().nth(m).unwrap_or_default()
            }
            _ => "scene".into(),
        };
        (object, field)
    }
}

/// Checks that an object whose materials have textures has texture coordinates.
fn check_textures(object: &Object) -> Result<()> {
    if object.mesh.uvs.is_some() || object.mesh.faces.is_empty() {
        return Ok(());
    }
    for (i, m) in object.materials.iter().enumerate() {
        let is_used = match object.face_materials.as_slice() {
            [] => i == 0,
            list => list.contains(&(i as u32)),
        };
        let mut m = m.clone();
        let name = format!("{}, material {}", object.name, m.name);
        for (channel, value) in Channel::ALL.into_iter().zip(m.channels()) {
            if is_used && matches!(value, ChannelValue::Colour(Albedo::Texture { .. })) {
                return Err(Error::invalid(
                    name,
                    channel.name(),
                    "a texture",
                    "a colour, since the mesh has no texture coordinates: Mesh::with_uvs adds them",
                ));
            }
        }
    }
    Ok(())
}
