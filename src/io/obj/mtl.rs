//! Reads MTL files. tobj parses their materials.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::rc::Rc;

use crate::error::{Error, Result};
use crate::io::description::{Color, ExtraBsdf, ImageSource, MaterialDescription, TextureUse};
use crate::io::files::Files;
use crate::io::notes::Notes;
use crate::scene::Wrap;
use softray_kernels::warning;

/// Entries that would change a render but are not read.
const UNREAD: [&str; 20] = [
    "d", "Tr", "Tf", "Ni", "Pr", "Pm", "Ps", "Pc", "aniso", "map_Ka", "map_Ns", "map_d",
    "map_Bump", "map_bump", "bump", "disp", "norm", "map_Pr", "map_Pm", "refl",
];

const UNKNOWN: &str = "no file defines these materials, which are gray";
const CLAMPED: &str = "Kd or Ks of these materials is outside of [0, 1] and limited to it";
const UNTEXTURED: &str = "these materials have a texture on objects without coordinates at all corners, where their \
                          color counts";

/// The materials from the MTL files of an OBJ file.
pub(super) struct Library<'a> {
    /// The folder of the OBJ file.
    folder: &'a Path,
    files: Files<'a>,
    notes: &'a Notes,
    /// Materials by name, each with its file. The last material of a name is used.
    materials: HashMap<String, (Rc<tobj::Material>, Rc<Path>)>,
    /// The files that were read, and the sum of their sizes.
    read: HashSet<PathBuf>,
    pub bytes: u64,
    /// Descriptions of materials, with or without textures, and the images of the textures without duplicates.
    pub described: Vec<MaterialDescription>,
    numbers: HashMap<(String, bool), usize>,
    pub images: Vec<ImageSource>,
    image_numbers: HashMap<PathBuf, usize>,
}

impl<'a> Library<'a> {
    pub fn new(folder: &'a Path, files: Files<'a>, notes: &'a Notes) -> Self {
        Self {
            folder,
            files,
            notes,
            materials: HashMap::new(),
            read: HashSet::new(),
            bytes: 0,
            described: Vec::new(),
            numbers: HashMap::new(),
            images: Vec::new(),
            image_numbers: HashMap::new(),
        }
    }

    /// Adds the files of an `mtllib` statement: one name that may have spaces, or several names. `from` is the place
    /// of the statement, for messages.
    pub fn add(&mut self, statement: &str, from: &str) -> Result<()> {
        let whole = self.resolve(&[self.folder], statement);
        let is_one =
            self.files.has(&whole, self.folder) || statement.split_whitespace().count() < 2;
        let files = match is_one {
            true => vec![whole],
            false => {
                let names = statement.split_whitespace();
                names
                    .map(|name| self.resolve(&[self.folder], name))
                    .collect()
            }
        };
        for file in files {
            self.files.check_place(&file, self.folder, from)?;
            let key = self.files.key(&file);
            if !self.read.insert(key) {
                continue;
            }
            match self.files.read_text(&file) {
                Ok(text) => self.parse(&file, &text)?,
                Err(error) => {
                    self.notes.fault(error.named_by(from), &self.files)?;
                }
            }
        }
        Ok(())
    }

    fn parse(&mut self, path: &Path, text: &str) -> Result<()> {
        self.bytes += text.len() as u64;
        let (mut sound, mut named) = (String::new(), false);
        // Entries that are not read, each listed once.
        let mut unread: Vec<&str> = Vec::new();
        for (i, line) in text.lines().enumerate() {
            let (keyword, rest) = keyword(line);
            if UNREAD.contains(&keyword) && !unread.contains(&keyword) {
                unread.push(keyword);
            }
            match statement(keyword, rest, &mut named) {
                Ok(statement) => sound += &statement,
                Err(message) => {
                    let error = Error::format(path, format!("line {}: {message}", i + 1));
                    self.notes.fault(error, &self.files)?;
                }
            }
        }
        if !unread.is_empty() {
            let list = unread.join(", ");
            warning!(
                "{}: these entries are not read: {list}. Metal and glass come from glTF, or from the materials of a \
                 scene.json",
                path.display()
            );
        }
        let parsed = tobj::load_mtl_buf(&mut sound.as_bytes());
        let (materials, _) = parsed.map_err(|e| Error::format(path, format!("materials: {e}")))?;
        let file: Rc<Path> = path.into();
        let named = |m: tobj::Material| (m.name.clone(), (Rc::new(m), file.clone()));
        self.materials.extend(materials.into_iter().map(named));
        Ok(())
    }

    /// Returns the index of a material's description, with its textures or with plain colors instead. `plain` is the
    /// diffuse color of a material that has none.
    pub fn describe(&mut self, name: &str, textured: bool, plain: [f64; 3]) -> Result<usize> {
        let key = (name.to_owned(), textured);
        if let Some(&known) = self.numbers.get(&key) {
            return Ok(known);
        }
        let found = self.materials.get(name).cloned();
        if found.is_none() && !name.is_empty() {
            self.notes.add(UNKNOWN, name);
        }
        let (material, file) = found.unwrap_or_else(|| (Rc::default(), self.folder.into()));
        let maps = [
            material.diffuse_texture.as_ref(),
            material.specular_texture.as_ref(),
            material.unknown_param.get("map_Ke"),
        ];
        if !textured && maps.iter().any(Option::is_some) {
            self.notes.add(UNTEXTURED, name);
        }
        let [map_kd, map_ks, map_ke] = maps.map(|map| {
            let texture = map.map(|map| self.texture(map, &file, name)).transpose();
            Ok(texture?.filter(|_| textured))
        });
        let [kd, ks] = [material.diffuse, material.specular].map(|c| self.share(c, name));
        // For a material without highlights or with an exponent of 0, exporters write a Ks that has no meaning.
        let shines = material.illumination_model.is_none_or(|model| model >= 2)
            && material.shininess.is_none_or(|n| n > 0.0);
        let times = |factor: Option<[f64; 3]>, texture: Option<TextureUse>| Color {
            plain: factor.unwrap_or([0.0; 3]),
            texture: texture.map(|texture| (texture, factor.unwrap_or([1.0; 3]))),
        };
        let gloss = times(ks, map_ks?);
        self.described.push(MaterialDescription {
            name: if name.is_empty() { "default" } else { name }.into(),
            base_color: Color {
                plain: kd.unwrap_or(plain),
                texture: map_kd?.map(|texture| (texture, [1.0; 3])),
            },
            extra_bsdf: Some(ExtraBsdf::Phong {
                albedo: if shines { gloss } else { times(None, None) },
                shininess: material.shininess.filter(|&n| n > 0.0).unwrap_or(1.0),
            }),
            emission: times(material.emissive, map_ke?),
            ..MaterialDescription::diffuse()
        });
        let number = self.described.len() - 1;
        self.numbers.insert(key, number);
        Ok(number)
    }

    /// Clamps a color to [0, 1], with a warning.
    fn share(&self, color: Option<[f64; 3]>, name: &str) -> Option<[f64; 3]> {
        let limited = color.map(|c| c.map(|v| v.clamp(0.0, 1.0)));
        if limited != color {
            self.notes.add(CLAMPED, name);
        }
        limited
    }

    /// Returns the texture of a statement.
    fn texture(&mut self, statement: &str, file: &Path, material: &str) -> Result<TextureUse> {
        let from = || format!("{}, material {material}", file.display());
        let (name, options) = texture_name(statement);
        if options.iter().any(|o| o[0] != "-clamp") {
            let sentence = "of the options of textures only -clamp is read";
            self.notes.add(sentence, from());
        }
        let own = file.parent().unwrap_or(self.folder);
        let path = self.resolve(&[own, self.folder], name);
        self.files.check_place(&path, self.folder, &from())?;
        let next = self.images.len();
        let image = *self.image_numbers.entry(path).or_insert_with_key(|path| {
            let (path, named_by) = (path.clone(), from());
            self.images.push(ImageSource::File { path, named_by });
            next
        });
        let wrap = match options.contains(&["-clamp", "on"]) {
            true => Wrap::Clamp,
            false => Wrap::Repeat,
        };
        Ok(TextureUse { image, wrap })
    }

    /// Returns the file in the first folder that has it, or its path in the first folder.
    fn resolve(&self, folders: &[&Path], name: &str) -> PathBuf {
        // Windows exporters write backslashes.
        let slashed = name.replace('\\', "/");
        let mut candidates = folders
            .iter()
            .flat_map(|f| [f.join(name), f.join(&slashed)]);
        let first = candidates.clone().next().unwrap_or_else(|| name.into());
        candidates
            .find(|c| self.files.has(c, self.folder))
            .unwrap_or(first)
    }
}

/// Returns a statement in a form that tobj accepts, or an error message. tobj itself panics on `Kd` with fewer than 3
/// numbers and stops at the first error. One number counts for all three channels. `named` is whether a material has
/// begun.
fn statement(keyword: &str, rest: &str, named: &mut bool) -> std::result::Result<String, String> {
    let words: Vec<&str> = words(rest);
    let numbers = |count: usize| {
        let finite = |v: &&str| v.parse::<f64>().is_ok_and(f64::is_finite);
        let values = match words.len() {
            1 => vec![words[0]; count],
            _ => words.iter().take(count).copied().collect(),
        };
        match values.len() == count && values.iter().all(finite) {
            true => Ok(values.join(" ")),
            false => Err(format!(
                "{keyword} is {rest:?}, expected 1 or {count} numbers"
            )),
        }
    };
    let values = match keyword {
        "newmtl" => {
            *named = !rest.is_empty();
            match named {
                true => rest.into(),
                false => return Err("newmtl has no name".into()),
            }
        }
        "Kd" | "Ks" | "Ke" | "Ns" | "illum" | "map_Kd" | "map_Ks" | "map_Ke" if !*named => {
            return Err(format!("{keyword} comes before any newmtl"));
        }
        "Kd" | "Ks" | "Ke" => numbers(3)?,
        "Ns" => numbers(1)?,
        "illum" if words.first().is_none_or(|w| w.parse::<u8>().is_err()) => {
            return Err(format!("illum is {rest:?}, expected a number from 0 to 10"));
        }
        "map_Kd" | "map_Ks" | "map_Ke" if texture_name(rest).0.is_empty() => {
            return Err(format!("{keyword} names no file"));
        }
        "illum" | "map_Kd" | "map_Ks" | "map_Ke" => rest.into(),
        _ => return Ok(String::new()),
    };
    Ok(format!("{keyword} {values}\n"))
}

/// Returns the first word of a line, and the rest, trimmed.
pub(super) fn keyword(line: &str) -> (&str, &str) {
    let line = line.trim();
    let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
    (keyword, rest.trim())
}

/// Returns the words before a comment.
pub(super) fn words(rest: &str) -> Vec<&str> {
    let words = rest.split_whitespace();
    words.take_while(|w| !w.starts_with('#')).collect()
}

/// Returns the file name of a texture statement such as `-s 2 2 1 -clamp on wood.png`, and the options with their
/// first words.
fn texture_name(mut rest: &str) -> (&str, Vec<[&str; 2]>) {
    let mut options = Vec::new();
    while rest.starts_with('-') {
        let (option, mut after) = keyword(rest);
        options.push([option, keyword(after).0]);
        let (least, most) = match option {
            "-o" | "-s" | "-t" => (1, 3),
            "-mm" => (2, 2),
            _ => (1, 1),
        };
        for i in 0..most {
            let (word, next) = keyword(after);
            if i >= least && word.parse::<f64>().is_err() {
                break;
            }
            after = next;
        }
        rest = after;
    }
    (rest, options)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::LoadLimits;

    #[test]
    fn options_of_textures() {
        assert_eq!(texture_name("oak wood.png"), ("oak wood.png", Vec::new()));
        let (name, options) = texture_name("-s 2 2 1 -clamp on -bm 1 oak wood.png");
        assert_eq!(name, "oak wood.png");
        assert_eq!(options, [["-s", "2"], ["-clamp", "on"], ["-bm", "1"]]);
    }

    /// An image file takes memory once, however many materials use it.
    #[test]
    fn a_file_of_texels_is_one_texture() {
        let files = ["wood.png", "./wood.png", "stone.png"];
        let mtl = files.map(|file| format!("newmtl {file}\nmap_Kd {file}\n"));
        let (limits, notes) = (LoadLimits::default(), Notes::default());
        let mut library = Library::new(Path::new("folder"), Files::of_system(&limits), &notes);
        let parsed = library.parse(Path::new("folder/a.mtl"), &mtl.concat());
        assert!(parsed.is_ok());
        let image = |name: &&str| {
            let number = library.describe(name, true, [0.5; 3]);
            let material = &library.described[number.expect("a material")];
            material.base_color.texture.expect("a texture").0.image
        };
        assert_eq!(files.each_ref().map(image), [0, 0, 1]);
        assert_eq!(library.images.len(), 2);
    }
}
