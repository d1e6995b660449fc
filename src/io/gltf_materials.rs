//! Materials of glTF files to come, their textures as PNG images.

use std::collections::BTreeSet;
use std::path::Path;

use serde_json::{Value, json};

use super::HostImage;
use super::gltf_images::Picture;
use super::gltf_lights::scale_above;
use crate::error::Result;
use crate::geometry::host_values;
use crate::scene::{Albedo, Bsdf, Material, ScalarTexture, Wrap};

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
        let mut json = match material.bsdf {
            Bsdf::Phong => self.phong(material, &place)?,
            Bsdf::MetallicRoughness => {
                let mut json = self.base(&material.diffuse, &place)?;
                let numbers = (Some(&material.metallic), &material.roughness);
                self.facets(&mut json, numbers, &place)?;
                json
            }
            Bsdf::Conductor => self.conductor(material, &place)?,
            Bsdf::Dielectric => self.dielectric(material, &place)?,
        };
        if !material.compensated {
            json["extras"]["softray"]["compensated"] = json!(false);
        }
        json["name"] = json!(material.name);
        let radiance = self.radiance(&material.emission, &place)?;
        let emits = radiance.most > 0.0;
        // Both sides reflect; what emits does so in front.
        json["doubleSided"] = json!(!emits);
        if emits {
            json["emissiveFactor"] = json!(radiance.factor);
            if let Some(texture) = radiance.texture {
                json["emissiveTexture"] = json!({"index": texture});
            }
            if radiance.strength > 1.0 {
                let strength = json!({"emissiveStrength": radiance.strength});
                self.extend(&mut json, "KHR_materials_emissive_strength", strength);
            }
        }
        Ok(json)
    }

    fn extend(&mut self, json: &mut Value, name: &'static str, extension: Value) {
        json["extensions"][name] = extension;
        self.extensions.insert(name);
    }

    /// A material of a base colour that is no metal.
    fn base(&mut self, albedo: &Albedo, place: &str) -> Result<Value> {
        let ([r, g, b], texture) = self.albedo(albedo, place)?;
        let mut pbr = json!({"baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0});
        if let Some(texture) = texture {
            pbr["baseColorTexture"] = json!({"index": texture});
        }
        Ok(json!({"pbrMetallicRoughness": pbr}))
    }

    fn phong(&mut self, material: &Material, place: &str) -> Result<Value> {
        let mut json = self.base(&material.diffuse, place)?;
        if !material.specular.reflects() {
            let none = json!({"specularFactor": 0});
            self.extend(&mut json, "KHR_materials_specular", none);
            return Ok(json);
        }
        let (factor, texture) = self.albedo(&material.specular, place)?;
        let [shininess] = material.shininess.values()?;
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

    /// For other readers, a metal of the same colour along the normal.
    fn conductor(&mut self, material: &Material, place: &str) -> Result<Value> {
        let (eta, k) = (material.eta.values()?, material.extinction.values()?);
        let reflectance = |i: usize| {
            let (n, k2) = (eta[i], k[i] * k[i]);
            ((n - 1.0).powi(2) + k2) / ((n + 1.0).powi(2) + k2)
        };
        let colour: [f64; 3] = std::array::from_fn(reflectance);
        let mut json = self.base(&colour.into(), place)?;
        self.facets(&mut json, (None, &material.roughness), place)?;
        json["pbrMetallicRoughness"]["metallicFactor"] = json!(1);
        json["extras"]["softray"]["conductor"] = json!({"eta": eta, "extinction": k});
        Ok(json)
    }

    fn dielectric(&mut self, material: &Material, place: &str) -> Result<Value> {
        let mut json = self.base(&material.diffuse, place)?;
        self.facets(&mut json, (None, &material.roughness), place)?;
        let ior = match Number::of(&material.ior)? {
            Number::Constant(ior) => ior,
            Number::Texture(image) => image.mean("index of refraction", place),
        };
        self.extend(&mut json, "KHR_materials_ior", json!({"ior": ior}));
        let all = json!({"transmissionFactor": 1});
        self.extend(&mut json, "KHR_materials_transmission", all);
        // Without a thickness it would not refract.
        let solid = json!({"thicknessFactor": 1});
        self.extend(&mut json, "KHR_materials_volume", solid);
        Ok(json)
    }

    /// The metal, if there may be some, and the roughness.
    fn facets(
        &mut self,
        json: &mut Value,
        (metallic, roughness): (Option<&ScalarTexture>, &ScalarTexture),
        place: &str,
    ) -> Result<()> {
        let of = |number: Option<&ScalarTexture>| number.map(Number::of).transpose();
        let (mut metallic, roughness) = (of(metallic)?, Number::of(roughness)?);
        if let (Some(Number::Texture(m)), Number::Texture(r)) = (&metallic, &roughness)
            && (m.size, m.wrap) != (r.size, r.wrap)
        {
            // One image holds both.
            metallic = Some(Number::Constant(
                m.mean("metal beside another image", place),
            ));
        }
        let images = metallic.iter().chain([&roughness]);
        let mut images = images.filter_map(|number| match number {
            Number::Texture(image) => Some(([image.size[0], image.size[1]], image.wrap)),
            Number::Constant(_) => None,
        });
        let pbr = &mut json["pbrMetallicRoughness"];
        let texture = images.next();
        for (number, name) in [
            (metallic.as_ref(), "metallicFactor"),
            (Some(&roughness), "roughnessFactor"),
        ] {
            match number {
                Some(Number::Constant(v)) => pbr[name] = json!(self.share(*v, name, place)),
                Some(Number::Texture(_)) => pbr[name] = json!(1),
                None => {}
            }
        }
        let Some(([height, width], wrap)) = texture else {
            return Ok(());
        };
        let at = |number: Option<&Number>, i: usize| match number {
            Some(Number::Texture(image)) => image.values[i],
            _ => 1.0,
        };
        let pixel = |i: usize| [1.0, at(Some(&roughness), i), at(metallic.as_ref(), i)];
        let pixels = (0..height * width).flat_map(pixel).collect();
        let picture = Picture {
            texels: HostImage::new(width, height, pixels)?,
            colours: false,
            alpha: None,
        };
        let texture = self.texture(picture, wrap, place);
        json["pbrMetallicRoughness"]["metallicRoughnessTexture"] = json!({"index": texture});
        Ok(())
    }

    /// A number that is clipped to [0, 1].
    fn share(&self, value: f64, name: &str, place: &str) -> f64 {
        let share = value.clamp(0.0, 1.0);
        if share != value {
            let file = self.path.display();
            log::warn!("{file}: {place} has {name} {value}, written as {share}");
        }
        share
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
        let strength = scale_above(values.iter().copied());
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
        let picture = Picture {
            texels,
            colours: true,
            alpha: None,
        };
        Ok(([1.0; 3], Some(self.texture(picture, wrap, place))))
    }

    /// The number of a texture in the file.
    fn texture(&mut self, picture: Picture, wrap: Wrap, place: &str) -> usize {
        let outside = |v: &f32| !(0.0..=1.0).contains(v);
        if picture.texels.pixels.iter().any(outside) {
            let file = self.path.display();
            log::warn!("{file}: {place} has texels outside of [0, 1], which are clipped");
        }
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
        position(&mut self.textures, texture)
    }

    /// The images as PNG files.
    pub fn images(&self) -> Result<Vec<Vec<u8>>> {
        self.pictures.iter().map(|p| p.png(self.path)).collect()
    }
}

/// A number of a material on the host.
enum Number {
    Constant(f64),
    Texture(Numbers),
}

/// Numbers of an image.
struct Numbers {
    values: Vec<f32>,
    /// Rows and columns.
    size: [usize; 2],
    wrap: Wrap,
}

impl Number {
    fn of(number: &ScalarTexture) -> Result<Self> {
        Ok(match number {
            ScalarTexture::Constant(p) => Self::Constant(p.values()?[0]),
            ScalarTexture::Texture { texels, wrap } => {
                let values = host_values(texels)?.into_iter();
                Self::Texture(Numbers {
                    values: values.map(|v| v as f32).collect(),
                    size: texels.dims(),
                    wrap: *wrap,
                })
            }
        })
    }
}

impl Numbers {
    /// The mean, which is told to be written instead.
    fn mean(&self, name: &str, place: &str) -> f64 {
        log::warn!("{place}: glTF has no texture of {name}, written as its mean");
        let sum: f64 = self.values.iter().map(|&v| f64::from(v)).sum();
        sum / self.values.len() as f64
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
