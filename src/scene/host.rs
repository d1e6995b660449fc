//! A scene's values, read back from its tensors.

use std::sync::Arc;

use burn::tensor::Tensor;

use super::check::{check_devices, check_values};
use super::host_textures::Shared;
use super::texture::Value;
use super::transfer::{Constants, Transfer};
use super::{CornerAttribute, Parameter, Scene};
use crate::error::Result;
use crate::geometry::{Context, host_values, now};
use softray_kernels::host::{Holes, HostAttribute, HostMaterial, HostObject, HostScene};
use softray_kernels::warning;

impl Scene {
    /// Checks the scene and reads its values back. Returns also the context of its renders.
    ///
    /// # Errors
    /// If the scene is not valid.
    pub(crate) fn read_back(&self) -> Result<(HostScene, Context)> {
        let context = check_devices(self)?;
        let mut scene = self.clone();
        let transfer = Transfer {
            scenes: std::slice::from_mut(&mut scene),
            cameras: &mut [],
            more: &mut [],
        };
        let read = async |tensor: Tensor<1>| host_values(&tensor);
        now(transfer.fetch(&context, &mut Constants::default(), |_| None, read))?;
        Ok((scene.host()?, context))
    }

    /// Checks the values of the scene, which are on the host, and copies them.
    ///
    /// # Errors
    /// If a value is not valid.
    pub(crate) fn host(&self) -> Result<HostScene> {
        check_values(self)?;
        let mut objects = Vec::with_capacity(self.objects.len());
        let (mut materials, mut masks) = (Vec::new(), Vec::new());
        let mut read = Shared::default();
        for object in &self.objects {
            let velocity = match &object.velocity {
                Some(Parameter::Constant([0.0, 0.0, 0.0])) | None => None,
                Some(v) => Some(v.values()?),
            };
            objects.push(HostObject {
                positions: object.mesh.host_vertices()?,
                faces: object.mesh.faces.clone(),
                uvs: object.mesh.uvs.as_ref().map(attribute).transpose()?,
                normals: object.mesh.normals.as_ref().map(attribute).transpose()?,
                colors: object.mesh.colors.as_ref().map(attribute).transpose()?,
                tangents: object.mesh.tangents.as_ref().map(attribute).transpose()?,
                velocity,
                first_material: materials.len(),
                face_materials: object.face_materials.clone(),
            });
            for (i, m) in object.materials.iter().enumerate() {
                let kind = m.kind();
                let mut m = m.clone();
                let mask = m.alpha_mask.as_ref();
                let mask = mask.map(|mask| read.mask(mask, || object.material_name(i)));
                masks.push(mask.transpose()?);
                let map = m.normal_map.as_mut();
                let map = map.map(|map| read.texture(Value::Image(&mut map.texels, map.wrap)));
                materials.push(HostMaterial {
                    kind,
                    normal_map: map.transpose()?,
                    channels: (m.channels())
                        .map(|(_, value)| read.texture(value))
                        .collect::<Result<_>>()?,
                });
            }
        }
        let host = HostScene {
            holes: Holes::new(objects.iter().flat_map(HostObject::masked_faces), masks)
                .map(Arc::new),
            objects,
            materials,
            lights: (self.lights.iter())
                .map(|light| light.host("light"))
                .collect::<Result<_>>()?,
            environment: read.texture(self.environment.clone().value())?,
            shines: self.environment.shines(),
        };
        if !host.has_area() {
            warning!(
                "none of the scene's triangles has an area, so that nothing of it is seen: are their corners at one \
                 place or in a line?"
            );
        } else if !host.has_light() {
            warning!(
                "the scene has no light, so that its image is black: give it an environment \
                 (Scene::with_environment), a Light (Scene::with_light), or an object a Material::emitter"
            );
        }
        Ok(host)
    }
}

fn attribute<const C: usize>(a: &CornerAttribute) -> Result<HostAttribute<C>> {
    let values = host_values(&a.values)?;
    let rows = values.chunks_exact(C);
    Ok(HostAttribute {
        values: rows
            .map(|row| std::array::from_fn(|i| row[i] as f32))
            .collect(),
        faces: a.faces.clone(),
    })
}
