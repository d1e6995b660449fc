//! Reads OBJ files into descriptions. tobj parses the numbers and faces.
//!
//! tobj starts a new mesh at every object and material, and meshes do not share vertices. Therefore it gets only the
//! rows and faces, each on its own line. This module keeps the object and material of each face.

mod meshes;
mod mtl;

use std::collections::{HashMap, HashSet};
use std::path::Path;

use glam::DAffine3;

use super::description::{Description, ObjectDescription};
use super::files::Files;
use super::limits::Memory;
use super::notes::Notes;
use crate::error::{Error, Result};
use mtl::{Library, keyword, words};

/// The name of the object before any `o` or `g`.
const UNNAMED: &str = "unnamed_object";

/// Approximate bytes that a render takes for an object with one of its materials: three copies of their tensors'
/// handles.
const PART: u64 = 3 << 12;

/// Reads a file with its MTL files; see [`Scene::load`](crate::scene::Scene::load).
pub(super) fn read(path: &Path, files: Files) -> Result<Description> {
    let (text, notes) = (files.read_text(path)?, Notes::default());
    let mut reader = Reader::new(path, &text, files, &notes);
    let mut continued = String::new();
    // The empty line ends a last line that is continued.
    for (i, line) in text.lines().chain([""]).enumerate() {
        let begun = line.trim_end().strip_suffix('\\');
        match begun.filter(|_| !line.starts_with('#')) {
            Some(begun) => continued = continued + begun + " ",
            None if continued.is_empty() => reader.statement(i + 1, line)?,
            None => reader.statement(i + 1, &(std::mem::take(&mut continued) + line))?,
        }
        // Lines that tobj does not get become empty, so that line numbers stay the same.
        reader.text.push('\n');
    }
    if reader.faces.is_empty() {
        return Err(Error::NoTriangles {
            path: Some(path.into()),
            objects: 0,
        });
    }
    drop(text);
    let all = reader.parse()?;
    // The texts take most of the memory of a large file.
    reader.text = String::new();
    let mut meshes = reader.meshes(&all)?;
    drop(all);
    let Reader {
        objects,
        materials,
        mut library,
        mut memory,
        colored,
        ..
    } = reader;
    let plain = if colored { [1.0; 3] } else { [0.5; 3] };
    for mesh in &mut meshes {
        let textured = mesh.uvs.faces.len() == mesh.faces.len();
        for material in mesh.materials.iter_mut().flatten() {
            *material = library.describe(&materials.names[*material], textured, plain)?;
        }
    }
    memory.read += library.bytes;
    let object = |(mesh, name): (usize, String)| ObjectDescription {
        name,
        mesh,
        to_world: DAffine3::IDENTITY,
    };
    Ok(Description {
        objects: objects.names.into_iter().enumerate().map(object).collect(),
        meshes,
        materials: library.described,
        images: library.images,
        memory,
        notes,
        ..Description::default()
    })
}

/// Names without duplicates.
#[derive(Default)]
struct Names {
    names: Vec<String>,
    numbers: HashMap<String, u32>,
}

impl Names {
    fn number(&mut self, name: &str) -> u32 {
        if let Some(&number) = self.numbers.get(name) {
            return number;
        }
        let next = self.names.len() as u32;
        self.names.push(name.into());
        self.numbers.insert(name.into(), next);
        next
    }
}

/// Properties of a face that tobj does not keep.
struct Face {
    line: usize,
    object: u32,
    material: u32,
    /// Whether all corners have texture coordinates, and whether all have normals.
    uvs: bool,
    normals: bool,
}

/// The content read so far.
struct Reader<'a> {
    path: &'a Path,
    files: Files<'a>,
    notes: &'a Notes,
    library: Library<'a>,
    /// The text for tobj.
    text: String,
    /// The numbers of `v`, `vt` and `vn` rows so far and in the whole file. Faces may refer to later rows.
    counts: [u64; 3],
    totals: [u64; 3],
    /// Whether any vertex has a color.
    colored: bool,
    triangles: u64,
    faces: Vec<Face>,
    /// Names of objects and materials with faces. Faces without a material have the empty name.
    objects: Names,
    materials: Names,
    /// The current object and material, and their numbers once a face has used them.
    object: String,
    material: String,
    part: Option<(u32, u32)>,
    /// Pairs of object and material, and the memory that they take.
    parts: HashSet<(u32, u32)>,
    memory: Memory,
}

impl<'a> Reader<'a> {
    fn new(path: &'a Path, text: &str, files: Files<'a>, notes: &'a Notes) -> Self {
        let (mut totals, mut colored) = ([0; 3], false);
        for line in text.lines() {
            let (keyword, rest) = keyword(line);
            if let Some(kind) = ["v", "vt", "vn"].iter().position(|k| *k == keyword) {
                totals[kind] += 1;
                colored |= kind == 0 && words(rest).len() >= 6;
            }
        }
        let folder = path.parent().unwrap_or(Path::new(""));
        Self {
            path,
            files,
            notes,
            library: Library::new(folder, files, notes),
            text: String::new(),
            counts: [0; 3],
            totals,
            colored,
            triangles: 0,
            faces: Vec::new(),
            objects: Names::default(),
            materials: Names::default(),
            object: UNNAMED.into(),
            material: String::new(),
            part: None,
            parts: HashSet::new(),
            memory: Memory {
                taken: 0,
                read: text.len() as u64,
            },
        }
    }

    fn fail(&self, line: usize, message: impl std::fmt::Display) -> Error {
        Error::format(self.path, format!("line {line}: {message}"))
    }

    /// Reads a line, joined with its continuation lines.
    fn statement(&mut self, line: usize, text: &str) -> Result<()> {
        let (keyword, rest) = keyword(text);
        let words = words(rest);
        match keyword {
            "v" => {
                self.text += &self.vertex(&words);
                self.counts[0] += 1;
            }
            "vt" => {
                let [u, v] = [0, 1].map(|i| words.get(i).copied());
                self.text += &format!("vt {} {}", u.unwrap_or(""), v.unwrap_or("0"));
                self.counts[1] += 1;
            }
            "vn" => {
                self.text += &format!("vn {}", words.join(" "));
                self.counts[2] += 1;
            }
            "f" => self.face(line, &words)?,
            "o" | "g" => {
                self.object = if rest.is_empty() { UNNAMED } else { rest }.into();
                self.part = None;
            }
            "usemtl" => {
                self.material = rest.into();
                self.part = None;
            }
            "mtllib" => {
                let from = format!("{}, line {line}", self.path.display());
                self.library.add(rest, &from)?;
            }
            _ => {}
        }
        Ok(())
    }

    /// Returns the line of a vertex for tobj. tobj requires a color for all vertices or for none, so a missing color
    /// becomes NaN. Words that do not parse stay, and tobj rejects them.
    fn vertex(&self, words: &[&str]) -> String {
        let numbers: Vec<f64> = words.iter().map_while(|v| v.parse().ok()).collect();
        // A fourth word is w. Of five or more words without a color, those after the third are ignored.
        let place = if words.len() > 4 { &words[..3] } else { words };
        let place = format!("v {}", place.join(" "));
        match numbers[..] {
            _ if !self.colored => place,
            [_, _, _, _, _, _, ..] => format!("v {}", words[..6].join(" ")),
            [x, y, z, w] if w != 0.0 => format!("v {} {} {} nan nan nan", x / w, y / w, z / w),
            _ if matches!(words.len(), 0..=2 | 4) => place,
            _ => place + " nan nan nan",
        }
    }

    fn face(&mut self, line: usize, words: &[&str]) -> Result<()> {
        if words.len() < 3 {
            let message = format!("f has {} corners, expected at least 3", words.len());
            return self.notes.fault(self.fail(line, message), &self.files);
        }
        self.triangles += words.len() as u64 - 2;
        let allowed = self.files.check_triangles(self.triangles);
        allowed.map_err(|m| self.fail(line, m))?;
        let (object, material) = match self.part {
            Some(part) => part,
            None => self.begin_part().map_err(|m| self.fail(line, m))?,
        };
        let mut face = Face {
            line,
            object,
            material,
            uvs: true,
            normals: true,
        };
        let mut fault = None;
        self.text.push('f');
        for word in words {
            let corner = self.corner(word, &mut fault);
            let [v, vt, vn] = corner.map_err(|m| self.fail(line, m))?;
            face.uvs &= vt > 0;
            face.normals &= vn > 0;
            let or_none = |i: u64| if i > 0 { i.to_string() } else { String::new() };
            self.text += &format!(" {v}/{}/{}", or_none(vt), or_none(vn));
        }
        self.faces.push(face);
        match fault {
            Some(message) => self.notes.fault(self.fail(line, message), &self.files),
            None => Ok(()),
        }
    }

    /// Returns the numbers of the current object and material. The first use of a pair counts its memory.
    fn begin_part(&mut self) -> std::result::Result<(u32, u32), String> {
        let (object, material) = (&self.object, &self.material);
        let part = (self.objects.number(object), self.materials.number(material));
        if self.parts.insert(part) {
            let taken = self.memory.take(1, PART, &self.files);
            taken.map_err(|m| format!("object {object:?} with material {material:?} {m}"))?;
        }
        self.part = Some(part);
        Ok(part)
    }

    /// Returns the rows of a corner `v/vt/vn`, counted from 1. Rows that are left out are 0. A `vt` or `vn` row that
    /// does not exist is also 0, and sets `fault`.
    fn corner(
        &self,
        text: &str,
        fault: &mut Option<String>,
    ) -> std::result::Result<[u64; 3], String> {
        let mut rows = [0; 3];
        for (i, part) in text.split('/').enumerate() {
            if i > 0 && part.is_empty() {
                continue;
            }
            let Some(index) = part.parse::<i64>().ok().filter(|_| i < 3) else {
                return Err(format!(
                    "f has the corner {text:?}, expected v, v/vt, v//vn or v/vt/vn"
                ));
            };
            let most = if index < 0 { self.counts } else { self.totals }[i];
            let size = index.unsigned_abs();
            if (1..=most).contains(&size) {
                rows[i] = if index < 0 { most + 1 - size } else { size };
                continue;
            }
            let (kind, all) = (["v", "vt", "vn"][i], self.totals[i]);
            let message =
                format!("f {text}: {kind} index {index} is out of range, there are {all}");
            match i {
                0 => return Err(message),
                _ => *fault = Some(message),
            }
        }
        Ok(rows)
    }

    /// Parses all rows and faces as one mesh with polygons.
    fn parse(&self) -> Result<tobj::Mesh> {
        let load = |mut text: &[u8]| {
            let options = tobj::LoadOptions::default();
            tobj::load_obj_buf(&mut text, &options, |_| tobj::load_mtl_buf(&mut &[][..]))
        };
        let (mut models, _) = load(self.text.as_bytes()).map_err(|e| {
            // Faces were checked before, so the error is in the first row that tobj rejects on its own.
            let wrong = |line: &str| !line.starts_with('f') && load(line.as_bytes()).is_err();
            let line = self.text.lines().position(wrong);
            self.fail(line.map_or(0, |i| i + 1), e)
        })?;
        Ok(models.pop().map(|m| m.mesh).unwrap_or_default())
    }
}
