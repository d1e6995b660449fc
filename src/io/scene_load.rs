//! Scenes from files of all formats.

use std::path::{Path, PathBuf};

use burn::tensor::Device;

use super::files::{Files, MemoryFiles};
use super::load::load;
use super::scene_file::is_json;
use super::{LoadLimits, SceneFile};
use crate::error::Result;
use crate::scene::Scene;

impl Scene {
    /// Reads a scene from a file. The extension selects the format.
    ///
    /// - `.obj`, with its MTL files. Every `o` or `g` becomes an [`Object`](crate::scene::Object) with a material per
    ///   face. Pieces with the same name form one object. Vertices that faces share in the file stay shared. If a
    ///   vertex has a fourth number w, its x, y and z are divided by w. Vertex colors (`v x y z r g b`) are sRGB, and
    ///   bytes if any color value of the file is above 1. Vertices without a color are white. An object has normals
    ///   or
    ///   texture coordinates only if they are given at every corner.
    ///
    ///   Materials use `Kd`, `Ks`, `Ns`, `Ke` (radiance of the front side), `illum`, `map_Kd`, `map_Ks` (times `Ks`),
    ///   `map_Ke` (times `Ke`), and the texture option `-clamp on`. On objects with texture coordinates, `map_Kd`
    ///   replaces `Kd`. `Ks` is 0 if `Ns` is 0 or `illum` is 0 or 1. Without `illum`, `Ks` is used; without `Ns`, the
    ///   exponent is 1. If `Kd` + `Ks` is above 1 (with textures: at any texel), `Ks` is scaled down. Surfaces
    ///   without `Kd` or material are mid-gray like [`Material::default`](crate::scene::Material::default), or white
    ///   if the file has vertex colors. Missing or malformed materials and textures are left out, unless limits are
    ///   [strict](LoadLimits::with_strict).
    /// - `.gltf`, `.glb`: every node with a mesh becomes an object in world space, with a material per face. Every
    ///   node with a light (KHR_lights_punctual) becomes a light; candela and lux count as radiant intensity and
    ///   irradiance. glTF splits vertices at seams of normals or texture coordinates; vertices at the same position
    ///   are joined again. Buffers and images may be in the file or beside it.
    /// - `.ply`: one object, named like the file, with vertex colors and the texture of a `TextureFile` comment.
    /// - `.json`: see [`SceneFile`].
    ///
    /// Polygons become triangle fans if these fill them; other polygons are split by ear clipping. Colors are sRGB in
    /// images (except EXR and HDR), in unsigned 8- and 16-bit values of PLY, and at OBJ vertices, and linear
    /// elsewhere.
    /// A warning per file lists content that would change the picture and is not rendered.
    ///
    /// # Errors
    /// If a file is missing, malformed, too large, or outside the scene's folder ([`LoadLimits`]), or if there is no
    /// face. The message contains the place of the error in the file.
    pub fn load(path: impl AsRef<Path>, device: &Device) -> Result<Self> {
        Self::load_within(path, device, &LoadLimits::default())
    }

    /// Reads a scene like [`Scene::load`], with the given limits.
    ///
    /// # Errors
    /// As [`Scene::load`].
    pub fn load_within(
        path: impl AsRef<Path>,
        device: &Device,
        limits: &LoadLimits,
    ) -> Result<Self> {
        Self::load_from(path.as_ref(), device, Files::of_system(limits))
    }

    /// Reads a scene like [`Scene::load_within`] from files in memory: those of an archive, a network or a web page.
    ///
    /// `path` is the name of the file that holds the scene. All files that it refers to are among `files`, with their
    /// names from the same folder on; other files are not read. [`SceneFile::from_bytes`] also returns the camera.
    ///
    /// ```
    /// use softray::prelude::*;
    /// let obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n";
    /// let files = [("a.obj", obj), ("a.mtl", "newmtl red\nKd 0.8 0.1 0.1\n")];
    /// let scene = Scene::from_bytes("a.obj", files, &Device::flex(), &LoadLimits::default())?;
    /// assert_eq!(scene.objects.len(), 1);
    /// # Ok::<(), softray::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Scene::load`], and if two files have the same name.
    pub fn from_bytes<N: Into<PathBuf>, B: Into<Vec<u8>>>(
        path: impl AsRef<Path>,
        files: impl IntoIterator<Item = (N, B)>,
        device: &Device,
        limits: &LoadLimits,
    ) -> Result<Self> {
        let files = MemoryFiles::new(files)?;
        Self::load_from(path.as_ref(), device, Files::in_memory(&files, limits))
    }

    fn load_from(path: &Path, device: &Device, files: Files) -> Result<Self> {
        match is_json(path)? {
            true => Ok(SceneFile::from_json(path, device, files)?.scene),
            false => Ok(load(path, device, files)?.0),
        }
    }
}
