//! Meshes and scenes as files, by their endings.

use std::path::Path;

use super::{gltf_write, obj_write, ply_write, whole::ending};
use crate::error::{Error, Result};
use crate::scene::{Material, Mesh, Scene, check_scene};
use softray_kernels::host::BsdfKind;
use softray_kernels::warning;

/// The endings of files that are written.
const WRITTEN: [&str; 4] = ["obj", "gltf", "glb", "ply"];

impl Mesh {
    /// Writes a file with vertices, texture coordinates, normals and, but for OBJ, colors. The file appears under its name only when it
    /// is complete.
    ///
    /// - `.obj`: numbers read back to the same floats. [`Scene::load`] numbers vertices in the order in which faces
    ///   have them, and leaves out those that no face has.
    /// - `.ply`: binary; the same floats, and vertices keep their numbers. Those at a seam of an attribute are split:
    ///   the copies come after all others.
    /// - `.glb`, `.gltf` (with a `.bin` beside it): as [`Scene::write`], of the material
    ///   [`Material::default`](crate::scene::Material::default).
    ///
    /// # Errors
    /// When the ending is another one, the mesh has no face or can't be rendered, or the system fails.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        let kind = ending(path, &WRITTEN)?;
        self.check("mesh")?;
        if self.faces.is_empty() {
            return Err(Error::invalid("mesh", "faces", "empty", "at least one"));
        }
        match kind {
            "obj" => {
                warn_of_colors(self, "the mesh", path);
                obj_write::mesh(self, path)
            }
            "ply" => ply_write::mesh(self, path),
            _ => gltf_write::mesh(self, path),
        }
    }
}

impl Scene {
    /// Writes a file that [`Scene::load`] reads as a scene that renders to the same image.
    ///
    /// - `.obj`, with an MTL file and textures as images beside it: `room.obj`, `room.mtl`,
    ///   `room_wood_diffuse.png`, where `wood` is a material. Numbers read back to the same floats. Every object is
    ///   an `o`; names that are taken get a number. A texture is a PNG file where 8 bits of sRGB hold all of its texels
    ///   exactly, as those of one that was read from such a file, and an EXR file otherwise. Textures that clamp have
    ///   `-clamp on`; `Wrap::Mirror` is written as repetition.
    /// - `.glb`, or `.gltf` with a `.bin` beside it: every object is a node with a mesh in f32, every light one of
    ///   KHR_lights_punctual. Metal and roughness are glTF's own, a dielectric is KHR_materials_transmission with ior
    ///   and volume, Lambert's law KHR_materials_specular with a factor of 0, and emission above 1
    ///   KHR_materials_emissive_strength. Phong's lobe and a conductor's index of refraction stand in `extras` (for
    ///   other readers there are about the same roughness and color). Textures are PNG images within the file, of
    ///   16 bits where 8 bits don't hold their texels, clipped to [0, 1]; those that glTF has in one image (metal
    ///   with roughness, colors with alpha) are interpolated to one size.
    /// - `.ply`: all objects as one mesh; constant albedos, times the colors of meshes, become colors of vertices.
    ///
    /// Parts that a format can't hold are left out with a warning: the environment, objects without faces, and
    /// velocities: an object that moves is written as it is at the shutter's start. Files of those names are replaced,
    /// once all new ones are complete.
    ///
    /// ```no_run
    /// # use softray::prelude::*;
    /// # let device = Device::flex();
    /// let scene = Scene::new().with_object(Object::new(shapes::cube(&device)).with_name("cube"));
    /// scene.write("cube.glb")?;
    /// let same = Scene::load("cube.glb", &device)?;
    /// # Ok::<(), softray::Error>(())
    /// ```
    ///
    /// # Errors
    /// When the ending is another one, the scene is not valid, or the system fails.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        let kind = ending(path, &WRITTEN)?;
        check_scene(self)?;
        self.warn_of_losses(path)?;
        if matches!(kind, "obj" | "ply") {
            self.warn_of_old_formats(path);
        }
        match kind {
            "obj" => {
                self.objects
                    .iter()
                    .for_each(|o| warn_of_colors(&o.mesh, &o.name, path));
                obj_write::scene(self, path)
            }
            "ply" => ply_write::scene(self, path),
            _ => gltf_write::scene(self, path),
        }
    }

    /// Tells by name what only glTF can hold.
    fn warn_of_old_formats(&self, path: &Path) {
        let file = path.display();
        if !self.lights.is_empty() {
            warning!("{file}: lights without a surface are not written, only glTF has them");
        }
        let lost = |m: &Material| {
            [
                (
                    "the BSDF, but for its diffuse color",
                    m.bsdf.kind() != BsdfKind::Phong,
                ),
                ("the normal map", m.normal_map.is_some()),
                ("the alpha mask", m.alpha_mask.is_some()),
            ]
        };
        for object in &self.objects {
            for material in &object.materials {
                let lost = lost(material).into_iter().filter(|(_, is)| *is);
                let lost: Vec<&str> = lost.map(|(part, _)| part).collect();
                if !lost.is_empty() {
                    let (name, material, lost) = (&object.name, &material.name, lost.join(", "));
                    warning!(
                        "{file}: {name}, material {material} is written without what only glTF has: {lost}"
                    );
                }
            }
        }
    }

    /// Tells by name what none of the formats can hold.
    fn warn_of_losses(&self, path: &Path) -> Result<()> {
        let file = path.display();
        if self.environment.shines() {
            warning!("{file}: the scene's environment is not written, such files have none");
        }
        for object in &self.objects {
            let name = &object.name;
            if object.mesh.faces.is_empty() {
                warning!("{file}: {name} has no faces and is not written");
            }
            if let Some(velocity) = &object.velocity {
                let velocity = velocity.values()?;
                if velocity != [0.0; 3] {
                    warning!(
                        "{file}: the velocity {velocity:?} of {name} is not written, such files have no \
                         motion; the object is where it is at the shutter's start"
                    );
                }
            }
        }
        Ok(())
    }
}

/// Tells what OBJ can't hold of a mesh.
fn warn_of_colors(mesh: &Mesh, name: &str, path: &Path) {
    if mesh.colors.is_some() {
        let file = path.display();
        warning!("{file}: the colors of {name} are not written to OBJ");
    }
}
