//! A scene as files describe it: numbers on the host and images that are not decoded yet, with all that
//! glTF and PLY say of surfaces, lights and cameras. `build` makes a [`Scene`](crate::scene::Scene) of it.

use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

use burn::tensor::Device;
use glam::{DAffine3, DVec3};

use super::limits::Memory;
use crate::scene::{CornerAttribute, Wrap, host_tensor};

/// A scene.
#[derive(Default)]
pub(super) struct Description {
    pub meshes: Vec<MeshDescription>,
    pub objects: Vec<ObjectDescription>,
    pub materials: Vec<MaterialDescription>,
    pub images: Vec<ImageSource>,
    pub cameras: Vec<CameraDescription>,
    pub lights: Vec<LightDescription>,
    /// What all that takes but for textures.
    pub memory: Memory,
}

/// A mesh at a place. Several objects may share a mesh.
pub(super) struct ObjectDescription {
    pub name: String,
    /// Which of the meshes.
    pub mesh: usize,
    pub to_world: DAffine3,
}

/// A mesh with a material for each face.
#[derive(Default)]
pub(super) struct MeshDescription {
    pub positions: Vec<[f64; 3]>,
    pub faces: Vec<[u32; 3]>,
    /// (0, 0) at the lower left of an image.
    pub uvs: Corners<2>,
    pub normals: Corners<3>,
    /// Linear RGB, by which the base colour is multiplied.
    pub colours: Corners<3>,
    /// For normal maps, with the side of the bitangent: 1 or −1.
    pub tangents: Corners<4>,
    /// Which of the scene's materials are used; None is the default.
    pub materials: Vec<Option<usize>>,
    /// Which of `materials` each face has; empty where all faces have the first.
    pub face_materials: Vec<u32>,
}

/// Values of corners with their own index, as far as all faces have them.
pub(super) struct Corners<const C: usize> {
    pub values: Vec<[f64; C]>,
    pub faces: Vec<[u32; 3]>,
}

// Derived, it would ask for a default of `[f64; C]`.
impl<const C: usize> Default for Corners<C> {
    fn default() -> Self {
        Self {
            values: Vec::new(),
            faces: Vec::new(),
        }
    }
}

impl<const C: usize> Corners<C> {
    /// Adds a row and returns its number.
    pub fn push(&mut self, row: [f64; C]) -> u32 {
        self.values.push(row);
        self.values.len() as u32 - 1
    }

    /// The attribute, or None unless every face has it.
    pub fn attribute(&self, faces: usize, device: &Device) -> Option<CornerAttribute> {
        attribute(&self.values, &Arc::new(self.faces.clone()), faces, device)
    }
}

/// An attribute of a mesh with so many faces, or None unless every one has it.
pub(super) fn attribute<const C: usize>(
    values: &[[f64; C]],
    rows: &Arc<Vec<[u32; 3]>>,
    faces: usize,
    device: &Device,
) -> Option<CornerAttribute> {
    let is_whole = !rows.is_empty() && rows.len() == faces;
    is_whole.then(|| CornerAttribute {
        values: host_tensor(values, device),
        faces: rows.clone(),
    })
}

/// A material of glTF's metallic–roughness model with its extensions.
pub(super) struct MaterialDescription {
    pub name: String,
    /// Linear RGB, times the texture (sRGB).
    pub base_colour: [f64; 3],
    pub base_colour_texture: Option<TextureUse>,
    pub alpha: Alpha,
    /// Times the blue channel of the texture (linear).
    pub metallic: f64,
    /// Times the green channel of the texture (linear).
    pub roughness: f64,
    pub metallic_roughness_texture: Option<TextureUse>,
    /// A normal map (linear) and the factor of its x and y.
    pub normal: Option<(TextureUse, f64)>,
    /// Radiance, times the texture (sRGB).
    pub emission: [f64; 3],
    pub emissive_texture: Option<TextureUse>,
    pub ior: f64,
    /// The share of light that passes where it is not reflected.
    pub transmission: f64,
    /// Whether it is the boundary of a solid, which refracts, or a wall without thickness.
    pub solid: bool,
    /// The strength of the reflection of what is no metal: with 0 only the diffuse part is left.
    pub specular: f64,
    /// What this crate writes of a BSDF that glTF has no field for.
    pub own: Option<OwnBsdf>,
    /// Whether light that is lost between facets is given back.
    pub compensated: bool,
    /// Whether it is seen, and emits, on both sides.
    pub double_sided: bool,
}

/// A BSDF that glTF has no field for.
pub(super) enum OwnBsdf {
    /// Phong's lobe beside Lambert's: its albedo, times the texture (sRGB), and its exponent.
    Phong {
        albedo: [f64; 3],
        texture: Option<TextureUse>,
        shininess: f64,
    },
    /// A metal by the parts of its index of refraction, RGB.
    Conductor { eta: [f64; 3], extinction: [f64; 3] },
}

impl Default for MaterialDescription {
    fn default() -> Self {
        Self {
            name: "default".into(),
            base_colour: [1.0; 3],
            base_colour_texture: None,
            alpha: Alpha::Opaque,
            metallic: 1.0,
            roughness: 1.0,
            metallic_roughness_texture: None,
            normal: None,
            emission: [0.0; 3],
            emissive_texture: None,
            ior: 1.5,
            transmission: 0.0,
            solid: false,
            specular: 1.0,
            own: None,
            compensated: true,
            double_sided: false,
        }
    }
}

impl MaterialDescription {
    /// A white surface of Lambert's law.
    pub fn diffuse() -> Self {
        Self {
            metallic: 0.0,
            specular: 0.0,
            ..Self::default()
        }
    }
}

/// How much of a surface is there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Alpha {
    /// All of it.
    Opaque,
    /// Where the factor times the alpha of the base colour's texture is at least the cutoff.
    Mask { factor: f64, cutoff: f64 },
    /// The share that is the factor times the alpha of the base colour's texture.
    Blend { factor: f64 },
}

/// A texture of a material. All that a material uses are looked up at the same coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TextureUse {
    /// Which of the images.
    pub image: usize,
    pub wrap: Wrap,
}

/// An image that is decoded when it is first used.
pub(super) enum ImageSource {
    File(PathBuf),
    Bytes {
        /// What it is called in messages.
        name: PathBuf,
        bytes: Bytes,
    },
}

/// A part of a buffer.
#[derive(Clone)]
pub(super) struct Bytes {
    pub buffer: Arc<Vec<u8>>,
    pub range: Range<usize>,
}

impl From<Vec<u8>> for Bytes {
    fn from(bytes: Vec<u8>) -> Self {
        Self {
            range: 0..bytes.len(),
            buffer: Arc::new(bytes),
        }
    }
}

impl Bytes {
    pub fn slice(&self) -> &[u8] {
        self.buffer.get(self.range.clone()).unwrap_or(&[])
    }
}

/// A camera in world space.
pub(super) struct CameraDescription {
    pub name: String,
    pub eye: DVec3,
    /// Unit vectors.
    pub forward: DVec3,
    pub up: DVec3,
    pub projection: ProjectionDescription,
    /// Width over height, if the file says.
    pub aspect: Option<f64>,
}

pub(super) enum ProjectionDescription {
    /// Vertical field of view, degrees.
    Perspective { fov_y: f64 },
    /// Height of the image, scene units.
    Orthographic { height: f64 },
}

/// A light without extent, in world space. Photometric units count as those of the scene: candela for
/// radiant intensity, lux for irradiance.
pub(super) struct LightDescription {
    pub kind: LightKind,
    pub position: DVec3,
    /// Where it shines, a unit vector.
    pub direction: DVec3,
    /// Linear RGB: radiant intensity, of a directional light irradiance.
    pub intensity: [f64; 3],
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum LightKind {
    Point,
    /// Half-angles in radians, in which its light falls from all to nothing.
    Spot {
        inner: f64,
        outer: f64,
    },
    Directional,
}
