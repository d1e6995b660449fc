//! Writes meshes and scenes as OBJ files.

use std::io::Write;
use std::path::Path;

use burn::tensor::Tensor;

use super::mtl_write::{Library, Names, in_line, number};
use super::whole::{Part, write_whole};
use crate::error::{Error, Result};
use crate::geometry::host_values;
use crate::scene::{CornerAttribute, Mesh, Scene};
use softray_kernels::warning;

/// Writes a mesh.
pub(super) fn mesh(mesh: &Mesh, path: &Path) -> Result<()> {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    write_whole(path, |file| {
        let mut obj = ObjFile::new(file, path);
        obj.line(format_args!("# softray"))?;
        obj.object(&in_line(&stem, "mesh"), mesh, &[], &[])
    })
}

/// Writes a scene, with an MTL file and the textures as images beside it.
pub(super) fn scene(scene: &Scene, path: &Path) -> Result<()> {
    let (mut names, mut library) = (Names::default(), Library::new(path));
    let mut objects = Vec::with_capacity(scene.objects.len());
    for object in scene.objects.iter().filter(|o| !o.mesh.faces.is_empty()) {
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
        warning!("objects of {}: {}", path.display(), names.message());
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

/// An OBJ file that is being written.
struct ObjFile<'a, W> {
    file: &'a mut W,
    path: &'a Path,
    /// The numbers of `v`, `vt` and `vn` rows so far.
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

    /// Writes a mesh as one object. `materials` are names, if there are any. `face_materials` are indices of these
    /// per face.
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
                // OBJ indices start at 1.
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

    /// Writes each row of a table after a keyword. `None` writes nothing.
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
