//! Materials of glTF files to come, their textures as PNG images.

use std::collections::BTreeSet;
use std::io::Cursor;
use std::path::Path;

use image::{ImageBuffer, ImageFormat, Rgb, RgbImage};
use serde_json::{Value, json};

use super::HostImage;
use super::srgb::srgb_word;
use crate::error::{Error, Result};
use crate::scene::{Albedo, Material, Wrap};

/// The lists of a file that its materials are in.
pub(super) struct Materials<'a> {
    path: &'a Path,
    pub described: Vec<Value>,
    pub textures: Vec<Value>,
    pub samplers: Vec<Value>,
    pub extensions: BTreeSet<&'static str>,
    /// The images, each once.
    images: Vec<HostImage>,
}

impl<'a> Materials<'a> {
    pub fn new(path: &'a Path) -> Self {
        Self {
            path,
            described: Vec::new(),
            textures: Vec::new(),
            samplers: Vec::new(),
            extensions: BTreeSet::new(),
            images: Vec::new(),
        }
    }

    /// The number of a material in the file.
    pub fn number(&mut self, material: &Material, object: &str) -> Result<usize> {
        let described = self.describe(material, object)?;
        Ok(position(&mut self.described, described))
    }

    fn describe(&mut self, material: &Material, object: &str) -> Result<Value> {
        let place = format!("{object}, material {}", material.name);
        let (factor, texture) = self.albedo(&material.diffuse, &place)?;
        let mut pbr = json!({"metallicFactor": 0});
        let [r, g, b] = factor;
        pbr["baseColorFactor"] = json!([r, g, b, 1.0]);
        if let Some(texture) = texture {
            pbr["baseColorTexture"] = json!({"index": texture});
        }
        let radiance = self.radiance(&material.emission, &place)?;
        let emits = radiance.most > 0.0;
        // Both sides reflect; what emits does so in front.
        let mut json = json!({"name": material.name, "doubleSided": !emits});
        let mut extensions = serde_json::Map::new();
        if material.specular.reflects() {
            let (factor, texture) = self.albedo(&material.specular, &place)?;
            let [shininess] = material.shininess.values()?;
            let mut phong = json!({"specularFactor": factor, "shininess": shininess});
            if let Some(texture) = texture {
                phong["specularTexture"] = json!({"index": texture});
            }
            json["extras"] = json!({"softray": phong});
            // The facets that spread a reflection as far.
            pbr["roughnessFactor"] = json!((2.0 / (shininess + 2.0)).powf(0.25));
        } else {
            let none = json!({"specularFactor": 0});
            extensions.insert("KHR_materials_specular".into(), none);
            self.extensions.insert("KHR_materials_specular");
        }
        if emits {
            json["emissiveFactor"] = json!(radiance.factor);
            if let Some(texture) = radiance.texture {
                json["emissiveTexture"] = json!({"index": texture});
            }
            if radiance.strength > 1.0 {
                let strength = json!({"emissiveStrength": radiance.strength});
                extensions.insert("KHR_materials_emissive_strength".into(), strength);
                self.extensions.insert("KHR_materials_emissive_strength");
            }
        }
        json["pbrMetallicRoughness"] = pbr;
        if !extensions.is_empty() {
            json["extensions"] = Value::Object(extensions);
        }
        Ok(json)
    }

    /// The radiance of an emitter, by a factor or a texture that are at most 1, and a strength.
    fn radiance(&mut self, emission: &Albedo, place: &str) -> Result<Radiance> {
        let values: Vec<f64> = match emission {
            Albedo::Constant(p) => p.values()?.to_vec(),
            Albedo::Texture { texels, .. } => {
                let image = HostImage::from_tensor(texels)?;
                image.pixels.iter().map(|&v| f64::from(v)).collect()
            }
        };
        if let Some(v) = values.iter().find(|&&v| v < 0.0) {
            let file = self.path.display();
            log::warn!("{file}: {place} emits {v}, of which no less than 0 is written");
        }
        let most = values.iter().copied().fold(0.0, f64::max);
        // A power of two leaves all digits as they are.
        let strength = most.max(1.0).log2().ceil().exp2();
        let (factor, texture) = match emission {
            Albedo::Constant(_) => {
                let factor: Vec<f64> = values.iter().map(|v| v.max(0.0) / strength).collect();
                (factor, None)
            }
            Albedo::Texture { texels, wrap } => {
                let texels = texels.clone().clamp_min(0.0) / strength;
                let scaled = Albedo::Texture {
                    texels,
                    wrap: *wrap,
                };
                (vec![1.0; 3], self.albedo(&scaled, place)?.1)
            }
        };
        Ok(Radiance {
            most,
            factor,
            texture,
            strength,
        })
    }

    /// The factor of an albedo, and its texture.
    fn albedo(&mut self, albedo: &Albedo, place: &str) -> Result<([f64; 3], Option<usize>)> {
        let file = self.path.display();
        let (texels, wrap) = match albedo {
            Albedo::Constant(p) => {
                let found = p.values()?;
                let factor = found.map(|v| v.clamp(0.0, 1.0));
                if factor != found {
                    log::warn!("{file}: {place} has the albedo {found:?}, written as {factor:?}");
                }
                return Ok((factor, None));
            }
            Albedo::Texture { texels, wrap } => (HostImage::from_tensor(texels)?, *wrap),
        };
        if texels.pixels.iter().any(|v| !(0.0..=1.0).contains(v)) {
            log::warn!("{file}: {place} has texels outside of [0, 1], which are clipped");
        }
        let known = self.images.iter().position(|image| *image == texels);
        let image = known.unwrap_or_else(|| {
            self.images.push(texels);
            self.images.len() - 1
        });
        let wrap = match wrap {
            Wrap::Repeat => 10497,
            Wrap::Clamp => 33071,
            Wrap::Mirror => 33648,
        };
        let sampler = position(&mut self.samplers, json!({"wrapS": wrap, "wrapT": wrap}));
        let texture = json!({"source": image, "sampler": sampler});
        Ok(([1.0; 3], Some(position(&mut self.textures, texture))))
    }

    /// The images as PNG files: 8 bits a channel where they hold all texels, else 16.
    pub fn images(&self) -> Result<Vec<Vec<u8>>> {
        let encode = |image: &HostImage| {
            let [w, h] = image.check_size()?;
            let mut bytes = Cursor::new(Vec::new());
            let written = match image.fits_srgb() {
                true => RgbImage::from_raw(w, h, image.to_srgb())
                    .map(|image| image.write_to(&mut bytes, ImageFormat::Png)),
                false => {
                    let words = image.pixels.iter().map(|&v| srgb_word(v)).collect();
                    ImageBuffer::<Rgb<u16>, Vec<u16>>::from_raw(w, h, words)
                        .map(|image| image.write_to(&mut bytes, ImageFormat::Png))
                }
            };
            let failed = |e| Error::format(self.path, format!("a texture can't be written: {e}"));
            written.transpose().map_err(failed)?;
            Ok(bytes.into_inner())
        };
        self.images.iter().map(encode).collect()
    }
}

/// What an emitter's radiance is written as.
struct Radiance {
    /// The largest of its numbers.
    most: f64,
    factor: Vec<f64>,
    texture: Option<usize>,
    strength: f64,
}

/// Where a value stands in a list, at whose end it is added if it is not there.
fn position(list: &mut Vec<Value>, value: Value) -> usize {
    let known = list.iter().position(|v| *v == value);
    known.unwrap_or_else(|| {
        list.push(value);
        list.len() - 1
    })
}
