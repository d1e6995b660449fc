//! Materials as MTL text, their textures as images.

use std::collections::{HashMap, HashSet};
use std::fmt::Write as _;
use std::path::Path;

use burn::tensor::DType;

use super::HostImage;
use super::whole::Part;
use crate::error::Result;
use crate::scene::{ColorTexture, Material, Parameter, Wrap};
use softray_kernels::warning;

/// Characters of a material's name in a file's name.
const NAME_IN_FILE: usize = 48;

/// Materials of an OBJ file to come.
pub(super) struct Library<'a> {
    /// The OBJ file.
    path: &'a Path,
    /// The start of the names of all files.
    stem: String,
    text: String,
    names: Names,
    /// Names of materials in the file, by their own names and their descriptions.
    known: HashMap<(String, String), String>,
    file_names: Names,
    /// The textures, each once, with the names of their files.
    textures: Vec<(HostImage, String)>,
}

impl<'a> Library<'a> {
    pub fn new(path: &'a Path) -> Self {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let mut stem = in_line(&stem, "scene");
        if stem.starts_with('-') {
            // A texture's name may not look like an option.
            stem.replace_range(..1, "_");
        }
        Self {
            path,
            stem,
            text: String::new(),
            names: Names::default(),
            known: HashMap::new(),
            file_names: Names::default(),
            textures: Vec::new(),
        }
    }

    /// The MTL file's name.
    pub fn file_name(&self) -> String {
        format!("{}.mtl", self.stem)
    }

    /// The name of a material in the file. The first call for a material adds its description.
    pub fn name_of(&mut self, material: &Material, object: &str) -> Result<String> {
        let wanted = in_line(&material.name, "material");
        let body = self.describe(material, &wanted, object)?;
        let key = (wanted, body);
        if let Some(name) = self.known.get(&key) {
            return Ok(name.clone());
        }
        let name = self.names.unique(key.0.clone());
        // Writing to a string does not fail.
        let _ = writeln!(self.text, "\nnewmtl {name}\n{}", key.1.trim_end());
        self.known.insert(key, name.clone());
        Ok(name)
    }

    /// The lines of a material below its name.
    fn describe(&mut self, material: &Material, name: &str, object: &str) -> Result<String> {
        let object = format!("{object}, material {}", material.name);
        let (black, one) = (ColorTexture::from([0.0; 3]), Parameter::Constant([1.0]));
        let lobe = material.bsdf.lobe();
        let (specular, shininess) = lobe.unwrap_or((&black, &one));
        let diffuse = material.bsdf.base().unwrap_or(&black);
        let diffuse = self.albedo(diffuse, [&object, name, "diffuse"])?;
        let specular = self.albedo(specular, [&object, name, "specular"])?;
        warn_of_range(&object, &diffuse, &specular);
        let mut body = format!(
            "Kd {}\nKs {}\nNs {}\n",
            diffuse.factor,
            specular.factor,
            numbers(shininess)?,
        );
        let emission = self.albedo(&material.emission, [&object, name, "emission"])?;
        if emission.values != [0.0; 3] {
            body += &format!("Ke {}\n", emission.factor);
        }
        let illumination = if lobe.is_some() { 2 } else { 1 };
        body += &format!("illum {illumination}\n");
        for (keyword, albedo) in [
            ("map_Kd", &diffuse),
            ("map_Ks", &specular),
            ("map_Ke", &emission),
        ] {
            if let Some(texture) = &albedo.texture {
                body += &format!("{keyword} {texture}\n");
            }
        }
        Ok(body)
    }

    fn albedo(
        &mut self,
        albedo: &ColorTexture,
        [object, material, field]: [&str; 3],
    ) -> Result<Described> {
        let (texels, wrap) = match albedo {
            ColorTexture::Constant(p) => {
                return Ok(Described {
                    values: p.values()?,
                    factor: numbers(p)?,
                    texture: None,
                });
            }
            ColorTexture::Texture { texels, wrap } => (HostImage::from_tensor(texels)?, *wrap),
        };
        if wrap == Wrap::Mirror {
            warning!(
                "{object}: MTL has no mirrored textures, {field} is written as one that repeats"
            );
        }
        let known = self.textures.iter().find(|(image, _)| *image == texels);
        let file = match known {
            Some((_, file)) => file.clone(),
            None => {
                let of_file = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
                let name: String = material.chars().take(NAME_IN_FILE).map(of_file).collect();
                // Some systems don't tell cases of letters apart.
                let name = format!("{}_{}_{field}", self.stem, name.to_ascii_lowercase());
                let name = self.file_names.unique(name);
                let ending = if texels.fits_srgb() { "png" } else { "exr" };
                let file = format!("{name}.{ending}");
                self.textures.push((texels, file.clone()));
                file
            }
        };
        let option = if wrap == Wrap::Clamp {
            "-clamp on "
        } else {
            ""
        };
        Ok(Described {
            values: [0.0; 3],
            factor: "1 1 1".into(),
            texture: Some(format!("{option}{file}")),
        })
    }

    /// Writes the textures and the MTL file, all to be published.
    pub fn write(self) -> Result<Vec<Part>> {
        let mut parts = Vec::with_capacity(self.textures.len() + 1);
        for (image, file) in &self.textures {
            let path = self.path.with_file_name(file);
            parts.push(Part::write(&path, |f| image.encode(&path, f, None))?);
        }
        let path = self.path.with_file_name(self.file_name());
        parts.push(Part::of(&path, &[b"# softray\n", self.text.as_bytes()])?);
        if !self.names.renamed.is_empty() {
            log::info!("materials of {}: {}", path.display(), self.names.message());
        }
        Ok(parts)
    }
}

/// An albedo as MTL has it.
struct Described {
    /// The values of a constant, 0 for a texture.
    values: [f64; 3],
    /// `Kd` or `Ks`: a texture is multiplied by it, so it is 1 beside one.
    factor: String,
    /// `map_Kd` or `map_Ks`.
    texture: Option<String>,
}

/// Warns of values of tensors that are out of range, which a file holds but can't be rendered from.
fn warn_of_range(object: &str, diffuse: &Described, specular: &Described) {
    let (d, s) = (diffuse.values, specular.values);
    let outside = |i: usize| d[i] < 0.0 || s[i] < 0.0 || d[i] + s[i] > 1.0 + 1e-6;
    if (0..3).any(outside) {
        warning!(
            "{object}: diffuse is {d:?} and specular {s:?}; they are written, but can't be rendered \
             as constants, which are ≥ 0 with a sum of at most 1"
        );
    }
}

/// Text that reads back to the same number, by way of `f64` where the value is of less precision.
pub(super) fn number(value: f64, dtype: Option<DType>) -> String {
    let double = || format!("{value:?}");
    if dtype.is_none_or(|d| d == DType::F64) {
        return double();
    }
    let single = value as f32;
    let short = format!("{single:?}");
    match short.parse::<f64>() {
        Ok(read) if read as f32 == single => short,
        _ => double(),
    }
}

fn numbers<const C: usize>(parameter: &Parameter<C>) -> Result<String> {
    let dtype = match parameter {
        Parameter::Constant(_) => None,
        Parameter::Tensor(t) => Some(t.dtype()),
    };
    Ok(parameter.values()?.map(|v| number(v, dtype)).join(" "))
}

/// A name that is the rest of a line as OBJ readers take it: no line breaks, comments,
/// or continuation.
pub(super) fn in_line(name: &str, empty: &str) -> String {
    let fit = |c: char| match c {
        c if c.is_whitespace() => ' ',
        '#' => '_',
        c if c.is_control() => '_',
        c => c,
    };
    let mut name: String = name.trim().chars().map(fit).collect();
    if name.ends_with('\\') {
        name.pop();
        name.push('_');
    }
    if name.is_empty() { empty.into() } else { name }
}

/// A set of unique names.
#[derive(Default)]
pub(super) struct Names {
    used: HashSet<String>,
    /// The next number to try, by name.
    next: HashMap<String, usize>,
    /// The wanted and the given names, where they differ.
    pub renamed: Vec<(String, String)>,
}

impl Names {
    /// Returns the name, with a number if it is taken.
    pub fn unique(&mut self, wanted: String) -> String {
        if self.used.insert(wanted.clone()) {
            return wanted;
        }
        let next = self.next.entry(wanted.clone()).or_insert(2);
        let name = loop {
            let name = format!("{wanted}_{next}");
            *next += 1;
            if self.used.insert(name.clone()) {
                break name;
            }
        };
        self.renamed.push((wanted, name.clone()));
        name
    }

    /// A text that lists some of the names that were changed.
    pub fn message(&self) -> String {
        let some = self.renamed.iter().take(5);
        let some: Vec<String> = some.map(|(a, b)| format!("{a:?} is {b:?}")).collect();
        let rest = self.renamed.len().saturating_sub(some.len());
        let more = match rest {
            0 => String::new(),
            rest => format!(", and {rest} more"),
        };
        format!("names were taken, so {}{more}", some.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_of_one_line_and_unique() {
        assert_eq!(in_line(" left\twall ", "x"), "left wall");
        assert_eq!(in_line("a\n#b\\", "x"), "a _b_");
        assert_eq!(in_line(" \n", "x"), "x");
        let mut names = Names::default();
        let mut next = |name: &str| names.unique(name.into());
        assert_eq!(next("a"), "a");
        assert_eq!(next("a_2"), "a_2");
        assert_eq!(next("a"), "a_3");
        assert_eq!(next("a"), "a_4");
        let message = names.message();
        assert!(message.contains(r#""a" is "a_3""#), "{message}");
    }

    #[test]
    fn numbers_read_back() {
        for value in [
            0.1f32,
            -1.0 / 3.0,
            1e-38,
            3e38,
            16_777_217.0,
            f32::MIN_POSITIVE,
        ] {
            let text = number(f64::from(value), Some(DType::F32));
            let read = text.parse::<f64>().expect("a number") as f32;
            assert_eq!(read.to_bits(), value.to_bits(), "{text}");
        }
        assert_eq!(number(f64::from(0.1f32), Some(DType::F32)), "0.1");
        for value in [0.1f64, -1.0 / 3.0, 1e-300] {
            let read = number(value, Some(DType::F64)).parse::<f64>();
            assert_eq!(read.expect("a number").to_bits(), value.to_bits());
        }
    }
}
