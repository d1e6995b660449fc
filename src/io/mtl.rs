//! MTL files, read: their materials, and the words of statements that OBJ files share with them.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use burn::tensor::{Device, Tensor, TensorData};

use super::limits::read_text;
use super::{HostImage, LoadLimits};
use crate::error::{Error, Result};
use crate::scene::{Albedo, Material, Wrap};

/// Entries of MTL files that would change a render and are not read.
const UNREAD: [&str; 21] = [
    "d", "Tr", "Tf", "Ni", "Pr", "Pm", "Ps", "Pc", "aniso", "map_Ka", "map_Ns", "map_Ke", "map_d",
    "map_Bump", "map_bump", "bump", "disp", "norm", "map_Pr", "map_Pm", "refl",
];

/// A material as files have it.
#[derive(Clone, Default)]
struct Described {
    /// `Kd`, `Ks`, `Ke` and `Ns`.
    diffuse: Option<[f64; 3]>,
    specular: Option<[f64; 3]>,
    emission: Option<[f64; 3]>,
    shininess: Option<[f64; 1]>,
    /// `map_Kd` and `map_Ks`.
    diffuse_map: Option<(PathBuf, Wrap)>,
    specular_map: Option<(PathBuf, Wrap)>,
}

/// The materials of an OBJ file, made when first used: objects share textures, and unused ones aren't read.
pub(super) struct Materials<'a> {
    /// The OBJ file's folder.
    folder: &'a Path,
    limits: &'a LoadLimits,
    device: &'a Device,
    described: HashMap<String, Described>,
    made: HashMap<String, Material>,
    /// Textures by their files, each once.
    textures: HashMap<PathBuf, Tensor<3>>,
}

impl<'a> Materials<'a> {
    pub fn new(folder: &'a Path, limits: &'a LoadLimits, device: &'a Device) -> Self {
        Self {
            folder,
            limits,
            device,
            described: HashMap::new(),
            made: HashMap::new(),
            textures: HashMap::new(),
        }
    }

    pub fn has(&self, name: &str) -> bool {
        self.described.contains_key(name)
    }

    /// Reads the files of an `mtllib` statement, which stands at `from`.
    pub fn read(&mut self, names: &str, from: &str) -> Result<()> {
        for file in libraries(self.folder, names) {
            self.limits.check_place(&file, self.folder, from)?;
            let text = read_text(&file, self.limits).map_err(|e| {
                let message = format!("it can't be read (named by {from}): {e}");
                Error::format(&file, message)
            })?;
            self.add(&file, &text)?;
        }
        Ok(())
    }

    /// Adds the materials of a file.
    fn add(&mut self, path: &Path, text: &str) -> Result<()> {
        let mut name = None;
        // What would change the picture and is not read, told once.
        let mut unread: Vec<&str> = Vec::new();
        for (i, line) in text.lines().enumerate() {
            let fail = |message: String| Error::format(path, format!("line {}: {message}", i + 1));
            let (keyword, rest) = keyword(line);
            match keyword {
                "newmtl" if rest.is_empty() => return Err(fail("newmtl has no name".into())),
                "newmtl" => {
                    name = Some(rest);
                    self.described.insert(rest.into(), Described::default());
                }
                "Kd" | "Ks" | "Ke" | "Ns" | "map_Kd" | "map_Ks" => {
                    let map = match keyword.starts_with("map") {
                        true => Some(self.map(path, i + 1, keyword, rest)?),
                        false => None,
                    };
                    let Some(material) = name.and_then(|n| self.described.get_mut(n)) else {
                        return Err(fail(format!("{keyword} comes before any newmtl")));
                    };
                    match keyword {
                        "Kd" => material.diffuse = Some(numbers(keyword, rest).map_err(fail)?),
                        "Ks" => material.specular = Some(numbers(keyword, rest).map_err(fail)?),
                        "Ke" => material.emission = Some(numbers(keyword, rest).map_err(fail)?),
                        "Ns" => material.shininess = Some(numbers(keyword, rest).map_err(fail)?),
                        "map_Kd" => material.diffuse_map = map,
                        _ => material.specular_map = map,
                    }
                }
                other if UNREAD.contains(&other) && !unread.contains(&other) => unread.push(other),
                _ => {}
            }
        }
        if !unread.is_empty() {
            let list = unread.join(", ");
            log::warn!("{}: these entries are not read: {list}", path.display());
        }
        Ok(())
    }

    /// The file of a texture that a line names, and how it continues.
    fn map(&self, path: &Path, line: usize, keyword: &str, rest: &str) -> Result<(PathBuf, Wrap)> {
        let from = format!("{}, line {line}", path.display());
        let (name, options) = texture_name(rest);
        if name.is_empty() {
            let message = format!("line {line}: {keyword} names no file");
            return Err(Error::format(path, message));
        }
        if options.iter().any(|o| o[0] != "-clamp") {
            log::warn!("{from}: of the options of {keyword} {rest} only -clamp is read");
        }
        let own = path.parent().unwrap_or(self.folder);
        let file = resolve(&[own, self.folder], name);
        self.limits.check_place(&file, self.folder, &from)?;
        match options.contains(&["-clamp", "on"]) {
            true => Ok((file, Wrap::Clamp)),
            false => Ok((file, Wrap::Repeat)),
        }
    }

    /// The material of a name for an object, which has texture coordinates or not.
    pub fn get(&mut self, name: Option<&str>, object: &str, uvs: bool) -> Result<Material> {
        let Some(name) = name else {
            return Ok(Material::default().named("default"));
        };
        let made = match self.made.get(name) {
            Some(made) => made.clone(),
            None => {
                let made = self.make(name)?;
                self.made.insert(name.into(), made.clone());
                made
            }
        };
        let textured = |a: &Albedo| matches!(a, Albedo::Texture { .. });
        if uvs || !(textured(&made.diffuse) || textured(&made.specular)) {
            return Ok(made);
        }
        log::warn!(
            "{object}: material {name} has a texture, but not all corners have coordinates: taking its \
             colour"
        );
        Ok(self.plain(name).0)
    }

    /// A material without its textures, and its description.
    fn plain(&self, name: &str) -> (Material, Described) {
        let described = self.described.get(name).cloned().unwrap_or_default();
        let mut material = Material::default().named(name);
        if let Some(kd) = described.diffuse {
            material.diffuse = kd.into();
        }
        if let Some(ks) = described.specular {
            material.specular = ks.into();
        }
        if let Some(ke) = described.emission {
            material.emission = ke.into();
        }
        if let Some(ns) = described.shininess {
            material.shininess = ns.into();
        }
        (material, described)
    }

    fn make(&mut self, name: &str) -> Result<Material> {
        let (mut material, described) = self.plain(name);
        if let Some((file, wrap)) = described.diffuse_map {
            let texels = self.texture(file)?;
            material.diffuse = Albedo::Texture { texels, wrap };
            if described.diffuse.is_some_and(|kd| kd != [1.0; 3]) {
                log::info!("material {name}: map_Kd replaces Kd");
            }
        }
        // Where `Ks` is black, the map is multiplied by it.
        if let Some((file, wrap)) = described.specular_map
            && described.specular != Some([0.0; 3])
        {
            let mut texels = self.texture(file)?;
            if let Some(ks) = described.specular.filter(|ks| *ks != [1.0; 3]) {
                let ks = Tensor::<1>::from_data(TensorData::from(ks), self.device);
                texels = texels * ks.reshape([1, 1, 3]);
            }
            material.specular = Albedo::Texture { texels, wrap };
        }
        Ok(material)
    }

    fn texture(&mut self, file: PathBuf) -> Result<Tensor<3>> {
        if let Some(texels) = self.textures.get(&file) {
            return Ok(texels.clone());
        }
        let texels = HostImage::read_within(&file, self.limits)?.into_tensor(self.device);
        self.textures.insert(file, texels.clone());
        Ok(texels)
    }
}

/// The values of a statement, of which one stands for all channels.
fn numbers<const C: usize>(keyword: &str, rest: &str) -> Result<[f64; C], String> {
    let words: Vec<&str> = words(rest).collect();
    let numbers = words.iter().map_while(|w| w.parse().ok());
    let numbers: Vec<f64> = numbers.take(C).collect();
    match (&numbers[..], words.len()) {
        (&[one], 1) => Ok([one; C]),
        (all, _) => all
            .try_into()
            .map_err(|_| format!("{keyword} is {rest:?}, expected 1 or {C} numbers")),
    }
}

/// The first word of a line and the rest, trimmed.
pub(super) fn keyword(line: &str) -> (&str, &str) {
    let line = line.trim();
    let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
    (keyword, rest.trim())
}

/// The words before a comment.
pub(super) fn words(rest: &str) -> impl Iterator<Item = &str> {
    rest.split_whitespace().take_while(|w| !w.starts_with('#'))
}

/// The files of an `mtllib` line: one name that may have spaces, or several names.
fn libraries(folder: &Path, rest: &str) -> Vec<PathBuf> {
    let whole = resolve(&[folder], rest);
    if whole.is_file() || rest.split_whitespace().count() < 2 {
        return vec![whole];
    }
    let names = rest.split_whitespace();
    names.map(|name| resolve(&[folder], name)).collect()
}

/// The file of that name in the first folder that has it, else what it would be in the first one.
fn resolve(folders: &[&Path], name: &str) -> PathBuf {
    // Windows exporters write backslashes.
    let slashed = name.replace('\\', "/");
    let mut candidates = folders
        .iter()
        .flat_map(|f| [f.join(name), f.join(&slashed)]);
    let first = candidates.clone().next().unwrap_or_else(|| name.into());
    candidates.find(|c| c.is_file()).unwrap_or(first)
}

/// The file name of a texture statement after its options, like `-s 2 2 1 -clamp on wood.png`, and
/// the options with their first words.
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

    #[test]
    fn options_of_textures() {
        assert_eq!(texture_name("oak wood.png"), ("oak wood.png", Vec::new()));
        let (name, options) = texture_name("-s 2 2 1 -clamp on -bm 1 oak wood.png");
        assert_eq!(name, "oak wood.png");
        assert_eq!(options, [["-s", "2"], ["-clamp", "on"], ["-bm", "1"]]);
    }
}
