//! OBJ files, read.

use std::borrow::Cow;
use std::collections::HashMap;
use std::hash::Hash;
use std::path::Path;
use std::sync::Arc;

use burn::tensor::{Device, Tensor, TensorData};
use glam::DVec3;

use super::LoadLimits;
use super::limits::read_text;
use super::mtl::{Materials, keyword, words};
use super::polygon;
use crate::error::{Error, Result};
use crate::scene::{CornerAttribute, Mesh, Object, Scene};

/// The name of what comes before any `o` or `g`.
const UNNAMED: &str = "unnamed_object";
/// The tables of a file.
const TABLES: [&str; 3] = ["v", "vt", "vn"];

impl Scene {
    /// Reads an OBJ file with its MTL files.
    ///
    /// Every `o` or `g` becomes an [`Object`]; pieces of equal name are one object, with a
    /// material for each face. Vertices that faces share in the file stay shared. Polygons become
    /// triangles: fans where those fill them, else by ear clipping. Normals and texture coordinates count for objects that have them at every
    /// corner.
    ///
    /// Of a material, `Kd`, `Ks`, `Ns`, `Ke` (radiance of the front side), `map_Kd` and `map_Ks` (times `Ks`)
    /// count, and of the options of textures `-clamp on`. `map_Kd` counts instead of `Kd` on objects that
    /// have texture coordinates. What has no `Kd` or no material is mid-grey like
    /// [`Material::default`](crate::scene::Material::default).
    /// Entries that would change the picture and are not read are named in a warning, once a file.
    ///
    /// # Errors
    /// When a file is missing, malformed, too large, or outside of the OBJ file's folder
    /// ([`LoadLimits`]), an index is out of range, or there is no face.
    pub fn from_obj(path: impl AsRef<Path>, device: &Device) -> Result<Scene> {
        Self::from_obj_within(path, device, &LoadLimits::default())
    }

    /// As [`Scene::from_obj`] with given limits.
    ///
    /// # Errors
    /// As [`Scene::from_obj`].
    pub fn from_obj_within(
        path: impl AsRef<Path>,
        device: &Device,
        limits: &LoadLimits,
    ) -> Result<Scene> {
        let path = path.as_ref();
        let text = read_text(path, limits)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut materials = Materials::new(folder, limits, device);
        let mut file = ObjFile::default();
        // Faces may name what only comes after them.
        for (line, statement) in statements(&text) {
            let fail = |message| Error::format(path, format!("line {line}: {message}"));
            let (keyword, rest) = keyword(&statement);
            if let Some(table) = TABLES.iter().position(|t| *t == keyword) {
                file.tables[table].push(row(keyword, rest).map_err(fail)?);
            }
        }
        let mut current = Current::default();
        for (line, statement) in statements(&text) {
            let (keyword, rest) = keyword(&statement);
            match keyword {
                "mtllib" => {
                    materials.read(rest, &format!("{}, line {line}", path.display()))?;
                }
                _ => file
                    .read(keyword, rest, &mut current, limits.triangles)
                    .map_err(|m| Error::format(path, format!("line {line}: {m}")))?,
            }
        }
        for name in file.materials.all.iter().filter(|n| !materials.has(n)) {
            let file = path.display();
            log::warn!("{file}: no material is called {name:?}, taking the default");
        }
        if file.objects.is_empty() {
            return Err(Error::NoTriangles {
                path: Some(path.into()),
                objects: 0,
            });
        }
        let named = file.names.all.iter().zip(&file.objects);
        named.into_iter().try_fold(Scene::new(), |scene, (n, o)| {
            Ok(scene.with(file.object(n, o, &mut materials, device)?))
        })
    }
}

/// Keys in the order of their first use.
struct Numbered<K> {
    all: Vec<K>,
    number: HashMap<K, u32>,
}

// Derived, it would ask for a default of `K`.
impl<K> Default for Numbered<K> {
    fn default() -> Self {
        Self {
            all: Vec::new(),
            number: HashMap::new(),
        }
    }
}

impl<K: Hash + Eq + Clone> Numbered<K> {
    fn of(&mut self, key: K) -> u32 {
        let next = self.all.len() as u32;
        *self.number.entry(key).or_insert_with_key(|key| {
            self.all.push(key.clone());
            next
        })
    }
}

/// What an OBJ file says.
#[derive(Default)]
struct ObjFile {
    /// Rows of `v`, `vt` and `vn`.
    tables: [Vec<[f64; 3]>; 3],
    triangles: u64,
    /// The names of `usemtl`.
    materials: Numbered<String>,
    /// The names of objects with faces.
    names: Numbered<String>,
    objects: Vec<Faces>,
}

/// The state at a line.
#[derive(Default)]
struct Current {
    /// Rows of each table so far.
    found: [usize; 3],
    name: String,
    /// The number of its object, if it has faces.
    object: Option<usize>,
    material: Option<u32>,
}

/// The faces of an object.
#[derive(Default)]
struct Faces {
    /// The rows of each table that they name.
    rows: [Numbered<usize>; 3],
    /// Faces by these, without those that lack an attribute at a corner.
    faces: [Vec<[u32; 3]>; 3],
    materials: Numbered<Option<u32>>,
    face_materials: Vec<u32>,
}

/// Rows of the three tables at a corner of a face.
type Corner = [Option<usize>; 3];

impl ObjFile {
    /// Takes in a statement; the error is a message.
    fn read(
        &mut self,
        keyword: &str,
        rest: &str,
        current: &mut Current,
        most: u64,
    ) -> Result<(), String> {
        match keyword {
            "o" | "g" => {
                current.name = rest.into();
                current.object = None;
            }
            "usemtl" if rest.is_empty() => return Err("usemtl has no name".into()),
            "usemtl" => current.material = Some(self.materials.of(rest.into())),
            "f" => {
                let corners = words(rest).map(|word| self.corner(word, current.found));
                let corners: Vec<Corner> = corners.collect::<Result<_, _>>()?;
                if corners.len() < 3 {
                    let n = corners.len();
                    return Err(format!("f has {n} corners, expected at least 3"));
                }
                self.triangles += corners.len() as u64 - 2;
                if self.triangles > most {
                    return Err(format!(
                        "there are more than {most} triangles: LoadLimits::triangles raises the limit"
                    ));
                }
                let places = corners.iter().filter_map(|c| c[0]);
                let places: Vec<DVec3> = places.map(|r| self.tables[0][r].into()).collect();
                let object = *current.object.get_or_insert_with(|| {
                    let name = match current.name.as_str() {
                        "" => UNNAMED,
                        name => name,
                    };
                    self.names.of(name.into()) as usize
                });
                if object == self.objects.len() {
                    self.objects.push(Faces::default());
                }
                for triangle in polygon::triangles(&places) {
                    self.objects[object].add(triangle.map(|i| corners[i]), current.material);
                }
            }
            _ => {
                if let Some(table) = TABLES.iter().position(|t| *t == keyword) {
                    current.found[table] += 1;
                }
            }
        }
        Ok(())
    }

    /// The rows of `v/vt/vn`, where `found` rows came before.
    fn corner(&self, word: &str, found: [usize; 3]) -> Result<Corner, String> {
        let malformed = || format!("f has the corner {word:?}, expected v, v/vt, v//vn or v/vt/vn");
        let mut rows = [None; 3];
        for (k, part) in word.split('/').enumerate() {
            if k > 2 || (k == 0 && part.is_empty()) {
                return Err(malformed());
            }
            if part.is_empty() {
                continue;
            }
            let index: i64 = part.parse().map_err(|_| malformed())?;
            let first = if index < 0 { found[k] as i64 } else { -1 };
            let (total, kind) = (self.tables[k].len(), TABLES[k]);
            let row = usize::try_from(first + index).ok().filter(|&r| r < total);
            rows[k] = Some(row.ok_or_else(|| {
                format!("f {word}: {kind} index {index} is out of range, there are {total}")
            })?);
        }
        Ok(rows)
    }

    /// An object of a scene.
    fn object(
        &self,
        name: &str,
        faces: &Faces,
        materials: &mut Materials,
        device: &Device,
    ) -> Result<Object> {
        let [vertices, uvs, normals] = [0, 1, 2].map(|k| {
            let rows = faces.rows[k].all.iter().map(|&r| self.tables[k][r]);
            rows.collect::<Vec<_>>()
        });
        let whole = |k: usize| faces.faces[k].len() == faces.faces[0].len();
        let attribute = |k: usize, columns: usize, rows: &[[f64; 3]]| {
            let flat: Vec<f64> = rows.iter().flat_map(|r| &r[..columns]).copied().collect();
            CornerAttribute {
                values: Tensor::from_data(TensorData::new(flat, [rows.len(), columns]), device),
                faces: Arc::new(faces.faces[k].clone()),
            }
        };
        let mut mesh = Mesh::from_host(&vertices, faces.faces[0].clone(), device);
        mesh.uvs = whole(1).then(|| attribute(1, 2, &uvs));
        if whole(2) && normals.contains(&[0.0; 3]) {
            log::warn!("{name}: it has normals of zero length, using none of its normals");
        } else {
            mesh.normals = whole(2).then(|| attribute(2, 3, &normals));
        }
        let mut object = Object::new(mesh).named(name);
        let used = faces.materials.all.iter();
        let used = used.map(|m| m.map(|m| self.materials.all[m as usize].as_str()));
        let made = used.map(|m| materials.get(m, name, object.mesh.uvs.is_some()));
        object.materials = made.collect::<Result<_>>()?;
        if object.materials.len() > 1 {
            object.face_materials = Arc::new(faces.face_materials.clone());
        }
        Ok(object)
    }
}

impl Faces {
    fn add(&mut self, corners: [Corner; 3], material: Option<u32>) {
        for k in 0..3 {
            if let [Some(a), Some(b), Some(c)] = corners.map(|corner| corner[k]) {
                self.faces[k].push([a, b, c].map(|row| self.rows[k].of(row)));
            }
        }
        self.face_materials.push(self.materials.of(material));
    }
}

/// The statements of a file, with the numbers of their last lines: a backslash at a line's end joins it
/// with the next one.
fn statements(text: &str) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    // The empty line ends a last one that goes on.
    let mut lines = text.lines().chain([""]).enumerate();
    std::iter::from_fn(move || {
        let mut joined = String::new();
        for (i, line) in lines.by_ref() {
            match line.trim_end().strip_suffix('\\') {
                Some(begun) if !line.starts_with('#') => {
                    joined += begun;
                    joined.push(' ');
                }
                _ if joined.is_empty() => return Some((i + 1, line.into())),
                _ => return Some((i + 1, (joined + line).into())),
            }
        }
        None
    })
}

/// A row of a table; the third number of a `vt` is 0.
fn row(keyword: &str, rest: &str) -> Result<[f64; 3], String> {
    let words: Vec<&str> = words(rest).collect();
    let numbers: Vec<f64> = words.iter().map_while(|w| w.parse().ok()).collect();
    match (keyword, words.len(), &numbers[..]) {
        // Homogeneous.
        ("v", 4, &[x, y, z, w]) if w != 0.0 => Ok([x / w, y / w, z / w]),
        ("v", 3 | 5.., &[x, y, z, ..]) | ("vn", _, &[x, y, z, ..]) => Ok([x, y, z]),
        ("vt", 1, &[u]) => Ok([u, 0.0, 0.0]),
        ("vt", _, &[u, v, ..]) => Ok([u, v, 0.0]),
        _ => {
            let expected = match keyword {
                "v" => "a position: 3 numbers, or 4 of which the last is not 0",
                "vt" => "texture coordinates: 1 or 2 numbers",
                _ => "a normal: 3 numbers",
            };
            Err(format!("{keyword} is {rest:?}, expected {expected}"))
        }
    }
}
