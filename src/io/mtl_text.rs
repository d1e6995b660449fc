//! MTL text made fit for tobj, which panics on `Kd` with less than 3 numbers and keeps names of textures with
//! their options.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use super::limits::{LoadLimits, read_text};
use super::notes::Notes;
use super::obj_names::{keyword, libraries, resolve, texture_name};
use crate::error::{Error, Result};

/// Entries that would change a render and are not read.
const UNREAD: [&str; 20] = [
    "d", "Tr", "Tf", "Ni", "Pr", "Pm", "Ps", "Pc", "aniso", "map_Ka", "map_Ns", "map_d",
    "map_Bump", "map_bump", "bump", "disp", "norm", "map_Pr", "map_Pm", "refl",
];

/// The MTL files of an OBJ file as tobj gets them.
#[derive(Default)]
pub(super) struct MtlText {
    /// All materials; `map_Kd i` is the i-th texture, and `map_Kd i clamp` the same where it does not repeat.
    text: String,
    /// Files of textures, each once.
    pub textures: Vec<PathBuf>,
    numbers: HashMap<PathBuf, usize>,
    /// Bytes of the files.
    pub bytes: u64,
    /// The files that were read.
    read: HashSet<PathBuf>,
}

impl MtlText {
    /// Adds the files of an `mtllib` statement of a file in a folder; `from` says where it stands.
    pub fn add(
        &mut self,
        statement: &str,
        folder: &Path,
        from: &str,
        limits: &LoadLimits,
        notes: &mut Notes,
    ) -> Result<()> {
        for file in libraries(folder, statement) {
            limits.check_place(&file, folder, from)?;
            if !self
                .read
                .insert(file.canonicalize().unwrap_or_else(|_| file.clone()))
            {
                continue;
            }
            match read_text(&file, limits) {
                Ok(text) => self.add_file(&file, folder, &text, limits, notes)?,
                Err(error) => {
                    let message = format!("it can't be read (named by {from}): {error}");
                    notes.fault(Error::format(&file, message), limits)?;
                }
            }
        }
        Ok(())
    }

    /// Appends the part of a file that counts.
    fn add_file(
        &mut self,
        path: &Path,
        obj_folder: &Path,
        text: &str,
        limits: &LoadLimits,
        notes: &mut Notes,
    ) -> Result<()> {
        self.bytes += text.len() as u64;
        let mut named = false;
        // What would change the picture and is not read, told once.
        let mut unread: Vec<&str> = Vec::new();
        for (i, line) in text.lines().enumerate() {
            let (keyword, rest) = keyword(line);
            let from = || format!("{}, line {}", path.display(), i + 1);
            let written = match keyword {
                "newmtl" => {
                    named = !rest.is_empty();
                    match named {
                        true => Ok(rest.to_owned()),
                        false => Err("newmtl has no name".into()),
                    }
                }
                "Kd" | "Ks" | "Ke" | "Ns" | "illum" | "map_Kd" | "map_Ks" | "map_Ke" if !named => {
                    Err(format!("{keyword} comes before any newmtl"))
                }
                "Kd" | "Ks" | "Ke" => numbers(keyword, rest, 3),
                "Ns" => numbers(keyword, rest, 1),
                "illum" => match rest.split_whitespace().next().map(str::parse::<u8>) {
                    Some(Ok(model)) => Ok(model.to_string()),
                    _ => Err(format!("illum is {rest:?}, expected a number from 0 to 10")),
                },
                "map_Kd" | "map_Ks" | "map_Ke" => {
                    let (name, options) = texture_name(rest);
                    if options.iter().any(|o| o[0] != "-clamp") {
                        notes.add("of the options of textures only -clamp is read", from());
                    }
                    let own = path.parent().unwrap_or(obj_folder);
                    let file = resolve(&[own, obj_folder], name);
                    limits.check_place(&file, obj_folder, &from())?;
                    let clamp = match options.contains(&["-clamp", "on"]) {
                        true => " clamp",
                        false => "",
                    };
                    match name {
                        "" => Err(format!("{keyword} names no file")),
                        _ => Ok(format!("{}{clamp}", self.texture(file))),
                    }
                }
                other => {
                    if UNREAD.contains(&other) && !unread.contains(&other) {
                        unread.push(other);
                    }
                    continue;
                }
            };
            match written {
                Ok(value) => self.text += &format!("{keyword} {value}\n"),
                Err(message) => {
                    let message = format!("line {}: {message}", i + 1);
                    notes.fault(Error::format(path, message), limits)?;
                }
            }
        }
        if !unread.is_empty() {
            let list = unread.join(", ");
            log::warn!("{}: these entries are not read: {list}", path.display());
        }
        Ok(())
    }

    /// The number of a texture's file.
    fn texture(&mut self, file: PathBuf) -> usize {
        let next = self.textures.len();
        *self.numbers.entry(file).or_insert_with_key(|file| {
            self.textures.push(file.clone());
            next
        })
    }

    /// The materials and their numbers by name.
    pub fn parse(&self, path: &Path) -> Result<(Vec<tobj::Material>, HashMap<String, usize>)> {
        let parsed = tobj::load_mtl_buf(&mut self.text.as_bytes());
        let (materials, numbers) =
            parsed.map_err(|e| Error::format(path, format!("materials: {e}")))?;
        Ok((materials, numbers.into_iter().collect()))
    }
}

/// The first numbers of a statement; one stands for all three channels.
fn numbers(keyword: &str, rest: &str, count: usize) -> std::result::Result<String, String> {
    let values: Vec<&str> = rest
        .split_whitespace()
        .take_while(|w| !w.starts_with('#'))
        .collect();
    let finite = |v: &&str| v.parse::<f64>().is_ok_and(f64::is_finite);
    let valid = values.iter().take(count).all(finite);
    match values.len() {
        1 if valid => Ok(vec![values[0]; count].join(" ")),
        n if n >= count && valid => Ok(values[..count].join(" ")),
        _ => Err(format!(
            "{keyword} is {rest:?}, expected 1 or {count} numbers"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Texels take memory once, however many materials name their file.
    #[test]
    fn a_file_of_texels_is_one_texture() {
        let files = ["wood.png", "./wood.png", "stone.png"];
        let mtl = files.map(|file| format!("newmtl {file}\nmap_Kd {file}\n"));
        let mut found = MtlText::default();
        let (folder, limits) = (Path::new("folder"), LoadLimits::default());
        let notes = &mut Notes::default();
        let added = found.add_file(
            Path::new("folder/a.mtl"),
            folder,
            &mtl.concat(),
            &limits,
            notes,
        );
        assert!(added.is_ok());
        assert_eq!(found.textures.len(), 2);
        assert_eq!(found.text.matches("map_Kd 0").count(), 2);
    }
}
