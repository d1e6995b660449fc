//! OBJ and MTL text made fit for tobj, which loses or refuses some of what files hold: it takes
//! polylines for faces, fills in missing normals, panics on `Kd` with less than 3 numbers, forgets
//! the names of missing materials and which vertices its pieces share.

use std::collections::HashSet;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::counting::Counting;
use super::limits::{LoadLimits, read_text};
use super::obj_names::{keyword, libraries, resolve, texture_name};
use super::polygon;
use crate::error::{Error, Result};

/// The name that tobj gives to what comes before any `o` or `g`.
const UNNAMED: &str = "unnamed_object";

/// Entries of MTL files that would change a render and are not read.
const UNREAD: [&str; 20] = [
    "d", "Tr", "Tf", "Ni", "Pr", "Pm", "Ps", "Pc", "aniso", "map_Ka", "map_Ns", "map_d",
    "map_Bump", "map_bump", "bump", "disp", "norm", "map_Pr", "map_Pm", "refl",
];

/// An OBJ file and its MTL files as tobj gets them.
#[derive(Default)]
pub struct ObjText {
    /// Line 1 loads [`Self::mtl`]. Each vertex carries its row as a colour: that is how pieces of an
    /// object find their shared vertices again.
    obj: String,
    /// The line of the file that each line after the first comes from.
    lines: Vec<usize>,
    /// All materials, those that are used but not defined as empty ones; `map_Kd i` is the i-th
    /// texture, and `map_Kd i clamp` the same where it does not repeat.
    mtl: String,
    /// Files of textures, each once.
    pub textures: Vec<PathBuf>,
    /// Objects with a corner without texture coordinates.
    pub without_uvs: HashSet<String>,
    /// Objects with a corner without a normal.
    pub without_normals: HashSet<String>,
}

impl ObjText {
    /// Reads an OBJ file and the MTL files that it names.
    #[expect(
        clippy::too_many_lines,
        reason = "an arm for each keyword of the format"
    )]
    pub fn read(path: &Path, limits: &LoadLimits) -> Result<Self> {
        let text = read_text(path, limits)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let keywords = || text.lines().filter_map(|l| l.split_whitespace().next());
        // Faces may name what only comes after them.
        let totals = ["v", "vt", "vn"].map(|k| keywords().filter(|&w| w == k).count());
        let mut found = [0; 3];
        // Places of all vertices, if a face has more than three corners.
        let mut places: Option<Vec<DVec3>> = None;
        let mut triangles = 0;
        let mut this = Self {
            obj: "mtllib all\n".into(),
            ..Self::default()
        };
        let (mut used, mut defined) = (Vec::new(), HashSet::new());
        let mut object = UNNAMED.to_owned();
        let mut continued = String::new();
        // The empty line ends a last one that goes on.
        for (i, line) in text.lines().chain([""]).enumerate() {
            let fail = |message: String| Error::format(path, format!("line {}: {message}", i + 1));
            if !line.starts_with('#')
                && let Some(begun) = line.trim_end().strip_suffix('\\')
            {
                continued += begun;
                continued.push(' ');
                this.end_line(i);
                continue;
            }
            let line = std::mem::take(&mut continued) + line;
            let (keyword, rest) = keyword(&line);
            let values: Vec<&str> = rest
                .split_whitespace()
                .take_while(|w| !w.starts_with('#'))
                .collect();
            match keyword {
                "v" => {
                    this.obj += &vertex(&values, found[0]);
                    found[0] += 1;
                }
                "vt" => {
                    let v = values.get(1).unwrap_or(&"0");
                    this.obj += &format!("vt {} {v}", values.first().unwrap_or(&""));
                    found[1] += 1;
                }
                "vn" => {
                    this.obj += &format!("vn {}", values.join(" "));
                    found[2] += 1;
                }
                "f" => {
                    if values.len() < 3 {
                        let n = values.len();
                        return Err(fail(format!("f has {n} corners, expected at least 3")));
                    }
                    for corner in &values {
                        let [uv, normal] = check_corner(corner, found, totals).map_err(fail)?;
                        if !uv {
                            this.without_uvs.insert(object.clone());
                        }
                        if !normal {
                            this.without_normals.insert(object.clone());
                        }
                    }
                    triangles += values.len() as u64 - 2;
                    if triangles > limits.triangles {
                        return Err(fail(format!(
                            "there are more than {} triangles: LoadLimits::triangles raises the limit",
                            limits.triangles
                        )));
                    }
                    if values.len() == 3 {
                        this.obj += &format!("f {}", values.join(" "));
                    } else {
                        let places = places.get_or_insert_with(|| places_of(&text));
                        let corners = values.iter().map(|c| place(c, places, found[0]));
                        let corners: Vec<DVec3> = corners.collect();
                        for (k, [a, b, c]) in polygon::triangles(&corners).into_iter().enumerate() {
                            if k > 0 {
                                this.end_line(i);
                            }
                            this.obj += &format!("f {} {} {}", values[a], values[b], values[c]);
                        }
                    }
                }
                "o" | "g" => {
                    object = if rest.is_empty() { UNNAMED } else { rest }.to_owned();
                    this.obj += &format!("o {object}");
                }
                "usemtl" => {
                    used.push(rest.to_owned());
                    this.obj += &format!("usemtl {rest}");
                }
                "mtllib" => {
                    for file in libraries(folder, rest) {
                        let from = format!("{}, line {}", path.display(), i + 1);
                        limits.check_place(&file, folder, &from)?;
                        let text = read_text(&file, limits).map_err(|e| {
                            let message = format!("it can't be read (named by {from}): {e}");
                            Error::format(&file, message)
                        })?;
                        this.add_mtl(&file, folder, &text, &mut defined, limits)?;
                    }
                }
                _ => {}
            }
            this.end_line(i);
        }
        for name in used {
            if !name.is_empty() && defined.insert(name.clone()) {
                log::warn!(
                    "{}: no material is called {name:?}, taking the default",
                    path.display()
                );
                this.mtl += &format!("newmtl {name}\n");
            }
        }
        Ok(this)
    }

    /// Ends a line of the text that was made from line i of the file.
    fn end_line(&mut self, i: usize) {
        self.obj.push('\n');
        self.lines.push(i + 1);
    }

    /// Parses the texts by tobj.
    pub fn parse(&self, path: &Path) -> Result<(Vec<tobj::Model>, Vec<tobj::Material>)> {
        let options = tobj::LoadOptions {
            triangulate: true,
            single_index: false,
            ..Default::default()
        };
        let mut reader = Counting {
            rest: self.obj.as_bytes(),
            lines: 0,
        };
        let parsed = tobj::load_obj_buf(&mut reader, &options, |_| {
            tobj::load_mtl_buf(&mut self.mtl.as_bytes())
        });
        let fail = |e: tobj::LoadError| match e {
            // These show at the end of an object only.
            tobj::LoadError::FaceVertexOutOfBounds
            | tobj::LoadError::FaceTexCoordOutOfBounds
            | tobj::LoadError::FaceNormalOutOfBounds => Error::format(path, e.to_string()),
            _ => {
                let line = self.lines.get(reader.lines.saturating_sub(2));
                let line = line.or(self.lines.last()).copied().unwrap_or(1);
                Error::format(path, format!("line {line}: {e}"))
            }
        };
        let (models, materials) = parsed.map_err(fail)?;
        let materials = materials.map_err(|e| Error::format(path, format!("materials: {e}")))?;
        Ok((models, materials))
    }

    /// Appends the part of an MTL file that counts.
    fn add_mtl(
        &mut self,
        path: &Path,
        obj_folder: &Path,
        text: &str,
        defined: &mut HashSet<String>,
        limits: &LoadLimits,
    ) -> Result<()> {
        let mut named = false;
        // What would change the picture and is not read, told once.
        let mut unread: Vec<&str> = Vec::new();
        for (i, line) in text.lines().enumerate() {
            let fail = |message: String| Error::format(path, format!("line {}: {message}", i + 1));
            let (keyword, rest) = keyword(line);
            let values = || {
                rest.split_whitespace()
                    .take_while(|w| !w.starts_with('#'))
                    .collect::<Vec<_>>()
            };
            let numbers = |count: usize| {
                let values = values();
                let valid = values.iter().take(count).all(|v| v.parse::<f64>().is_ok());
                match values.len() {
                    // One number stands for all three channels.
                    1 if valid => Ok(vec![values[0]; count].join(" ")),
                    n if n >= count && valid => Ok(values[..count].join(" ")),
                    _ => Err(fail(format!(
                        "{keyword} is {rest:?}, expected 1 or {count} numbers"
                    ))),
                }
            };
            let written = match keyword {
                "newmtl" if rest.is_empty() => {
                    return Err(fail("newmtl has no name".into()));
                }
                "newmtl" => {
                    named = true;
                    defined.insert(rest.to_owned());
                    writeln!(self.mtl, "newmtl {rest}")
                }
                "Kd" | "Ks" | "Ke" if named => writeln!(self.mtl, "{keyword} {}", numbers(3)?),
                "Ns" if named => writeln!(self.mtl, "Ns {}", numbers(1)?),
                "map_Kd" | "map_Ks" | "map_Ke" if named => {
                    let (name, options) = texture_name(rest);
                    if name.is_empty() {
                        return Err(fail(format!("{keyword} names no file")));
                    }
                    let clamp = options.contains(&["-clamp", "on"]);
                    if options.iter().any(|o| o[0] != "-clamp") {
                        let file = path.display();
                        log::warn!(
                            "{file}: of the options of {keyword} {rest} only -clamp is read"
                        );
                    }
                    let own = path.parent().unwrap_or(obj_folder);
                    let file = resolve(&[own, obj_folder], name);
                    let from = format!("{}, line {}", path.display(), i + 1);
                    limits.check_place(&file, obj_folder, &from)?;
                    let known = self.textures.iter().position(|t| *t == file);
                    let index = known.unwrap_or_else(|| {
                        self.textures.push(file);
                        self.textures.len() - 1
                    });
                    let clamp = if clamp { " clamp" } else { "" };
                    writeln!(self.mtl, "{keyword} {index}{clamp}")
                }
                "Kd" | "Ks" | "Ke" | "Ns" | "map_Kd" | "map_Ks" | "map_Ke" => {
                    return Err(fail(format!("{keyword} comes before any newmtl")));
                }
                other => {
                    if UNREAD.contains(&other) && !unread.contains(&other) {
                        unread.push(other);
                    }
                    Ok(())
                }
            };
            written.map_err(|e| fail(e.to_string()))?;
        }
        if !unread.is_empty() {
            let list = unread.join(", ");
            log::warn!("{}: these entries are not read: {list}", path.display());
        }
        Ok(())
    }
}

/// A vertex with its row for a colour; numbers that don't parse are left for tobj to refuse.
fn vertex(values: &[&str], row: usize) -> String {
    let homogeneous: Vec<f64> = values.iter().filter_map(|v| v.parse().ok()).collect();
    match (values, homogeneous.as_slice()) {
        ([_, _, _, _], &[x, y, z, w]) if w != 0.0 => {
            format!("v {} {} {} {row} 0 0", x / w, y / w, z / w)
        }
        ([x, y, z, rest @ ..], _) if rest.len() != 1 => format!("v {x} {y} {z} {row} 0 0"),
        _ => format!("v {}", values.join(" ")),
    }
}

/// The places of all vertices of a file, not numbers where they can't be read.
fn places_of(text: &str) -> Vec<DVec3> {
    let of_line = |line: &str| {
        let (keyword, rest) = keyword(line);
        let mut numbers = rest.split_whitespace().map(|w| w.parse::<f64>());
        let mut next = || numbers.next().and_then(|n| n.ok()).unwrap_or(f64::NAN);
        (keyword == "v").then(|| DVec3::new(next(), next(), next()))
    };
    text.lines().filter_map(of_line).collect()
}

/// The place of a corner's vertex, where `found` vertices came before it.
fn place(corner: &str, places: &[DVec3], found: usize) -> DVec3 {
    let index = corner.split('/').next().and_then(|v| v.parse::<i64>().ok());
    let row = index.map(|i| if i < 0 { found as i64 + i } else { i - 1 });
    let row = row.and_then(|r| usize::try_from(r).ok());
    row.and_then(|r| places.get(r).copied())
        .unwrap_or(DVec3::NAN)
}

/// Checks the indices of `v/vt/vn` and says whether there are a texture coordinate and a normal.
fn check_corner(
    corner: &str,
    found: [usize; 3],
    totals: [usize; 3],
) -> std::result::Result<[bool; 2], String> {
    let mut present = [false; 3];
    let numbers = |part: &str| part.is_empty() || part.parse::<i64>().is_ok();
    let well_formed = corner.split('/').all(numbers) && corner.split('/').count() <= 3;
    if !well_formed || corner.split('/').next().is_none_or(str::is_empty) {
        return Err(format!(
            "f has the corner {corner:?}, expected v, v/vt, v//vn or v/vt/vn"
        ));
    }
    let slots = found.iter().zip(totals).zip(["v", "vt", "vn"]);
    for ((part, ((&found, total), kind)), present) in corner.split('/').zip(slots).zip(&mut present)
    {
        // Empty parts are none.
        let Ok(index) = part.parse::<i64>() else {
            continue;
        };
        let valid = if index < 0 {
            index.unsigned_abs() <= found as u64
        } else {
            (1..=total as u64).contains(&index.unsigned_abs())
        };
        if !valid {
            return Err(format!(
                "f {corner}: {kind} index {index} is out of range, there are {total}"
            ));
        }
        *present = true;
    }
    Ok([present[1], present[2]])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Texels take memory once, however many materials name their file.
    #[test]
    fn a_file_of_texels_is_one_texture() {
        let folder = std::env::temp_dir().join(format!("softray-texts-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder");
        let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).expect("it");
        let files = ["wood.png", "./wood.png", "stone.png"];
        let mtl = files.map(|file| format!("newmtl {file}\nmap_Kd {file}\n"));
        write("scene.mtl", &mtl.concat());
        write("scene.obj", "mtllib scene.mtl\nv 0 0 0\n");
        let obj = folder.join("scene.obj");
        let text = ObjText::read(&obj, &LoadLimits::default()).expect("a text");
        assert_eq!(text.textures.len(), 2);
        assert_eq!(text.mtl.matches("map_Kd 0").count(), 2);
        std::fs::remove_dir_all(&folder).expect("removed");
    }
}
