//! OBJ text made fit for tobj, which takes polylines for faces, splits a file where objects and materials
//! change, fills in missing normals, and reads no colours where only some vertices have one.

use std::borrow::Cow;
use std::collections::{HashMap, HashSet};
use std::path::Path;

use super::counting::Counting;
use super::limits::{LoadLimits, Memory, read_text};
use super::mtl_text::MtlText;
use super::notes::Notes;
use super::obj_names::keyword;
use crate::error::{Error, Result};

/// The name of what comes before any `o` or `g`.
const UNNAMED: &str = "unnamed_object";

/// About the bytes that a render takes for an object and each of its materials: three copies of their tensors' handles.
const PART: u64 = 3 << 12;

/// An OBJ file as tobj gets it: vertices and faces, as one mesh.
#[derive(Default)]
pub(super) struct ObjText {
    text: String,
    /// The line of the file that each line comes from.
    lines: Vec<u32>,
    pub mtl: MtlText,
    /// Objects with faces, in the order of their first ones.
    pub objects: Vec<ObjectText>,
    /// The names of `usemtl`; the first is empty and stands for none.
    pub materials: Names,
    /// Faces that follow each other and have an object and a material in common.
    pub runs: Vec<Run>,
    /// Whether vertices have colours.
    pub coloured: bool,
    /// What objects and their materials take.
    pub memory: Memory,
}

/// An object of a file.
pub(super) struct ObjectText {
    pub name: String,
    /// Whether all corners have texture coordinates.
    pub uvs: bool,
    /// Whether all corners have normals.
    pub normals: bool,
}

/// Faces of an object with one material.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Run {
    pub first_face: usize,
    pub object: u32,
    pub material: u32,
}

/// Names, each once.
#[derive(Default)]
pub(super) struct Names {
    pub all: Vec<String>,
    numbers: HashMap<String, u32>,
}

impl Names {
    fn number(&mut self, name: &str) -> u32 {
        if let Some(&number) = self.numbers.get(name) {
            return number;
        }
        let next = self.all.len() as u32;
        self.all.push(name.into());
        self.numbers.insert(name.into(), next);
        next
    }
}

impl ObjText {
    /// Reads an OBJ file and the MTL files that it names.
    pub fn read(path: &Path, limits: &LoadLimits, notes: &mut Notes) -> Result<Self> {
        let text = read_text(path, limits)?;
        let mut reader = Reader::new(path, &text, limits);
        let mut continued = String::new();
        // The empty line ends a last one that goes on.
        for (i, line) in text.lines().chain([""]).enumerate() {
            if !line.starts_with('#')
                && let Some(begun) = line.trim_end().strip_suffix('\\')
            {
                continued += begun;
                continued.push(' ');
                continue;
            }
            if continued.is_empty() {
                reader.line(i, line, notes)?;
            } else {
                continued += line;
                reader.line(i, &std::mem::take(&mut continued), notes)?;
            }
        }
        Ok(reader.found)
    }

    /// Parses the text by tobj, as one mesh with polygons.
    pub fn parse(&self, path: &Path) -> Result<tobj::Mesh> {
        let options = tobj::LoadOptions::default();
        let mut reader = Counting {
            rest: self.text.as_bytes(),
            lines: 0,
        };
        let parsed =
            tobj::load_obj_buf(&mut reader, &options, |_| tobj::load_mtl_buf(&mut &[][..]));
        let (mut models, _) = parsed.map_err(|e| {
            let line = self.lines.get(reader.lines.saturating_sub(1));
            let line = line.or(self.lines.last()).copied().unwrap_or(1);
            Error::format(path, format!("line {line}: {e}"))
        })?;
        Ok(models.pop().map(|m| m.mesh).unwrap_or_default())
    }

    /// The line of the file that a face comes from.
    pub fn line_of_face(&self, face: usize) -> u32 {
        let lines = self.text.lines().zip(&self.lines);
        let mut faces = lines.filter(|(text, _)| text.starts_with("f "));
        faces.nth(face).map_or(0, |(_, &line)| line)
    }
}

/// What was read so far.
struct Reader<'a> {
    path: &'a Path,
    folder: &'a Path,
    limits: &'a LoadLimits,
    /// The numbers of `v`, `vt` and `vn` of the whole file: faces may name what only comes after them.
    totals: [usize; 3],
    counts: [usize; 3],
    triangles: u64,
    faces: usize,
    /// The name that faces get.
    name: String,
    material: u32,
    /// The object and the material of the last face, unless there was another statement.
    current: Option<Run>,
    names: Names,
    /// Objects with their materials.
    parts: HashSet<(u32, u32)>,
    found: ObjText,
}

impl<'a> Reader<'a> {
    fn new(path: &'a Path, text: &str, limits: &'a LoadLimits) -> Self {
        let (mut totals, mut coloured) = ([0; 3], false);
        for line in text.lines() {
            let mut words = line.split_whitespace();
            match words.next() {
                Some("v") => {
                    totals[0] += 1;
                    coloured |= words.take_while(|w| !w.starts_with('#')).count() >= 6;
                }
                Some("vt") => totals[1] += 1,
                Some("vn") => totals[2] += 1,
                _ => {}
            }
        }
        let mut found = ObjText {
            coloured,
            memory: Memory {
                taken: 0,
                read: text.len() as u64,
            },
            ..ObjText::default()
        };
        Self {
            path,
            folder: path.parent().unwrap_or(Path::new("")),
            limits,
            totals,
            counts: [0; 3],
            triangles: 0,
            faces: 0,
            name: UNNAMED.into(),
            material: found.materials.number(""),
            current: None,
            names: Names::default(),
            parts: HashSet::new(),
            found,
        }
    }

    /// Reads line i, with those that it continues.
    fn line(&mut self, i: usize, line: &str, notes: &mut Notes) -> Result<()> {
        let (keyword, rest) = keyword(line);
        let values: Vec<&str> = rest
            .split_whitespace()
            .take_while(|w| !w.starts_with('#'))
            .collect();
        match keyword {
            "v" => {
                // With w there are four numbers, else there may be more than three that count for nothing.
                match values.len() {
                    _ if self.found.coloured => self.add(i, "v", &coloured(&values)),
                    0..=4 => self.add(i, "v", &values),
                    _ => self.add(i, "v", &values[..3]),
                }
                self.counts[0] += 1;
            }
            "vt" => {
                let v = values.get(1).unwrap_or(&"0");
                self.add(i, "vt", &[values.first().unwrap_or(&""), v]);
                self.counts[1] += 1;
            }
            "vn" => {
                self.add(i, "vn", &values);
                self.counts[2] += 1;
            }
            "f" => {
                let (path, limits) = (self.path, self.limits);
                let fail = |m: &str| Error::format(path, format!("line {}: {m}", i + 1));
                if values.len() < 3 {
                    let message = format!("f has {} corners, expected at least 3", values.len());
                    notes.fault(fail(&message), limits)?;
                    return Ok(());
                }
                let corners = self.face(&values).map_err(|m| fail(&m))?;
                if let Some(wrong) = corners.iter().find_map(|c| c.wrong.as_ref()) {
                    notes.fault(fail(wrong), limits)?;
                }
                self.add(i, "f", &corners);
            }
            "o" | "g" => {
                self.name = if rest.is_empty() { UNNAMED } else { rest }.into();
                self.current = None;
            }
            "usemtl" => {
                self.material = self.found.materials.number(rest);
                self.current = None;
            }
            "mtllib" => {
                let from = format!("{}, line {}", self.path.display(), i + 1);
                let mtl = &mut self.found.mtl;
                mtl.add(rest, self.folder, &from, self.limits, notes)?;
            }
            _ => {}
        }
        Ok(())
    }

    /// Adds a line to the text.
    fn add<S: AsRef<str>>(&mut self, i: usize, keyword: &str, values: &[S]) {
        let text = &mut self.found.text;
        *text += keyword;
        for value in values {
            text.push(' ');
            *text += value.as_ref();
        }
        text.push('\n');
        self.found.lines.push(i as u32 + 1);
    }

    /// Checks a face and counts it.
    fn face<'b>(&mut self, corners: &[&'b str]) -> std::result::Result<Vec<Corner<'b>>, String> {
        self.triangles += corners.len() as u64 - 2;
        if self.triangles > self.limits.triangles {
            return Err(format!(
                "there are more than {} triangles: LoadLimits::triangles raises the limit",
                self.limits.triangles
            ));
        }
        let run = match self.current {
            Some(run) => run,
            None => self.begin_run()?,
        };
        let object = &mut self.found.objects[run.object as usize];
        let mut found = Vec::with_capacity(corners.len());
        for corner in corners {
            let corner = Corner::parse(corner, self.counts, self.totals)?;
            object.uvs &= corner.uv;
            object.normals &= corner.normal;
            found.push(corner);
        }
        self.faces += 1;
        Ok(found)
    }

    /// Begins a run at the next face.
    fn begin_run(&mut self) -> std::result::Result<Run, String> {
        let run = Run {
            first_face: self.faces,
            object: self.names.number(&self.name),
            material: self.material,
        };
        if run.object as usize == self.found.objects.len() {
            self.found.objects.push(ObjectText {
                name: self.name.clone(),
                uvs: true,
                normals: true,
            });
        }
        if self.parts.insert((run.object, run.material)) {
            let taken = self.found.memory.take(1, PART, self.limits);
            let material = &self.found.materials.all[run.material as usize];
            taken.map_err(|m| format!("object {:?} with material {material:?} {m}", self.name))?;
        }
        self.found.runs.push(run);
        self.current = Some(run);
        Ok(run)
    }
}

/// The place and the colour of a vertex, which is no number where it has none. What doesn't parse is left for tobj
/// to refuse.
fn coloured(values: &[&str]) -> Vec<String> {
    let numbers: Vec<f64> = values.iter().map_while(|v| v.parse().ok()).collect();
    let owned = |values: &[&str]| values.iter().map(|&v| v.to_owned()).collect::<Vec<_>>();
    let place = match numbers[..] {
        [x, y, z, w] if w != 0.0 => [x / w, y / w, z / w].map(|v| v.to_string()).to_vec(),
        _ if values.len() <= 4 => owned(values),
        _ => owned(&values[..3]),
    };
    match numbers.len() {
        6.. => owned(&values[..6]),
        _ if place.len() == 3 => [place, owned(&["nan"; 3])].concat(),
        _ => place,
    }
}

/// A corner `v/vt/vn` of a face.
struct Corner<'a> {
    /// Without what is not there.
    text: Cow<'a, str>,
    /// Whether there are a texture coordinate and a normal.
    uv: bool,
    normal: bool,
    /// What it names that is not there.
    wrong: Option<String>,
}

impl AsRef<str> for Corner<'_> {
    fn as_ref(&self) -> &str {
        &self.text
    }
}

impl<'a> Corner<'a> {
    /// Checks indices by the numbers of rows so far and in the whole file.
    fn parse(
        text: &'a str,
        counts: [usize; 3],
        totals: [usize; 3],
    ) -> std::result::Result<Self, String> {
        let numbers = |part: &str| part.is_empty() || part.parse::<i64>().is_ok();
        let well_formed = text.split('/').all(numbers) && text.split('/').count() <= 3;
        if !well_formed || text.starts_with('/') || text.is_empty() {
            return Err(format!(
                "f has the corner {text:?}, expected v, v/vt, v//vn or v/vt/vn"
            ));
        }
        let (mut parts, mut wrong) = ([""; 3], None);
        for (i, part) in text.split('/').enumerate() {
            // Empty parts are none.
            let Ok(index) = part.parse::<i64>() else {
                continue;
            };
            let most = if index < 0 { counts[i] } else { totals[i] };
            if (1..=most as u64).contains(&index.unsigned_abs()) {
                parts[i] = part;
                continue;
            }
            let kind = ["v", "vt", "vn"][i];
            let message = format!(
                "f {text}: {kind} index {index} is out of range, there are {}",
                totals[i]
            );
            if i == 0 {
                return Err(message);
            }
            wrong = Some(message);
        }
        let [v, vt, vn] = parts;
        Ok(Self {
            text: match (&wrong, vt, vn) {
                (None, ..) => text.into(),
                (_, vt, "") => format!("{v}/{vt}").into(),
                _ => format!("{v}/{vt}/{vn}").into(),
            },
            uv: !vt.is_empty(),
            normal: !vn.is_empty(),
            wrong,
        })
    }
}
