//! A scene as files describe it: numbers on the host and images that are not decoded yet, with all that
//! files say of surfaces. `build` makes a [`Scene`](crate::scene::Scene) of it.

use std::path::PathBuf;

use bytes::Bytes;
use glam::DAffine3;

use super::limits::Memory;
use super::notes::Notes;
use crate::scene::{Camera, Light, Wrap};

/// A scene.
#[derive(Default)]
pub(super) struct Description {
    pub meshes: Vec<MeshDescription>,
    pub objects: Vec<ObjectDescription>,
    pub materials: Vec<MaterialDescription>,
    pub images: Vec<ImageSource>,
    pub cameras: Vec<NamedCamera>,
    pub lights: Vec<Light>,
    /// What all that takes but for textures.
    pub memory: Memory,
    /// What is to be said about the file.
    pub notes: Notes,
}

/// A camera with its name, and width over height if the file says.
pub(super) type NamedCamera = (String, Camera, Option<f64>);

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
#[derive(Default)]
pub(super) struct Corners<const C: usize> {
    pub values: Vec<[f64; C]>,
    pub faces: Vec<[u32; 3]>,
}

impl<const C: usize> Corners<C> {
    /// Adds a row and returns its number.
    pub fn push(&mut self, row: [f64; C]) -> u32 {
        self.values.push(row);
        self.values.len() as u32 - 1
    }
}

/// A colour of a surface.
#[derive(Clone, Copy)]
pub(super) struct Colour {
    /// Linear RGB where there is no texture, or its image can't be read.
    pub plain: [f64; 3],
    /// A texture (sRGB), and the colour by which it is multiplied.
    pub texture: Option<(TextureUse, [f64; 3])>,
}

impl Colour {
    /// A colour that a texture is multiplied by, if there is one.
    pub fn times(factor: [f64; 3], texture: Option<TextureUse>) -> Self {
        Self {
            plain: factor,
            texture: texture.map(|texture| (texture, factor)),
        }
    }
}

/// A material of glTF's metallic–roughness model with its extensions.
pub(super) struct MaterialDescription {
    pub name: String,
    pub base_colour: Colour,
    pub alpha: Alpha,
    /// Times the blue channel of the texture (linear).
    pub metallic: f64,
    /// Times the green channel of the texture (linear).
    pub roughness: f64,
    pub metallic_roughness_texture: Option<TextureUse>,
    /// A normal map (linear) and the factor of its x and y.
    pub normal: Option<(TextureUse, f64)>,
    /// Radiance.
    pub emission: Colour,
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
    /// Phong's lobe beside Lambert's: its albedo and its exponent.
    Phong { albedo: Colour, shininess: f64 },
    /// A metal by the parts of its index of refraction, RGB.
    Conductor { eta: [f64; 3], extinction: [f64; 3] },
}

impl Default for MaterialDescription {
    fn default() -> Self {
        Self {
            name: "default".into(),
            base_colour: Colour::times([1.0; 3], None),
            alpha: Alpha::Opaque,
            metallic: 1.0,
            roughness: 1.0,
            metallic_roughness_texture: None,
            normal: None,
            emission: Colour::times([0.0; 3], None),
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
