//! Materials and the images that they name.

use super::Document;
use super::buffers::Target;
use super::material_schema::{AlphaMode, Info, MaterialExtensions, Own};
use crate::error::Result;
use crate::io::description::{
    Alpha, Colour, ImageSource, MaterialDescription, OwnBsdf, TextureUse,
};
use crate::scene::Wrap;

/// A material, and where its textures are looked up.
pub(super) struct Material {
    pub description: MaterialDescription,
    /// None without textures.
    pub coordinates: Option<Coordinates>,
}

/// Texture coordinates of glTF: a set of them, and their transform (KHR_texture_transform).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Coordinates {
    pub set: u32,
    offset: [f32; 2],
    rotation: f32,
    scale: [f32; 2],
}

impl Coordinates {
    /// A point in coordinates whose v grows upwards.
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

/// All materials of a file.
pub(super) fn materials(document: &Document) -> Result<Vec<Material>> {
    let count = document.root.materials.len();
    (0..count).map(|i| material(document, i)).collect()
}

/// All images of a file. Data is decoded from base64 here, pictures when they are first used.
pub(super) fn images(document: &Document) -> Result<Vec<ImageSource>> {
    let all = document.root.images.iter().enumerate();
    let images = all.map(|(i, json)| {
        let place = format!("images[{i}]");
        let bytes = match (&json.uri, json.buffer_view) {
            (_, Some(view)) => document.view(view, &format!("{place}.bufferView"))?,
            (Some(uri), None) => match document.target(uri, &place)? {
                Target::File(file) => return Ok(ImageSource::File(file)),
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
    let json = &document.root.materials[index];
    let place = format!("materials[{index}]");
    let mut textures = Textures {
        document,
        coordinates: None,
    };
    let pbr = &json.pbr_metallic_roughness;
    let of_pbr = |field: &str| format!("{place}.pbrMetallicRoughness.{field}");
    let unit = |value: f32, field: String| document.unit(value, field);
    let [r, g, b, a] = pbr.base_color_factor.unwrap_or([1.0; 4]);
    let rgb = [r, g, b].map(|v| unit(v, of_pbr("baseColorFactor")));
    let base_colour = three(rgb)?;
    let factor = unit(a, of_pbr("baseColorFactor"))?;
    let strength = json.extensions.emissive.emissive_strength.unwrap_or(1.0);
    let strength = document.not_negative(strength, format!("{place}.emissiveStrength"))?;
    let emission = json.emissive_factor;
    let emission = emission.map(|v| document.not_negative(v, format!("{place}.emissiveFactor")));
    let emission = three(emission)?.map(|v| v * strength);
    let texture = textures.of(pbr.base_color_texture.as_ref(), "baseColorTexture")?;
    let name = json.name.clone();
    let mut description = MaterialDescription {
        name: name.unwrap_or_else(|| format!("material {index}")),
        base_colour: Colour::times(base_colour, texture),
        alpha: match json.alpha_mode {
            AlphaMode::Opaque => Alpha::Opaque,
            AlphaMode::Mask => {
                let field = format!("{place}.alphaCutoff");
                let cutoff = document.not_negative(json.alpha_cutoff.unwrap_or(0.5), field)?;
                Alpha::Mask { factor, cutoff }
            }
            AlphaMode::Blend => Alpha::Blend { factor },
        },
        metallic: unit(pbr.metallic_factor.unwrap_or(1.0), of_pbr("metallicFactor"))?,
        roughness: unit(
            pbr.roughness_factor.unwrap_or(1.0),
            of_pbr("roughnessFactor"),
        )?,
        metallic_roughness_texture: textures.of(
            pbr.metallic_roughness_texture.as_ref(),
            "metallicRoughnessTexture",
        )?,
        double_sided: json.double_sided,
        ..MaterialDescription::default()
    };
    let texture = textures.of(json.emissive_texture.as_ref(), "emissiveTexture")?;
    description.emission = Colour::times(emission, texture);
    if texture.is_some() {
        // Without the texture that says where a surface shines, all of it would.
        description.emission.plain = [0.0; 3];
    }
    if let Some(normal) = &json.normal_texture {
        let texture = textures.of(Some(normal), "normalTexture")?;
        description.normal = texture.map(|t| (t, f64::from(normal.scale.unwrap_or(1.0))));
    }
    extend(&mut description, &json.extensions, document, &place)?;
    extras(
        &mut description,
        &json.extras.softray,
        &mut textures,
        &place,
    )?;
    Ok(Material {
        description,
        coordinates: textures.coordinates,
    })
}

/// The extensions of a material.
fn extend(
    description: &mut MaterialDescription,
    json: &MaterialExtensions,
    document: &Document,
    place: &str,
) -> Result<()> {
    let field = |name: &str| format!("{place}.extensions.{name}");
    let (transmission, specular) = (&json.transmission, &json.specular);
    // 0 stands for a surface that reflects all.
    description.ior =
        document.not_negative(json.ior.ior.unwrap_or(1.5), field("KHR_materials_ior.ior"))?;
    let of = field("KHR_materials_transmission.transmissionFactor");
    description.transmission = document.unit(transmission.transmission_factor, of)?;
    if transmission.transmission_texture.is_some() {
        document.skip("transmissionTexture");
    }
    let of = field("KHR_materials_volume.thicknessFactor");
    description.solid = document.not_negative(json.volume.thickness_factor, of)? > 0.0;
    if json.volume.attenuation_distance.is_some() {
        document.skip("attenuation of volumes");
    }
    let of = field("KHR_materials_specular.specularFactor");
    description.specular = document.unit(specular.specular_factor.unwrap_or(1.0), of)?;
    if specular
        .specular_color_factor
        .is_some_and(|c| c != [1.0; 3])
        || specular.specular_texture.is_some()
        || specular.specular_color_texture.is_some()
    {
        document.skip("specularTexture and specularColor");
    }
    Ok(())
}

/// What this crate has written of a BSDF.
fn extras(
    description: &mut MaterialDescription,
    json: &Own,
    textures: &mut Textures,
    place: &str,
) -> Result<()> {
    let document = textures.document;
    let field = |name: &str| format!("{place}.extras.softray.{name}");
    description.compensated = json.compensated.unwrap_or(true);
    if let Some(phong) = &json.phong {
        let albedo = phong.specular_factor;
        let albedo = albedo.map(|v| document.unit(v, field("phong.specularFactor")));
        let texture = textures.of(phong.specular_texture.as_ref(), "specularTexture")?;
        description.own = Some(OwnBsdf::Phong {
            albedo: Colour::times(three(albedo)?, texture),
            shininess: document.not_negative(phong.shininess, field("phong.shininess"))?,
        });
    } else if let Some(conductor) = &json.conductor {
        let part = |values: [f32; 3], name: &str| {
            three(values.map(|v| document.not_negative(v, field(name))))
        };
        description.own = Some(OwnBsdf::Conductor {
            eta: part(conductor.eta, "conductor.eta")?,
            extinction: part(conductor.extinction, "conductor.extinction")?,
        });
    }
    Ok(())
}

/// The textures of one material.
struct Textures<'a> {
    document: &'a Document<'a>,
    /// Where the first one is looked up.
    coordinates: Option<Coordinates>,
}

impl Textures<'_> {
    /// A texture, unless it is looked up elsewhere than others of the material.
    fn of(&mut self, info: Option<&Info>, field: &str) -> Result<Option<TextureUse>> {
        let Some(info) = info else {
            return Ok(None);
        };
        let transform = info.extensions.transform.as_ref();
        let coordinates = Coordinates {
            set: transform
                .and_then(|t| t.tex_coord)
                .unwrap_or(info.tex_coord),
            offset: transform.map_or([0.0; 2], |t| t.offset),
            rotation: transform.map_or(0.0, |t| t.rotation),
            scale: transform.and_then(|t| t.scale).unwrap_or([1.0; 2]),
        };
        let index = info.index;
        let document = self.document;
        let root = &document.root;
        let json = document.get(&root.textures, index, field, "textures")?;
        let place = format!("textures[{index}]");
        let webp = json.extensions.webp.as_ref().and_then(|w| w.source);
        // Where there is one in glTF's own formats, that of the extension is the same.
        let Some(image) = json.source.or(webp) else {
            document.skip("textures without a source in PNG, JPEG or WebP");
            return Ok(None);
        };
        document.get(&root.images, image, format!("{place}.source"), "images")?;
        let mut wrap = Wrap::Repeat;
        if let Some(sampler) = json.sampler {
            let field = format!("{place}.sampler");
            let json = document.get(&root.samplers, sampler, field, "samplers")?;
            if json.wrap_s.unwrap_or(10497) != json.wrap_t.unwrap_or(10497) {
                document.skip("wrapT where it differs from wrapS");
            }
            wrap = match json.wrap_s {
                None | Some(10497) => Wrap::Repeat,
                Some(33071) => Wrap::Clamp,
                Some(33648) => Wrap::Mirror,
                Some(other) => {
                    let message = format!("is {other}, expected 10497, 33071 or 33648");
                    return Err(document.fail(format!("samplers[{sampler}].wrapS"), message));
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

fn three(values: [Result<f64>; 3]) -> Result<[f64; 3]> {
    let [a, b, c] = values;
    Ok([a?, b?, c?])
}
