//! A scene's values, read back from its tensors.

use std::sync::Arc;

use super::check::check_scene;
use super::material::{Channel, MaterialKind, Value};
use super::{CornerAttribute, Parameter, Scene, Wrap};
use crate::error::Result;
use crate::geometry::{Context, by_rows, host_values};

/// A scene on the host.
pub(crate) struct HostScene {
    pub context: Context,
    pub objects: Vec<HostObject>,
    /// The materials of all objects, one object after the other.
    pub materials: Vec<HostMaterial>,
    pub environment: HostTexture,
    /// False only for an environment that is a constant black.
    pub shines: bool,
}

/// An object on the host.
pub(crate) struct HostObject {
    /// Scene units.
    pub positions: Vec<[f64; 3]>,
    pub faces: Arc<Vec<[u32; 3]>>,
    pub uvs: Option<HostAttribute<2>>,
    pub normals: Option<HostAttribute<3>>,
    /// Scene units over the shutter, where it moves or may come to.
    pub velocity: Option<[f64; 3]>,
    /// The first of its materials in the scene, and which of them each face has (the first, if the list
    /// is empty).
    pub first_material: usize,
    pub face_materials: Arc<Vec<u32>>,
}

/// Values at the corners of faces.
pub(crate) struct HostAttribute<const C: usize> {
    pub values: Vec<[f32; C]>,
    pub faces: Arc<Vec<[u32; 3]>>,
}

/// A material on the host.
pub(crate) struct HostMaterial {
    /// The parameters, in the order of [`Channel::ALL`](super::material::Channel::ALL).
    pub channels: Vec<HostTexture>,
    pub kind: MaterialKind,
}

impl HostMaterial {
    /// Whether its radiance is other than 0.
    fn shines(&self) -> bool {
        let emission = &self.channels[Channel::Emission as usize];
        !matches!(emission, HostTexture::Constant([0.0, 0.0, 0.0]))
    }
}

/// A colour, or an image of colours.
pub(crate) enum HostTexture {
    Constant([f64; 3]),
    Image {
        /// RGB, row after row.
        texels: Vec<f32>,
        width: usize,
        height: usize,
        wrap: Wrap,
    },
}

impl HostScene {
    /// Checks a scene and reads it back.
    ///
    /// # Errors
    /// If the scene is not valid.
    pub fn new(scene: &Scene) -> Result<Self> {
        let context = check_scene(scene)?;
        let mut objects = Vec::with_capacity(scene.objects.len());
        let mut materials = Vec::new();
        for object in &scene.objects {
            let velocity = match &object.velocity {
                Some(Parameter::Constant([0.0, 0.0, 0.0])) | None => None,
                Some(v) => Some(v.values()?),
            };
            objects.push(HostObject {
                positions: object.mesh.host_vertices()?,
                faces: object.mesh.faces.clone(),
                uvs: object.mesh.uvs.as_ref().map(attribute).transpose()?,
                normals: object.mesh.normals.as_ref().map(attribute).transpose()?,
                velocity,
                first_material: materials.len(),
                face_materials: object.face_materials.clone(),
            });
            for m in &object.materials {
                let kind = m.kind();
                let channels = m.clone().channels().map(texture);
                materials.push(HostMaterial {
                    kind,
                    channels: channels.into_iter().collect::<Result<_>>()?,
                });
            }
        }
        let this = Self {
            context,
            objects,
            materials,
            environment: texture(scene.environment.clone().value())?,
            shines: scene.environment.shines(),
        };
        if !this.has_light() {
            log::warn!(
                "the scene has no light, so that its image is black: give it an environment \
                 (Scene::environment), or an object a Material::emitter"
            );
        }
        Ok(this)
    }

    /// Whether any emitter or the environment has a radiance other than 0.
    pub fn has_light(&self) -> bool {
        let sky = match &self.environment {
            HostTexture::Constant(c) => *c != [0.0; 3],
            HostTexture::Image { texels, .. } => texels.iter().any(|&v| v != 0.0),
        };
        sky || self.materials.iter().any(|m| m.shines())
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

/// Reads a value back. A scalar is the first of three numbers, the others are 0.
fn texture(value: Value<'_>) -> Result<HostTexture> {
    Ok(match value {
        Value::Colour(p) => HostTexture::Constant(p.values()?),
        Value::Scalar(p) => HostTexture::Constant([p.values()?[0], 0.0, 0.0]),
        Value::Image(image, wrap) => {
            let [height, width, channels] = image.dims();
            let mut texels = Vec::with_capacity(height * width * channels);
            by_rows(image, |values| texels.extend_from_slice(values))?;
            HostTexture::Image {
                texels,
                width,
                height,
                wrap,
            }
        }
    })
}
