//! Whatever a user can get wrong in a scene, named.

use burn::tensor::{DType, Device};

use super::{Albedo, Camera, Material, Object, Parameter, Scene};
use crate::device::label;
use crate::error::{Error, Result};
use crate::geometry::Context;

/// One device and float type for all tensors; values finite and in range.
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
    let same = |object: &str, field: &str, device, dtype| {
        same_kind(&context, (object, field), device, dtype)
    };
    for object in &scene.objects {
        let name = &object.name;
        let mesh = &object.mesh;
        same(
            name,
            "vertices",
            mesh.vertices.device(),
            mesh.vertices.dtype(),
        )?;
        for (field, a) in [("uvs", &mesh.uvs), ("normals", &mesh.normals)] {
            if let Some(a) = a {
                same(name, field, a.values.device(), a.values.dtype())?;
            }
        }
        mesh.check(name)?;
        if let Some(t) = object.velocity.as_ref().and_then(Parameter::tensor) {
            same(name, "velocity", t.device(), t.dtype())?;
        }
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
            for (field, t) in material_tensors(material) {
                same(
                    &format!("{name}, material {}", material.name),
                    field,
                    t.0,
                    t.1,
                )?;
            }
            material.check(name)?;
        }
        check_textures(object)?;
    }
    if let Some((device, dtype)) = scene.environment.kind() {
        same("scene", "environment", device, dtype)?;
    }
    scene.environment.check()?;
    Ok(context)
}

/// The camera's tensors are like the scene's; values finite and in range.
pub(crate) fn check_camera(camera: &Camera, context: &Context) -> Result<()> {
    for (field, t) in camera.tensors() {
        same_kind(context, ("camera", field), t.device(), t.dtype())?;
    }
    camera.check()
}

fn same_kind(
    context: &Context,
    (object, field): (&str, &str),
    device: Device,
    dtype: DType,
) -> Result<()> {
    if device != context.device {
        return Err(Error::DeviceMismatch {
            object: object.into(),
            field: field.into(),
            found: label(&device),
            expected: label(&context.device),
        });
    }
    if dtype != context.dtype {
        return Err(Error::DtypeMismatch {
            object: object.into(),
            field: field.into(),
            found: format!("{dtype:?}"),
            expected: format!("{:?}", context.dtype),
        });
    }
    Ok(())
}

/// What has a texture has texture coordinates.
fn check_textures(object: &Object) -> Result<()> {
    if object.mesh.uvs.is_some() || object.mesh.faces.is_empty() {
        return Ok(());
    }
    for (i, m) in object.materials.iter().enumerate() {
        let is_used = match object.face_materials.as_slice() {
            [] => i == 0,
            list => list.contains(&(i as u32)),
        };
        for (field, albedo) in [("diffuse", &m.diffuse), ("specular", &m.specular)] {
            if is_used && matches!(albedo, Albedo::Texture { .. }) {
                return Err(Error::invalid(
                    format!("{}, material {}", object.name, m.name),
                    field,
                    "a texture",
                    "a colour, since the mesh has no texture coordinates: Mesh::with_uvs adds them",
                ));
            }
        }
    }
    Ok(())
}

fn material_tensors(m: &Material) -> Vec<(&'static str, (Device, DType))> {
    let albedo = |a: &Albedo| match a {
        Albedo::Constant(p) => p.tensor().map(|t| (t.device(), t.dtype())),
        Albedo::Texture { texels, .. } => Some((texels.device(), texels.dtype())),
    };
    [
        ("diffuse", albedo(&m.diffuse)),
        ("specular", albedo(&m.specular)),
        (
            "shininess",
            m.shininess.tensor().map(|t| (t.device(), t.dtype())),
        ),
        (
            "emission",
            m.emission.tensor().map(|t| (t.device(), t.dtype())),
        ),
    ]
    .into_iter()
    .filter_map(|(n, t)| t.map(|t| (n, t)))
    .collect()
}
