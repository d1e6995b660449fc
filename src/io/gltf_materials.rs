//! Materials of glTF files to come, their textures as PNG images.

use std::collections::BTreeSet;
use std::fmt::Display;
use std::path::Path;

use serde_json::{Value, json};

use super::HostImage;
use super::gltf_images::{Picture, Texels};
use super::gltf_lights::scale_above;
use crate::error::Result;
use crate::geometry::host_values;
use crate::scene::{
    AlphaMask, Bsdf, ColorTexture, Material, NormalMap, Parameter, ScalarTexture, Wrap,
};
use softray_kernels::host::BsdfKind;
use softray_kernels::warning;

/// The lists of a file that its materials are in.
pub(super) struct Materials<'a> {
    path: &'a Path,
    pub described: Vec<Value>,
    pub textures: Vec<Value>,
    pub samplers: Vec<Value>,
    pub extensions: BTreeSet<&'static str>,
    /// The images, each once.
    pictures: Vec<Picture>,
}

impl<'a> Materials<'a> {
    pub fn new(path: &'a Path) -> Self {
        Self {
            path,
            described: Vec::new(),
            textures: Vec::new(),
            samplers: Vec::new(),
            extensions: BTreeSet::new(),
            pictures: Vec::new(),
        }
    }

    /// The number of a material in the file.
    pub fn number(&mut self, material: &Material, object: &str) -> Result<usize> {
        let described = self.describe(material, object)?;
        Ok(position(&mut self.described, described))
    }

    fn describe(&mut self, material: &Material, object: &str) -> Result<Value> {
        let place = format!("{object}, material {}", material.name);
        let kind = material.bsdf.kind();
        let mut json = match &material.bsdf {
            Bsdf::Phong { diffuse, .. } => {
                let json = self.base(diffuse, material, &place)?;
                self.phong(json, material.bsdf.lobe(), &place)?
            }
            Bsdf::MetallicRoughness {
                base_color,
                metallic,
                roughness,
                ..
            } => {
                let mut json = self.base(base_color, material, &place)?;
                self.facets(&mut json, (Some(metallic), roughness), &place)?;
                json
            }
            Bsdf::Conductor {
                eta,
                extinction,
                roughness,
                ..
            } => {
                let (eta, k) = (eta.values()?, extinction.values()?);
                let mut json = self.base(&reflectance(eta, k).into(), material, &place)?;
                self.facets(&mut json, (None, roughness), &place)?;
                json["pbrMetallicRoughness"]["metallicFactor"] = json!(1);
                json["extras"]["softray"]["conductor"] = json!({"eta": eta, "extinction": k});
                json
            }
            Bsdf::Dielectric {
                tint,
                ior,
                roughness,
                ..
            } => {
                let mut json = self.base(tint, material, &place)?;
                self.facets(&mut json, (None, roughness), &place)?;
                self.refraction(&mut json, ior, &place)?;
                json
            }
        };
        if kind != BsdfKind::Phong && !material.bsdf.is_compensated() {
            json["extras"]["softray"]["compensated"] = json!(false);
        }
        if let Some(map) = &material.normal_map {
            let texture = self.normals(map, &place)?;
            json["normalTexture"] = json!({"index": texture});
        }
        json["name"] = json!(material.name);
        self.emission(&mut json, &material.emission, &place)?;
        Ok(json)
    }

    /// Warns of a part. Each caller has warnings of its own kind.
    #[track_caller]
    fn warn(&self, place: &str, message: impl Display) {
        warning!("{}: {place} {message}", self.path.display());
    }

    fn extend(&mut self, json: &mut Value, name: &'static str, extension: Value) {
        json["extensions"][name] = extension;
        self.extensions.insert(name);
    }

    /// A material of a base color that is no metal, with the holes of another one.
    fn base(&mut self, albedo: &ColorTexture, material: &Material, place: &str) -> Result<Value> {
        let ([r, g, b], texels) = self.on_host(albedo, place)?;
        let mut json = json!({"pbrMetallicRoughness": {
            "baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0
        }});
        let texture = match &material.alpha_mask {
            Some(mask) => {
                let (alpha, cutoff) = shares(mask)?;
                json["alphaMode"] = json!("MASK");
                json["alphaCutoff"] = json!(cutoff);
                let [h, w, _] = alpha.size;
                let white = || Texels::full(1.0, [h, w, 3], alpha.wrap);
                let colors = texels.unwrap_or_else(white);
                let [colors, alpha] = Texels::together(colors, alpha, place);
                Some(self.texture(colors, true, Some(alpha.values), place)?)
            }
            None => match texels {
                Some(texels) => Some(self.texture(texels, true, None, place)?),
                None => None,
            },
        };
        if let Some(texture) = texture {
            json["pbrMetallicRoughness"]["baseColorTexture"] = json!({"index": texture});
        }
        Ok(json)
    }

    fn phong(
        &mut self,
        mut json: Value,
        lobe: Option<(&ColorTexture, &Parameter<1>)>,
        place: &str,
    ) -> Result<Value> {
        let Some((specular, shininess)) = lobe else {
            let none = json!({"specularFactor": 0});
            self.extend(&mut json, "KHR_materials_specular", none);
            return Ok(json);
        };
        let (factor, texture) = self.albedo(specular, place)?;
        let [shininess] = shininess.values()?;
        let mut phong = json!({"specularFactor": factor, "shininess": shininess});
        if let Some(texture) = texture {
            phong["specularTexture"] = json!({"index": texture});
        }
        json["extras"]["softray"]["phong"] = phong;
        // The facets that spread a reflection as far.
        let roughness = (2.0 / (shininess + 2.0)).powf(0.25);
        json["pbrMetallicRoughness"]["roughnessFactor"] = json!(roughness);
        Ok(json)
    }

    fn refraction(&mut self, json: &mut Value, ior: &ScalarTexture, place: &str) -> Result<()> {
        let ior = match Number::of(ior)? {
            Number::Constant(ior) => ior,
            Number::Texture(texels) => {
                self.warn(
                    place,
                    "has a texture of indices of refraction, written as its mean",
                );
                texels.mean()
            }
        };
        self.extend(json, "KHR_materials_ior", json!({"ior": ior}));
        let all = json!({"transmissionFactor": 1});
        self.extend(json, "KHR_materials_transmission", all);
        // Without a thickness it would not refract.
        let solid = json!({"thicknessFactor": 1});
        self.extend(json, "KHR_materials_volume", solid);
        Ok(())
    }

    /// The metal, if there may be some, and the roughness.
    fn facets(
        &mut self,
        json: &mut Value,
        (metallic, roughness): (Option<&ScalarTexture>, &ScalarTexture),
        place: &str,
    ) -> Result<()> {
        let metallic = metallic.map(Number::of).transpose()?;
        let pbr = &mut json["pbrMetallicRoughness"];
        let mut put = |number: Number, name: &str| match number {
            Number::Constant(v) => {
                pbr[name] = json!(self.share(v, name, place));
                None
            }
            Number::Texture(texels) => {
                pbr[name] = json!(1);
                Some(texels)
            }
        };
        let roughness = put(Number::of(roughness)?, "roughnessFactor");
        let metallic = metallic.and_then(|m| put(m, "metallicFactor"));
        let ones = |like: &Texels| Texels::full(1.0, like.size, like.wrap);
        let [roughness, metallic] = match (roughness, metallic) {
            (None, None) => return Ok(()),
            (Some(r), Some(m)) => Texels::together(r, m, place),
            (Some(r), None) => {
                let none = ones(&r);
                [r, none]
            }
            (None, Some(m)) => [ones(&m), m],
        };
        let pairs = roughness.values.iter().zip(&metallic.values);
        let [h, w, _] = roughness.size;
        let texels = Texels {
            values: pairs.flat_map(|(&r, &m)| [1.0, r, m]).collect(),
            size: [h, w, 3],
            wrap: roughness.wrap,
        };
        let texture = self.texture(texels, false, None, place)?;
        json["pbrMetallicRoughness"]["metallicRoughnessTexture"] = json!({"index": texture});
        Ok(())
    }

    /// The texture of a normal map: of normals only the directions count, which a common factor leaves.
    fn normals(&mut self, map: &NormalMap, place: &str) -> Result<usize> {
        let mut texels = Texels::of(&map.texels, map.wrap)?;
        let most = scale_above(texels.values.iter().map(|v| f64::from(v.abs()))) as f32;
        let encode = |v: &mut f32| *v = 0.5 + 0.5 * (*v / most);
        texels.values.iter_mut().for_each(encode);
        self.texture(texels, false, None, place)
    }

    /// A number that is clipped to [0, 1].
    fn share(&self, value: f64, name: &str, place: &str) -> f64 {
        let share = value.clamp(0.0, 1.0);
        if share != value {
            self.warn(place, format!("has {name} {value}, written as {share}"));
        }
        share
    }

    /// The radiance of an emitter, by a factor or a texture that are at most 1, and a strength. Both sides of a surface
    /// reflect; what emits does so in front.
    fn emission(&mut self, json: &mut Value, emission: &ColorTexture, place: &str) -> Result<()> {
        let values: Vec<f64> = match emission {
            ColorTexture::Constant(p) => p.values()?.to_vec(),
            ColorTexture::Texture { texels, .. } => host_values(texels)?,
        };
        if let Some(v) = values.iter().find(|&&v| v < 0.0) {
            self.warn(
                place,
                format!("emits {v}, of which no less than 0 is written"),
            );
        }
        let emits = values.iter().any(|&v| v > 0.0);
        json["doubleSided"] = json!(!emits);
        if !emits {
            return Ok(());
        }
        let strength = scale_above(values.iter().copied());
        match emission {
            ColorTexture::Constant(_) => {
                let factor: Vec<f64> = values.iter().map(|v| v.max(0.0) / strength).collect();
                json["emissiveFactor"] = json!(factor);
            }
            ColorTexture::Texture { texels, wrap } => {
                let texels = texels.clone().clamp_min(0.0) / strength;
                let texels = Texels::of(&texels, *wrap)?;
                json["emissiveFactor"] = json!([1.0, 1.0, 1.0]);
                let texture = self.texture(texels, true, None, place)?;
                json["emissiveTexture"] = json!({"index": texture});
            }
        }
        if strength > 1.0 {
            let strength = json!({"emissiveStrength": strength});
            self.extend(json, "KHR_materials_emissive_strength", strength);
        }
        Ok(())
    }

    /// The factor of an albedo, and its texture on the host.
    fn on_host(&self, albedo: &ColorTexture, place: &str) -> Result<([f64; 3], Option<Texels>)> {
        match albedo {
            ColorTexture::Constant(p) => {
                let found = p.values()?;
                let factor = found.map(|v| v.clamp(0.0, 1.0));
                if factor != found {
                    self.warn(
                        place,
                        format!("has the albedo {found:?}, written as {factor:?}"),
                    );
                }
                Ok((factor, None))
            }
            ColorTexture::Texture { texels, wrap } => {
                Ok(([1.0; 3], Some(Texels::of(texels, *wrap)?)))
            }
        }
    }

    /// The factor of an albedo, and its texture.
    fn albedo(&mut self, albedo: &ColorTexture, place: &str) -> Result<([f64; 3], Option<usize>)> {
        let (factor, texels) = self.on_host(albedo, place)?;
        let texture = texels.map(|texels| self.texture(texels, true, None, place));
        Ok((factor, texture.transpose()?))
    }

    /// The number of a texture in the file, of colors or other numbers.
    fn texture(
        &mut self,
        texels: Texels,
        colors: bool,
        alpha: Option<Vec<f32>>,
        place: &str,
    ) -> Result<usize> {
        let outside = |v: &f32| !(0.0..=1.0).contains(v);
        if texels.values.iter().any(outside) {
            self.warn(place, "has texels outside of [0, 1], which are clipped");
        }
        let ([h, w, _], wrap) = (texels.size, texels.wrap);
        let picture = Picture {
            texels: HostImage::new(w, h, texels.values)?,
            colors,
            alpha,
        };
        let known = self.pictures.iter().position(|known| *known == picture);
        let image = known.unwrap_or_else(|| {
            self.pictures.push(picture);
            self.pictures.len() - 1
        });
        let wrap = match wrap {
            Wrap::Repeat => 10497,
            Wrap::Clamp => 33071,
            Wrap::Mirror => 33648,
        };
        let sampler = position(&mut self.samplers, json!({"wrapS": wrap, "wrapT": wrap}));
        let texture = json!({"source": image, "sampler": sampler});
        Ok(position(&mut self.textures, texture))
    }

    /// The images as PNG files.
    pub fn images(&self) -> Result<Vec<Vec<u8>>> {
        self.pictures.iter().map(|p| p.png(self.path)).collect()
    }
}

/// The reflectance of a conductor along the normal, which other readers take as the color of a metal.
fn reflectance(eta: [f64; 3], k: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| {
        let (n, k2) = (eta[i], k[i] * k[i]);
        ((n - 1.0).powi(2) + k2) / ((n + 1.0).powi(2) + k2)
    })
}

/// A number of a material on the host.
enum Number {
    Constant(f64),
    Texture(Texels),
}

impl Number {
    fn of(number: &ScalarTexture) -> Result<Self> {
        Ok(match number {
            ScalarTexture::Constant(p) => Self::Constant(p.values()?[0]),
            ScalarTexture::Texture { texels, wrap } => {
                Self::Texture(Texels::of(&texels.clone().unsqueeze_dim(2), *wrap)?)
            }
        })
    }
}

/// A mask in [0, 1] of the same holes, and its cutoff.
fn shares(mask: &AlphaMask) -> Result<(Texels, f32)> {
    let mut alpha = Texels::of(&mask.alpha.clone().unsqueeze_dim(2), mask.wrap)?;
    let cutoff = mask.cutoff as f32;
    let all = || alpha.values.iter().copied().chain([cutoff]);
    let (least, most) = (all().fold(0.0, f32::min), all().fold(1.0, f32::max));
    if (least, most) == (0.0, 1.0) {
        return Ok((alpha, cutoff));
    }
    let share = |v: f32| (v - least) / (most - least);
    alpha.values.iter_mut().for_each(|v| *v = share(*v));
    Ok((alpha, share(cutoff)))
}

/// Where a value stands in a list, at whose end it is added if it is not there.
fn position(list: &mut Vec<Value>, value: Value) -> usize {
    let known = list.iter().position(|v| *v == value);
    known.unwrap_or_else(|| {
        list.push(value);
        list.len() - 1
    })
}
