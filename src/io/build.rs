//! Scenes from descriptions: the one place that says which of their parts this crate renders.

use std::collections::{BTreeSet, HashMap};
use std::io::{BufReader, Cursor};
use std::path::Path;
use std::sync::Arc;

use burn::tensor::{Device, Tensor, TensorData};
use glam::{DAffine3, DMat3, DVec3};

use super::decode::Decoded;
use super::description::{
    Alpha, CameraDescription, Corners, Description, ImageSource, LightDescription,
    MaterialDescription, MeshDescription, ObjectDescription, ProjectionDescription, TextureUse,
};
use super::limits::open;
use super::{HostImage, LoadLimits};
use crate::error::Result;
use crate::scene::{Albedo, Camera, Material, Mesh, Object, Scene};

/// Makes the scene of a file's description.
pub(super) fn scene(
    description: &Description,
    path: &Path,
    limits: &LoadLimits,
    device: &Device,
) -> Result<Scene> {
    let mut builder = Builder {
        description,
        limits,
        device,
        images: HashMap::new(),
        materials: HashMap::new(),
        dropped: BTreeSet::new(),
    };
    let mut scene = Scene::new();
    for object in &description.objects {
        scene = scene.with(builder.object(object)?);
    }
    builder.lights(&description.lights);
    if !builder.dropped.is_empty() {
        let list: Vec<&str> = builder.dropped.into_iter().collect();
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

struct Builder<'a> {
    description: &'a Description,
    limits: &'a LoadLimits,
    device: &'a Device,
    /// Colours of images that were decoded, by their numbers.
    images: HashMap<usize, Tensor<3>>,
    /// Materials that were made, so that objects share textures and unused ones aren't read.
    materials: HashMap<Option<usize>, Material>,
    /// What would change the picture and is not rendered, told once.
    dropped: BTreeSet<&'static str>,
}

impl Builder<'_> {
    fn object(&mut self, object: &ObjectDescription) -> Result<Object> {
        let description = &self.description.meshes[object.mesh];
        let mesh = self.mesh(description, &object.to_world, &object.name);
        let mut built = Object::new(mesh).named(object.name.clone());
        let has_uvs = built.mesh.uvs.is_some();
        let materials = description.materials.iter().map(|&index| {
            let material = self.material(index)?;
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
    fn mesh(&mut self, from: &MeshDescription, to_world: &DAffine3, name: &str) -> Mesh {
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
        // TO CONNECT: `from.colours` as the mesh's vertex colours.
        if !from.colours.faces.is_empty() {
            self.dropped.insert("vertex colours");
        }
        mesh
    }

    fn material(&mut self, index: Option<usize>) -> Result<Material> {
        if let Some(built) = self.materials.get(&index) {
            return Ok(built.clone());
        }
        let description = index.and_then(|i| self.description.materials.get(i));
        let built = match description {
            Some(description) => self.make(description)?,
            None => Material::default().named("default"),
        };
        self.materials.insert(index, built.clone());
        Ok(built)
    }

    fn make(&mut self, from: &MaterialDescription) -> Result<Material> {
        let diffuse = self.colour(from.base_colour, from.base_colour_texture)?;
        let mut material = Material::diffuse(diffuse).named(from.name.clone());
        match &from.phong {
            Some(phong) => {
                let albedo = self.colour(phong.albedo, phong.texture)?;
                material = material.specular(albedo, phong.shininess);
            }
            // TO CONNECT: Material::dielectric by `ior`, Material::metallic_roughness by the rest, unless
            // metallic and specular are 0, which is Lambert's.
            None => {
                let textured = from.metallic_roughness_texture.is_some();
                if textured || from.metallic > 0.0 || from.specular > 0.0 {
                    self.dropped.insert("metal and roughness");
                }
                if from.transmission > 0.0 {
                    self.dropped.insert("transmission");
                }
            }
        }
        // TO CONNECT: normal maps, alpha masks, emissive textures.
        if from.normal.is_some() {
            self.dropped.insert("normal maps");
        }
        if from.alpha != Alpha::Opaque {
            self.dropped.insert("alpha");
        }
        material = material.emission(from.emission);
        if from.emission != [0.0; 3] {
            if from.emissive_texture.is_some() {
                self.dropped.insert("emissive textures");
            }
            if from.double_sided {
                self.dropped.insert("emission of back sides");
            }
        }
        Ok(material)
    }

    // TO CONNECT: point, spot and directional lights.
    fn lights(&mut self, lights: &[LightDescription]) {
        if !lights.is_empty() {
            self.dropped.insert("point, spot and directional lights");
        }
    }

    /// A colour times a texture in sRGB.
    fn colour(&mut self, factor: [f64; 3], texture: Option<TextureUse>) -> Result<Albedo> {
        let Some(TextureUse { image, wrap }) = texture else {
            return Ok(factor.into());
        };
        let mut texels = match self.images.get(&image) {
            Some(texels) => texels.clone(),
            None => {
                let texels = HostImage::of_colours(self.decode(image)?)?;
                let texels = texels.into_tensor(self.device);
                self.images.insert(image, texels.clone());
                texels
            }
        };
        if factor != [1.0; 3] {
            let factor = Tensor::<1>::from_data(TensorData::from(factor), self.device);
            texels = texels * factor.reshape([1, 1, 3]);
        }
        Ok(Albedo::Texture { texels, wrap })
    }

    fn decode(&self, image: usize) -> Result<Decoded> {
        match &self.description.images[image] {
            ImageSource::File(path) => {
                Decoded::read(BufReader::new(open(path)?.0), path, self.limits)
            }
            ImageSource::Bytes { name, bytes } => {
                Decoded::read(Cursor::new(bytes.slice()), name, self.limits)
            }
        }
    }
}

/// The matrix of normals for one of positions: its cofactors, which are its inverse's transpose times its
/// determinant, turned so that normals stay outside where it mirrors.
fn of_normals(m: DMat3) -> DMat3 {
    let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis];
    let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
    cofactors * m.determinant().signum()
}

/// A material without textures for an object that has no coordinates: their means.
fn untextured(mut material: Material, object: &str) -> Material {
    for albedo in [&mut material.diffuse, &mut material.specular] {
        if let Albedo::Texture { texels, .. } = albedo {
            log::warn!(
                "{object}: material {} has a texture, but the mesh has no coordinates: taking its mean",
                material.name
            );
            let mean: Tensor<1> = texels.clone().mean_dim(0).mean_dim(1).reshape([3]);
            *albedo = mean.into();
        }
    }
    material
}
