//! The JSON of glTF's materials.

use serde::{Deserialize, Deserializer};

/// A texture as a material names it.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Info {
    pub index: usize,
    #[serde(default)]
    pub tex_coord: u32,
    /// Of normal maps.
    pub scale: Option<f32>,
    #[serde(default)]
    pub extensions: InfoExtensions,
}

#[derive(Default, Deserialize)]
pub(super) struct InfoExtensions {
    #[serde(rename = "KHR_texture_transform")]
    pub transform: Option<TextureTransform>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct TextureTransform {
    #[serde(default)]
    pub offset: [f32; 2],
    #[serde(default)]
    pub rotation: f32,
    pub scale: Option<[f32; 2]>,
    pub tex_coord: Option<u32>,
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Material {
    pub name: Option<String>,
    pub pbr_metallic_roughness: MetallicRoughness,
    pub normal_texture: Option<Info>,
    pub emissive_texture: Option<Info>,
    pub emissive_factor: [f32; 3],
    pub alpha_mode: AlphaMode,
    pub alpha_cutoff: Option<f32>,
    pub double_sided: bool,
    pub extensions: MaterialExtensions,
    #[serde(deserialize_with = "own")]
    pub extras: Extras,
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
pub(super) enum AlphaMode {
    #[default]
    Opaque,
    Mask,
    Blend,
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct MetallicRoughness {
    pub base_color_factor: Option<[f32; 4]>,
    pub base_color_texture: Option<Info>,
    pub metallic_factor: Option<f32>,
    pub roughness_factor: Option<f32>,
    pub metallic_roughness_texture: Option<Info>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct MaterialExtensions {
    #[serde(rename = "KHR_materials_emissive_strength")]
    pub emissive: EmissiveStrength,
    #[serde(rename = "KHR_materials_ior")]
    pub ior: Ior,
    #[serde(rename = "KHR_materials_specular")]
    pub specular: Specular,
    #[serde(rename = "KHR_materials_transmission")]
    pub transmission: Transmission,
    #[serde(rename = "KHR_materials_volume")]
    pub volume: Volume,
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct EmissiveStrength {
    pub emissive_strength: Option<f32>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Ior {
    pub ior: Option<f32>,
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Specular {
    pub specular_factor: Option<f32>,
    pub specular_color_factor: Option<[f32; 3]>,
    pub specular_texture: Option<Info>,
    pub specular_color_texture: Option<Info>,
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Transmission {
    pub transmission_factor: f32,
    pub transmission_texture: Option<Info>,
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Volume {
    pub thickness_factor: f32,
    /// Without one there is no attenuation.
    pub attenuation_distance: Option<f32>,
}

/// What this crate writes of a material that glTF has no field for.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Extras {
    pub softray: Own,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Own {
    pub phong: Option<Phong>,
    pub conductor: Option<Conductor>,
    /// Not where it is as without this.
    pub compensated: Option<bool>,
}

/// Phong's lobe.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Phong {
    pub specular_factor: [f32; 3],
    pub specular_texture: Option<Info>,
    pub shininess: f32,
}

/// The parts of a metal's index of refraction.
#[derive(Deserialize)]
pub(super) struct Conductor {
    pub eta: [f32; 3],
    pub extinction: [f32; 3],
}

/// What others keep in `extras` is theirs.
fn own<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Extras, D::Error> {
    let value = serde_json::Value::deserialize(deserializer)?;
    Ok(serde_json::from_value(value).unwrap_or_default())
}
