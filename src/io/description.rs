//! The description of a scene in a file: numbers on the host, images that are not decoded yet, and all surface
//! properties of the file. `build` converts it to a [`Scene`](crate::scene::Scene).

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
    /// The memory that the scene takes without textures.
    pub memory: Memory,
    /// Warnings about the file.
    pub notes: Notes,
}

/// A camera with its name, and its aspect ratio (width over height) if the file has one.
pub(super) type NamedCamera = (String, Camera, Option<f64>);

/// A mesh with a transform. Several objects may share a mesh.
pub(super) struct ObjectDescription {
    pub name: String,
    /// The index of the mesh.
    pub mesh: usize,
    pub to_world: DAffine3,
}

/// A mesh with a material for each face.
#[derive(Default)]
pub(super) struct MeshDescription {
    pub positions: Vec<[f64; 3]>,
    pub faces: Vec<[u32; 3]>,
    /// Texture coordinates, (0, 0) at the lower left of an image.
    pub uvs: Corners<2>,
    pub normals: Corners<3>,
    /// Linear RGB, which multiplies the base color.
    pub colors: Corners<3>,
    /// Tangents for normal maps. The fourth number is the side of the bitangent, 1 or −1.
    pub tangents: Corners<4>,
    /// Indices of the scene's materials that are used. `None` is the default material.
    pub materials: Vec<Option<usize>>,
    /// The index of each face's material in `materials`. Empty if all faces have the first.
    pub face_materials: Vec<u32>,
}

/// Values at face corners with their own indices. They are used only if all faces have them.
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

/// The color of a surface.
#[derive(Clone, Copy)]
pub(super) struct Color {
    /// Linear RGB, used if there is no texture or its image cannot be read.
    pub plain: [f64; 3],
    /// A texture (sRGB), and the linear color that multiplies it.
    pub texture: Option<(TextureUse, [f64; 3])>,
}

impl Color {
    /// Returns a color that multiplies a texture, if there is one.
    pub fn times(factor: [f64; 3], texture: Option<TextureUse>) -> Self {
        Self {
            plain: factor,
            texture: texture.map(|texture| (texture, factor)),
        }
    }
}

/// A material of glTF's metallic-roughness model with its extensions.
pub(super) struct MaterialDescription {
    pub name: String,
    pub base_color: Color,
    pub alpha: Alpha,
    /// Multiplies the blue channel of the texture (linear).
    pub metallic: f64,
    /// Multiplies the green channel of the texture (linear).
    pub roughness: f64,
    pub metallic_roughness_texture: Option<TextureUse>,
    /// A normal map (linear) and a factor for its x and y.
    pub normal: Option<(TextureUse, f64)>,
    /// Radiance.
    pub emission: Color,
    pub ior: f64,
    /// The share of the light that is not reflected which is transmitted.
    pub transmission: f64,
    /// Whether the surface bounds a solid, which refracts. Otherwise it is a wall without thickness.
    pub solid: bool,
    /// The strength of the reflection of non-metals. At 0, only the diffuse part is left.
    pub specular: f64,
    /// A BSDF that this crate writes and that glTF has no field for.
    pub extra_bsdf: Option<ExtraBsdf>,
    /// Whether multiple-scattering compensation is enabled.
    pub compensated: bool,
    /// Whether the surface is visible, and emits, on both sides.
    pub double_sided: bool,
}

/// A BSDF that glTF has no field for.
pub(super) enum ExtraBsdf {
    /// A Phong lobe in addition to the diffuse one: its albedo and exponent.
    Phong { albedo: Color, shininess: f64 },
    /// A metal, by the real and imaginary part of its index of refraction, RGB.
    Conductor { eta: [f64; 3], extinction: [f64; 3] },
}

impl Default for MaterialDescription {
    fn default() -> Self {
        Self {
            name: "default".into(),
            base_color: Color::times([1.0; 3], None),
            alpha: Alpha::Opaque,
            metallic: 1.0,
            roughness: 1.0,
            metallic_roughness_texture: None,
            normal: None,
            emission: Color::times([0.0; 3], None),
            ior: 1.5,
            transmission: 0.0,
            solid: false,
            specular: 1.0,
            extra_bsdf: None,
            compensated: true,
            double_sided: false,
        }
    }
}

impl MaterialDescription {
    /// Returns a white diffuse (Lambertian) material.
    pub fn diffuse() -> Self {
        Self {
            metallic: 0.0,
            specular: 0.0,
            ..Self::default()
        }
    }
}

/// The opacity of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Alpha {
    /// Opaque everywhere.
    Opaque,
    /// Opaque where the factor times the alpha of the base color's texture is at least the cutoff.
    Mask { factor: f64, cutoff: f64 },
    /// The opacity is the factor times the alpha of the base color's texture.
    Blend { factor: f64 },
}

/// A texture of a material. All textures of a material use the same coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TextureUse {
    /// The index of the image.
    pub image: usize,
    pub wrap: Wrap,
}

/// An image that is decoded at its first use.
pub(super) enum ImageSource {
    File {
        path: PathBuf,
        /// The place in a file that names it, for messages.
        named_by: String,
    },
    Bytes {
        /// The name of the image in messages.
        name: PathBuf,
        bytes: Bytes,
    },
}
