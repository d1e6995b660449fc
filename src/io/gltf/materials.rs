//! Reads materials and images.

use serde_json::Value;

use super::Document;
use super::buffers::Target;
use super::fields::{Fields, Range::NotNegative, Range::Unit};
use super::schema::AlphaMode;
use crate::error::Result;
use crate::io::description::{
    Alpha, Color, ExtraBsdf, ImageSource, MaterialDescription, TextureUse,
};
use crate::scene::Wrap;

/// A material, and the coordinates of its textures.
pub(super) struct Material {
    pub description: MaterialDescription,
    /// `None` without textures.
    pub coordinates: Option<Coordinates>,
}

/// Texture coordinates of glTF: the index of the set, and a transform (KHR_texture_transform).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Coordinates {
    pub set: u32,
    offset: [f32; 2],
    rotation: f32,
    scale: [f32; 2],
}

impl Coordinates {
    /// Transforms coordinates of glTF to coordinates whose v points up.
    pub fn apply(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = f64::from(self.rotation).sin_cos();
        let [x, y] = [0, 1].map(|i| f64::from(self.scale[i]) * [u, v][i]);
        let [u, v] = [cos * x + sin * y, cos * y - sin * x];
        [
            u + f64::from(self.offset[0]),
            1.0 - (v + f64::from(self.offset[1])),
        ]
    }
}

/// Returns all materials of a file.
pub(super) fn materials(document: &Document) -> Result<Vec<Material>> {
    let count = document.root.materials.len();
    (0..count).map(|i| material(document, i)).collect()
}

/// Returns all images of a file. Base64 is decoded here, and pixels are decoded at their first use.
pub(super) fn images(document: &Document) -> Result<Vec<ImageSource>> {
    let all = &document.root.images;
    let images = (0..all.len()).map(|i| {
        let json = document.fields(all, i, "", "images")?;
        let (uri, place) = (json.get::<&str>("uri")?, &json.place);
        let bytes = match (uri, json.get("bufferView")?) {
            (_, Some(view)) => document.view(view, &json.at("bufferView"))?,
            (Some(uri), None) => match document.target(uri, place)? {
                Target::File(path) => {
                    let named_by = format!("{}, {place}.uri", document.path.display());
                    return Ok(ImageSource::File { path, named_by });
                }
                Target::Data(data) => data.into(),
            },
            (None, None) => return Err(document.fail(place, "has neither uri nor bufferView")),
        };
        let name = format!("{}, {place}", document.path.display()).into();
        Ok(ImageSource::Bytes { name, bytes })
    });
    images.collect()
}

fn material(document: &Document, index: usize) -> Result<Material> {
    let json = document.fields(&document.root.materials, index, "", "materials")?;
    let mut textures = Textures {
        document,
        coordinates: None,
    };
    let path = "pbrMetallicRoughness.baseColorFactor";
    let base = json.get(path)?.unwrap_or([1.0; 4]);
    let [r, g, b, factor] = json.check(path, base, Unit)?;
    let strength = "extensions.KHR_materials_emissive_strength.emissiveStrength";
    let strength = json.number(strength, 1.0, NotNegative)?;
    let emission = json.three("emissiveFactor", [0.0; 3], NotNegative)?;
    let texture = textures.of(&json, "pbrMetallicRoughness.baseColorTexture")?;
    let name = json.get("name")?;
    let mut description = MaterialDescription {
        name: name.unwrap_or_else(|| format!("material {index}")),
        base_color: Color::times([r, g, b], texture),
        alpha: match json.get("alphaMode")?.unwrap_or_default() {
            AlphaMode::Opaque => Alpha::Opaque,
            AlphaMode::Mask => {
                let cutoff = json.number("alphaCutoff", 0.5, NotNegative)?;
                Alpha::Mask { factor, cutoff }
            }
            AlphaMode::Blend => Alpha::Blend { factor },
        },
        metallic: json.number("pbrMetallicRoughness.metallicFactor", 1.0, Unit)?,
        roughness: json.number("pbrMetallicRoughness.roughnessFactor", 1.0, Unit)?,
        metallic_roughness_texture: textures
            .of(&json, "pbrMetallicRoughness.metallicRoughnessTexture")?,
        double_sided: json.get("doubleSided")?.unwrap_or(false),
        ..MaterialDescription::default()
    };
    let texture = textures.of(&json, "emissiveTexture")?;
    description.emission = Color::times(emission.map(|v| v * strength), texture);
    if texture.is_some() {
        // If the texture cannot be read, the surface must not emit everywhere.
        description.emission.plain = [0.0; 3];
    }
    let normal = textures.of(&json, "normalTexture")?;
    let scale: f32 = json.get("normalTexture.scale")?.unwrap_or(1.0);
    description.normal = normal.map(|texture| (texture, f64::from(scale)));
    extend(&mut description, &json)?;
    extras(&mut description, &json, &mut textures)?;
    Ok(Material {
        description,
        coordinates: textures.coordinates,
    })
}

/// Reads the extensions of a material.
fn extend(description: &mut MaterialDescription, json: &Fields) -> Result<()> {
    let at = |path: &str| format!("extensions.KHR_materials_{path}");
    let number = |path: &str, default, range| json.number(&at(path), default, range);
    let has = |path: &str| Result::Ok(!json.value(&at(path))?.is_null());
    // 0 means that the surface reflects all light.
    description.ior = number("ior.ior", 1.5, NotNegative)?;
    description.transmission = number("transmission.transmissionFactor", 0.0, Unit)?;
    if has("transmission.transmissionTexture")? {
        json.document.skip("transmissionTexture");
    }
    description.solid = number("volume.thicknessFactor", 0.0, NotNegative)? > 0.0;
    if has("volume.attenuationDistance")? {
        json.document.skip("attenuation of volumes");
    }
    description.specular = number("specular.specularFactor", 1.0, Unit)?;
    let color = json.get::<[f32; 3]>(&at("specular.specularColorFactor"))?;
    if color.is_some_and(|c| c != [1.0; 3])
        || has("specular.specularTexture")?
        || has("specular.specularColorTexture")?
    {
        json.document.skip("specularTexture and specularColor");
    }
    Ok(())
}

/// Reads the BSDF that this crate writes to `extras.softray`. Other content of `extras` is ignored.
fn extras(
    description: &mut MaterialDescription,
    json: &Fields,
    textures: &mut Textures,
) -> Result<()> {
    let extras = json.json.pointer("/extras/softray");
    let json = Fields {
        json: extras.unwrap_or(&Value::Null),
        place: json.at("extras.softray"),
        ..*json
    };
    description.compensated = json.get("compensated")?.unwrap_or(true);
    if !json.value("phong")?.is_null() {
        let albedo = json.three("phong.specularFactor", [0.0; 3], Unit)?;
        let texture = textures.of(&json, "phong.specularTexture")?;
        description.extra_bsdf = Some(ExtraBsdf::Phong {
            albedo: Color::times(albedo, texture),
            shininess: json.number("phong.shininess", 1.0, NotNegative)?,
        });
    } else if !json.value("conductor")?.is_null() {
        description.extra_bsdf = Some(ExtraBsdf::Conductor {
            eta: json.three("conductor.eta", [0.0; 3], NotNegative)?,
            extinction: json.three("conductor.extinction", [1.0; 3], NotNegative)?,
        });
    }
    Ok(())
}

/// The textures of one material.
struct Textures<'a> {
    document: &'a Document<'a>,
    /// The coordinates of the first texture.
    coordinates: Option<Coordinates>,
}

impl Textures<'_> {
    /// Returns a texture. Textures with other coordinates than the material's first texture are left out.
    fn of(&mut self, material: &Fields, path: &str) -> Result<Option<TextureUse>> {
        let document = self.document;
        let info = material.within(path)?;
        if info.json.is_null() {
            return Ok(None);
        }
        let transform = |field: &str| format!("extensions.KHR_texture_transform.{field}");
        let set = info.get(&transform("texCoord"))?.or(info.get("texCoord")?);
        let coordinates = Coordinates {
            set: set.unwrap_or(0),
            offset: info.get(&transform("offset"))?.unwrap_or_default(),
            rotation: info.get(&transform("rotation"))?.unwrap_or_default(),
            scale: info.get(&transform("scale"))?.unwrap_or([1.0; 2]),
        };
        let root = &document.root;
        let index = info.required("index")?;
        let field = path.rsplit('.').next().unwrap_or(path);
        let json = document.fields(&root.textures, index, &info.place, "textures")?;
        let webp = json.get("extensions.EXT_texture_webp.source")?;
        // An image in one of glTF's own formats is preferred; the image of the extension is the same.
        let Some(image) = json.get("source")?.or(webp) else {
            document.skip("textures without a source in PNG, JPEG or WebP");
            return Ok(None);
        };
        document.get(&root.images, image, json.at("source"), "images")?;
        let mut wrap = Wrap::Repeat;
        if let Some(sampler) = json.get("sampler")? {
            let json = document.fields(&root.samplers, sampler, json.at("sampler"), "samplers")?;
            let [s, t] = [json.get("wrapS")?, json.get("wrapT")?].map(|w| w.unwrap_or(10497u32));
            if s != t {
                document.skip("wrapT where it differs from wrapS");
            }
            wrap = match s {
                10497 => Wrap::Repeat,
                33071 => Wrap::Clamp,
                33648 => Wrap::Mirror,
                other => {
                    let message = format!("is {other}, expected 10497, 33071 or 33648");
                    return Err(document.fail(json.at("wrapS"), message));
                }
            };
        }
        if *self.coordinates.get_or_insert(coordinates) != coordinates {
            document.skip(format!(
                "{field} with other coordinates than the material's first texture"
            ));
            return Ok(None);
        }
        Ok(Some(TextureUse { image, wrap }))
    }
}
