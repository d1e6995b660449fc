//! Microfacet materials that `scene.json` assigns to objects.

use std::path::Path;

use burn::tensor::{Tensor, TensorData};
use serde::Deserialize;
use serde_json::Value;

use super::HostImage;
use super::decode::Decoded;
use super::files::Place;
use crate::error::{Error, Result};
use crate::scene::{ColorTexture, Material, ScalarTexture};

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum Model {
    MetallicRoughness,
    Conductor,
    Dielectric,
}

/// A material. A field that is a JSON value holds numbers or the name of an image.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MaterialDocument {
    bsdf: Model,
    base_color: Option<Value>,
    metallic: Option<Value>,
    roughness: Option<Value>,
    #[serde(default)]
    eta: [f64; 3],
    #[serde(default = "ones")]
    extinction: [f64; 3],
    ior: Option<Value>,
    #[serde(default = "yes")]
    compensated: bool,
}

fn ones() -> [f64; 3] {
    [1.0; 3]
}

fn yes() -> bool {
    true
}

impl Place<'_> {
    /// Resolves the file of an image and decodes it with `read`.
    fn image<T>(&self, name: &str, read: impl FnOnce(&Path) -> Result<T>) -> Result<T> {
        let path = self.files.beside(self.path, name)?;
        read(&path).map_err(|e| e.named_by(&self.path.display().to_string()))
    }

    fn wrong<T>(&self, field: &str, value: &Value, expected: &str) -> Result<T> {
        let message = format!("{field} is {value}, expected {expected} or the name of an image");
        Err(Error::format(self.path, message))
    }

    fn color(&self, field: &str, value: Option<Value>) -> Result<ColorTexture> {
        match value {
            None => Ok([1.0; 3].into()),
            Some(Value::String(name)) => self.image(&name, |path| {
                let image = HostImage::read_from(path, self.files)?;
                Ok(ColorTexture::texture(image.into_tensor(self.device)))
            }),
            Some(value) => match serde_json::from_value::<[f64; 3]>(value.clone()) {
                Ok(color) => Ok(color.into()),
                Err(_) => self.wrong(field, &value, "three numbers"),
            },
        }
    }

    /// Returns a number, or a texture from one channel of an image, without color conversion.
    fn number(
        &self,
        field: &str,
        value: Option<Value>,
        default: f64,
        channel: usize,
    ) -> Result<ScalarTexture> {
        match value {
            None => Ok(default.into()),
            Some(Value::String(name)) => self.image(&name, |path| {
                let image = Decoded::of_file(path, self.files)?;
                let [width, height] = image.size();
                let data = TensorData::new(image.channel(channel), [height, width]);
                Ok(ScalarTexture::texture(Tensor::from_data(data, self.device)))
            }),
            Some(value) => match value.as_f64() {
                Some(number) => Ok(number.into()),
                None => self.wrong(field, &value, "a number"),
            },
        }
    }
}

impl MaterialDocument {
    /// Builds the material of an object.
    pub fn build(self, object: &str, place: &Place) -> Result<Material> {
        let field = |name: &str| format!("materials.{object}.{name}");
        let roughness = place.number(&field("roughness"), self.roughness, 1.0, 1)?;
        let color = place.color(&field("base_color"), self.base_color)?;
        let material = match self.bsdf {
            Model::MetallicRoughness => {
                let metallic = place.number(&field("metallic"), self.metallic, 0.0, 2)?;
                Material::metallic_roughness(color, metallic, roughness)
            }
            Model::Conductor => Material::conductor(self.eta, self.extinction, roughness),
            Model::Dielectric => {
                let ior = place.number(&field("ior"), self.ior, 1.5, 0)?;
                Material::dielectric(ior, roughness).with_tint(color)
            }
        };
        let material = material.with_compensated(self.compensated);
        Ok(material.with_name(object))
    }
}
