//! Reads PLY files, ASCII and binary, into descriptions (Turk, *The PLY Polygon File Format*, 1994).

mod header;
mod values;

use std::fmt::Display;
use std::path::Path;

use glam::{DAffine3, DVec3};

use super::description::{
    Color, Corners, Description, ImageSource, MaterialDescription, MeshDescription,
    ObjectDescription, TextureUse,
};
use super::files::Files;
use super::numbers::Kind;
use super::polygon::Polygons;
use super::srgb::srgb_to_linear;
use crate::error::{Error, Result};
use crate::scene::Wrap;
use header::{Element, Format, Header, Property};
use softray_kernels::warning;
use values::Values;

/// Reads a file. The description refers to the texture that the file names.
pub(super) fn read(path: &Path, files: Files) -> Result<Description> {
    let bytes = files.read_bytes(path)?;
    let header = Header::parse(&bytes).map_err(|m| Error::format(path, m))?;
    let mut reader = Reader {
        path,
        files,
        values: Values {
            format: header.format,
            rest: &bytes[header.end..],
            // If each row has its own line, values beyond those in the header are ignored, as in other readers.
            by_line: header.format == Format::Ascii && {
                let lines = bytes[header.end..].split(|&b| b == b'\n');
                let lines = lines.filter(|line| !line.trim_ascii().is_empty()).count();
                header.elements.iter().map(|e| e.count).sum::<u64>() == lines as u64
            },
        },
        mesh: MeshDescription::default(),
        uvs: Vec::new(),
        normals: Vec::new(),
        colors: Vec::new(),
    };
    for element in &header.elements {
        // Checked before anything is allocated for the element.
        let (least, left) = (element.least_bytes(header.format), reader.values.rest.len());
        // The last number of an ASCII file needs no space after it.
        if least > left as u128 + 1 {
            let message = format!(
                "it claims {} rows, at least {least} bytes, but {left} are left",
                element.count
            );
            return Err(reader.fail(format!("element {}", element.name), message));
        }
        match element.name.as_str() {
            "vertex" => reader.vertices(element)?,
            "face" => reader.faces(element)?,
            _ => reader.skip(element)?,
        }
    }
    reader.finish(&header)
}

struct Reader<'a> {
    path: &'a Path,
    files: Files<'a>,
    values: Values<'a>,
    mesh: MeshDescription,
    /// Attributes per vertex; empty if the file has none.
    uvs: Vec<[f64; 2]>,
    normals: Vec<[f64; 3]>,
    colors: Vec<[f64; 3]>,
}

impl Reader<'_> {
    fn fail(&self, place: impl Display, message: impl Display) -> Error {
        Error::format(self.path, format!("{place}: {message}"))
    }

    /// Reads the next row of an element. Property `i` goes to `scalars[i]` or, if it is a list, to `lists[i]`.
    fn row(&mut self, of: &Element, row: u64, found: &mut Row) -> Result<()> {
        for (i, Property { name, kind, list }) in of.properties.iter().enumerate() {
            let place = |m: String| {
                let place = format!("{} {row}, property {name}", of.name);
                Error::format(self.path, format!("{place}: {m}"))
            };
            let Some(count) = list else {
                found.scalars[i] = self.values.next(*kind).map_err(place)?;
                continue;
            };
            let length = self.values.length(*count, *kind).map_err(place)?;
            let list = &mut found.lists[i];
            list.clear();
            for _ in 0..length {
                list.push(self.values.next(*kind).map_err(place)?);
            }
        }
        self.values.end_row();
        Ok(())
    }

    fn skip(&mut self, element: &Element) -> Result<()> {
        if element.properties.is_empty() {
            return Ok(());
        }
        if element.name == "tristrips" {
            warning!("{}: its element tristrips is not read", self.path.display());
        }
        let mut row = Row::of(element);
        (0..element.count).try_for_each(|i| self.row(element, i, &mut row))
    }

    fn vertices(&mut self, element: &Element) -> Result<()> {
        let all = |names: [&[&str]; 3]| {
            let [a, b, c] = names.map(|n| element.scalar(n));
            Some([a?, b?, c?])
        };
        let Some(place) = all([&["x"], &["y"], &["z"]]) else {
            return Err(self.fail("element vertex", "it has no properties x, y and z"));
        };
        let normal = all([&["nx"], &["ny"], &["nz"]]);
        let color = all([
            &["red", "diffuse_red", "r"],
            &["green", "diffuse_green", "g"],
            &["blue", "diffuse_blue", "b"],
        ]);
        let u = element.scalar(&["s", "u", "texture_u", "texture_s"]);
        let v = element.scalar(&["t", "v", "texture_v", "texture_t"]);
        let mut row = Row::of(element);
        for i in 0..element.count {
            self.row(element, i, &mut row)?;
            let at = |i: usize| row.scalars[i];
            self.mesh.positions.push(place.map(at));
            if let Some(normal) = normal {
                self.normals.push(normal.map(at));
            }
            if let (Some(u), Some(v)) = (u, v) {
                self.uvs.push([at(u), at(v)]);
            }
            if let Some(color) = color {
                // Unsigned integers of 8 and 16 bits are sRGB, other numbers are linear.
                let linear = |i: usize| match element.properties[i].kind {
                    kind @ (Kind::U8 | Kind::U16) => {
                        f64::from(srgb_to_linear((at(i) / kind.one()) as f32))
                    }
                    _ => at(i),
                };
                self.colors.push(color.map(linear));
            }
        }
        Ok(())
    }

    fn faces(&mut self, element: &Element) -> Result<()> {
        let Some(corners) = element.list(&["vertex_indices", "vertex_index"]) else {
            return Err(self.fail("element face", "it has no list vertex_indices"));
        };
        // MeshLab writes texture coordinates per corner.
        let texcoord = element.list(&["texcoord"]);
        let count = self.mesh.positions.len();
        let mut row = Row::of(element);
        let mut polygons = Polygons::new(&self.files);
        for i in 0..element.count {
            self.row(element, i, &mut row)?;
            let place = || format!("face {i}");
            let list = &row.lists[corners];
            if list.len() < 3 {
                let message = format!("it has {} corners, expected at least 3", list.len());
                return Err(self.fail(place(), message));
            }
            let valid = |&&v: &&f64| v.fract() == 0.0 && v >= 0.0 && v < count as f64;
            if let Some(bad) = list.iter().find(|v| !valid(v)) {
                let message = format!("index {bad} is out of range, there are {count} vertices");
                return Err(self.fail(place(), message));
            }
            let face: Vec<u32> = list.iter().map(|&v| v as u32).collect();
            let triangles = (self.mesh.faces.len() + face.len() - 2) as u64;
            let allowed = self.files.check_triangles(triangles);
            allowed.map_err(|m| self.fail(place(), m))?;
            let positions = &self.mesh.positions;
            let places = face.iter().map(|&v| DVec3::from(positions[v as usize]));
            let triangles = polygons.triangles(&places.collect::<Vec<_>>());
            let triangles = triangles.map_err(|m| self.fail(place(), m))?;
            let first = self.mesh.uvs.values.len() as u32;
            if let Some(texcoord) = texcoord {
                let list = &row.lists[texcoord];
                if list.len() == 2 * face.len() {
                    let pairs = list.chunks_exact(2).map(|uv| [uv[0], uv[1]]);
                    self.mesh.uvs.values.extend(pairs);
                    let of = |t: &[usize; 3]| t.map(|c| first + c as u32);
                    self.mesh.uvs.faces.extend(triangles.iter().map(of));
                }
            }
            let of = |t: &[usize; 3]| t.map(|c| face[c]);
            self.mesh.faces.extend(triangles.iter().map(of));
        }
        Ok(())
    }

    fn finish(self, header: &Header) -> Result<Description> {
        let path = self.path;
        let mut mesh = self.mesh;
        if mesh.faces.is_empty() {
            let count = mesh.positions.len();
            let message = format!(
                "it has {count} vertices and no faces, expected at least one: points have no surface to \
                 render"
            );
            return Err(Error::format(path, message));
        }
        let faces = &mesh.faces;
        if mesh.uvs.faces.len() != faces.len() {
            mesh.uvs = of_vertices(self.uvs, faces);
        }
        mesh.normals = of_vertices(self.normals, faces);
        mesh.colors = of_vertices(self.colors, faces);
        let mut description = Description::default();
        mesh.materials = vec![None];
        if let [name, more @ ..] = header.textures.as_slice()
            && !mesh.uvs.faces.is_empty()
        {
            if !more.is_empty() {
                warning!("{}: of its textures only {name} is read", path.display());
            }
            description.images.push(ImageSource::File {
                named_by: path.display().to_string(),
                path: self.files.beside(path, name)?,
            });
            mesh.materials = vec![Some(0)];
            let texture = TextureUse {
                image: 0,
                wrap: Wrap::Repeat,
            };
            description.materials.push(MaterialDescription {
                name: name.clone(),
                base_color: Color::times([1.0; 3], Some(texture)),
                ..MaterialDescription::diffuse()
            });
        } else if !mesh.colors.faces.is_empty() {
            mesh.materials = vec![Some(0)];
            description.materials.push(MaterialDescription::diffuse());
        }
        description.meshes.push(mesh);
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        description.objects.push(ObjectDescription {
            name: stem.into_owned(),
            mesh: 0,
            to_world: DAffine3::IDENTITY,
        });
        Ok(description)
    }
}

/// The values of a row.
struct Row {
    scalars: Vec<f64>,
    lists: Vec<Vec<f64>>,
}

impl Row {
    fn of(element: &Element) -> Self {
        let count = element.properties.len();
        Self {
            scalars: vec![0.0; count],
            lists: vec![Vec::new(); count],
        }
    }
}

/// Converts values of vertices to values of face corners. Without values, the result is empty.
fn of_vertices<const C: usize>(values: Vec<[f64; C]>, faces: &[[u32; 3]]) -> Corners<C> {
    let faces = match values.is_empty() {
        true => Vec::new(),
        false => faces.to_vec(),
    };
    Corners { values, faces }
}
