//! Meshes and scenes as OBJ files.

use std::io::Write;
use std::path::Path;

use burn::tensor::Tensor;

use super::mtl_write::{Library, Names, in_line, number};
use super::whole::{Part, ending, write_whole};
use crate::error::{Error, Result};
use crate::geometry::host_values;
use crate::scene::{CornerAttribute, Mesh, Scene, check_scene};

impl Mesh {
    /// Writes an OBJ file with vertices, texture coordinates and normals, as numbers that read back to
    /// the same floats. The file appears under its name only when it is complete.
    ///
    /// [`Scene::from_obj`] numbers vertices in the order in which faces have them, and leaves out
    /// those that no face has.
    ///
    /// # Errors
    /// When the ending is not `.obj`, the mesh has no face or can't be rendered, or the system fails.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        ending(path, &["obj"])?;
        self.check("mesh")?;
        if self.faces.is_empty() {
            return Err(Error::invalid("mesh", "faces", "empty", "at least one"));
        }
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        write_whole(path, |file| {
            let mut obj = ObjFile::new(file, path);
            obj.line(format_args!("# softray"))?;
            obj.object(&in_line(&stem, "mesh"), self, &[], &[])
        })
    }
}

impl Scene {
    /// Writes an OBJ file, an MTL file beside it, and the textures as images beside them:
    /// `room.obj`, `room.mtl`, `room_wood_diffuse.png`, where `wood` is a material.
    /// [`Scene::from_obj`] reads a scene that renders to the same image.
    ///
    /// - Numbers read back to the same floats. Every object is an `o`; names that are taken
    ///   get a number.
    /// - A texture is a PNG file where 8 bits of sRGB hold all of its texels exactly, as those of one
    ///   that was read from such a file, and an EXR file otherwise. Textures that clamp have
    ///   `-clamp on`.
    /// - An object that moves is written as it is at the shutter's start.
    ///
    /// Parts that OBJ and MTL can't hold are left out with a warning: the environment, velocities,
    /// mirrored textures, objects without faces. Files of those names are replaced, once all new ones
    /// are complete.
    ///
    /// ```no_run
    /// # use softray::prelude::*;
    /// # let device = Device::flex();
    /// let scene = Scene::new().with(Object::new(shapes::cube(&device)).named("cube"));
    /// scene.write("cube.obj")?;
    /// let same = Scene::from_obj("cube.obj", &device)?;
    /// # Ok::<(), softray::Error>(())
    /// ```
    ///
    /// # Errors
    /// When the ending is not `.obj`, the scene is not valid, or the system fails.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        ending(path, &["obj"])?;
        check_scene(self)?;
        self.warn_of_losses(path)?;
        let (mut names, mut library) = (Names::default(), Library::new(path));
        let mut objects = Vec::with_capacity(self.objects.len());
        for object in self.objects.iter().filter(|o| !o.mesh.faces.is_empty()) {
            let materials = object.materials.iter();
            let materials = materials.map(|m| library.name_of(m, &object.name));
            let materials = materials.collect::<Result<Vec<String>>>()?;
            objects.push((
                object,
                names.unique(in_line(&object.name, "object")),
                materials,
            ));
        }
        if !names.renamed.is_empty() {
            log::warn!("objects of {}: {}", path.display(), names.told());
        }
        let materials = library.file_name();
        let mut parts = library.write()?;
        parts.push(Part::write(path, |file| {
            let mut obj = ObjFile::new(file, path);
            obj.line(format_args!("# softray\nmtllib {materials}"))?;
            objects.iter().try_for_each(|(object, name, materials)| {
                obj.object(name, &object.mesh, materials, &object.face_materials)
            })
        })?);
        parts.into_iter().try_for_each(Part::publish)
    }

    /// Tells by name what an OBJ file can't hold.
    fn warn_of_losses(&self, path: &Path) -> Result<()> {
        let file = path.display();
        if self.environment.shines() {
            log::warn!("{file}: the scene's environment is not written, OBJ has none");
        }
        for object in &self.objects {
            let name = &object.name;
            if object.mesh.faces.is_empty() {
                log::warn!("{file}: {name} has no faces and is not written");
            }
            if let Some(velocity) = &object.velocity {
                let velocity = velocity.values()?;
                if velocity != [0.0; 3] {
                    log::warn!(
                        "{file}: the velocity {velocity:?} of {name} is not written, OBJ has no \
                         motion; the object is where it is at the shutter's start"
                    );
                }
            }
        }
        Ok(())
    }
}

/// An OBJ file that is being written.
struct ObjFile<'a, W> {
    file: &'a mut W,
    path: &'a Path,
    /// Rows of `v`, `vt` and `vn` so far.
    rows: [usize; 3],
}

impl<'a, W: Write> ObjFile<'a, W> {
    fn new(file: &'a mut W, path: &'a Path) -> Self {
        Self {
            file,
            path,
            rows: [0; 3],
        }
    }

    fn line(&mut self, line: std::fmt::Arguments) -> Result<()> {
        writeln!(self.file, "{line}").map_err(Error::io(self.path))
    }

    /// Writes a mesh with the names of its materials, if it has any, and those of its faces.
    fn object(
        &mut self,
        name: &str,
        mesh: &Mesh,
        materials: &[String],
        face_materials: &[u32],
    ) -> Result<()> {
        self.line(format_args!("o {name}"))?;
        let before = self.rows;
        self.table(0, "v", Some(&mesh.vertices))?;
        self.table(1, "vt", mesh.uvs.as_ref().map(|a| &a.values))?;
        self.table(2, "vn", mesh.normals.as_ref().map(|a| &a.values))?;
        let (uvs, normals) = (mesh.uvs.as_ref(), mesh.normals.as_ref());
        let mut current = None;
        for (i, face) in mesh.faces.iter().enumerate() {
            let material = materials.get(face_materials.get(i).map_or(0, |&m| m as usize));
            if let Some(name) = material.filter(|_| material != current) {
                self.line(format_args!("usemtl {name}"))?;
                current = material;
            }
            let corner = |c: usize| {
                // Files count from 1.
                let row = |kind: usize, index: u32| before[kind] + index as usize + 1;
                let of = |kind: usize, attribute: Option<&CornerAttribute>| {
                    attribute.map(|a| row(kind, a.faces[i][c]))
                };
                let v = row(0, face[c]);
                match (of(1, uvs), of(2, normals)) {
                    (None, None) => format!("{v}"),
                    (Some(vt), None) => format!("{v}/{vt}"),
                    (None, Some(vn)) => format!("{v}//{vn}"),
                    (Some(vt), Some(vn)) => format!("{v}/{vt}/{vn}"),
                }
            };
            self.line(format_args!("f {} {} {}", corner(0), corner(1), corner(2)))?;
        }
        Ok(())
    }

    /// Writes a table, if there is one.
    fn table(&mut self, kind: usize, keyword: &str, table: Option<&Tensor<2>>) -> Result<()> {
        let Some(table) = table else {
            return Ok(());
        };
        let [rows, columns] = table.dims();
        let dtype = Some(table.dtype());
        for row in host_values(table)?.chunks_exact(columns) {
            let row: Vec<String> = row.iter().map(|&v| number(v, dtype)).collect();
            self.line(format_args!("{keyword} {}", row.join(" ")))?;
        }
        self.rows[kind] += rows;
        Ok(())
    }
}
