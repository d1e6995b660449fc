//! Materials of OBJ files.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use burn::tensor::{Device, Tensor, TensorData};

use super::limits::{Memory, TEXEL};
use super::notes::Notes;
use super::obj_text::ObjText;
use super::{HostImage, LoadLimits};
use crate::error::{Error, Result};
use crate::geometry::host_values;
use crate::scene::{Albedo, Material, Wrap};

const UNKNOWN: &str = "no file defines these materials, which are grey";
const SCALED: &str = "Kd + Ks is above 1 in these materials, so that their Ks is scaled down";
const CLAMPED: &str = "Kd or Ks of these materials is outside of [0, 1] and limited to it";
const UNTEXTURED: &str = "these materials have a texture on objects without coordinates at all corners, where their \
                          colour counts";

/// Materials made when first used, so that objects share textures and unused ones aren't read.
pub(super) struct Materials<'a> {
    /// The names of `usemtl`.
    names: &'a [String],
    described: Vec<tobj::Material>,
    numbers: HashMap<String, usize>,
    /// The colour of what has none: grey, and white below colours of vertices.
    plain: [f64; 3],
    textures: &'a [PathBuf],
    limits: &'a LoadLimits,
    device: &'a Device,
    memory: Memory,
    /// By their names, with and without textures.
    made: HashMap<(u32, bool), Material>,
    /// Textures that were read, by their numbers.
    read: HashMap<usize, Option<Texture>>,
    /// Textures times colours.
    tinted: HashMap<(usize, [u64; 3]), Texture>,
    pub notes: &'a mut Notes,
}

/// A texture of a file, perhaps times a colour.
#[derive(Clone)]
struct Texture {
    texels: Tensor<3>,
    /// The largest value of each channel.
    largest: [f64; 3],
}

/// An albedo and the largest value of each channel.
type Bounded = (Albedo, [f64; 3]);

impl<'a> Materials<'a> {
    pub fn new(
        path: &Path,
        text: &'a ObjText,
        limits: &'a LoadLimits,
        device: &'a Device,
        notes: &'a mut Notes,
    ) -> Result<Self> {
        let (described, numbers) = text.mtl.parse(path)?;
        let mut memory = text.memory;
        memory.read += text.mtl.bytes;
        let plain = if text.coloured { 1.0 } else { 0.5 };
        Ok(Self {
            names: &text.materials.all,
            described,
            numbers,
            plain: [plain; 3],
            textures: &text.mtl.textures,
            limits,
            device,
            memory,
            made: HashMap::new(),
            read: HashMap::new(),
            tinted: HashMap::new(),
            notes,
        })
    }

    /// The material of a name, with its textures or with the colours beside them.
    pub fn get(&mut self, index: u32, textured: bool) -> Result<Material> {
        if let Some(made) = self.made.get(&(index, textured)) {
            return Ok(made.clone());
        }
        let name = &self.names[index as usize];
        let material = match self.numbers.get(name) {
            Some(&number) => {
                // Each is made once with and once without textures.
                let source = std::mem::take(&mut self.described[number]);
                let made = self.make(&source, textured);
                self.described[number] = source;
                made?
            }
            None => {
                let name = match name.as_str() {
                    "" => "default",
                    name => {
                        self.notes.add(UNKNOWN, name);
                        name
                    }
                };
                Material::diffuse(self.plain).named(name)
            }
        };
        self.made.insert((index, textured), material.clone());
        Ok(material)
    }

    fn make(&mut self, source: &tobj::Material, textured: bool) -> Result<Material> {
        let maps = [
            source.diffuse_texture.as_deref(),
            source.specular_texture.as_deref(),
            source.unknown_param.get("map_Ke").map(String::as_str),
        ];
        if !textured && maps.iter().any(Option::is_some) {
            self.notes.add(UNTEXTURED, &source.name);
        }
        let [map_kd, map_ks, map_ke] = maps.map(|map| map.filter(|_| textured));
        let (kd, ks) = (
            self.share(source.diffuse, source),
            self.share(source.specular, source),
        );

        let diffuse = match self.texture(map_kd, [1.0; 3])? {
            Some(texture) => texture,
            None => constant(kd.unwrap_or(self.plain)),
        };
        // Of a colour without highlights, and of an exponent of 0, exporters leave Ks as it came.
        let shines = source.illumination_model.is_none_or(|model| model >= 2)
            && source.shininess.is_none_or(|n| n > 0.0);
        let (ks, map_ks) = (ks.filter(|_| shines), map_ks.filter(|_| shines));
        let mut specular = self.tinted(ks, map_ks)?;
        if let Some(whole) = &specular {
            let share = self.share_of_gloss(&diffuse, whole, map_ks)?;
            // As much as a render allows.
            if share < 1.0 - 1e-6 {
                self.notes.add(SCALED, &source.name);
                let ks = ks.unwrap_or([1.0; 3]).map(|v| v * share);
                specular = self.tinted(Some(ks), map_ks)?;
            }
        }
        let emission = self.tinted(source.emissive, map_ke)?;
        let mut material = Material::diffuse(diffuse.0).named(source.name.clone());
        material.specular = albedo_or_black(specular);
        if let Some(n) = source.shininess.filter(|&n| n > 0.0) {
            material.shininess = n.into();
        }
        material.emission = albedo_or_black(emission);
        Ok(material)
    }

    /// A colour whose values are shares.
    fn share(&mut self, colour: Option<[f64; 3]>, source: &tobj::Material) -> Option<[f64; 3]> {
        let colour = colour?;
        let limited = colour.map(|v| v.clamp(0.0, 1.0));
        if limited != colour {
            self.notes.add(CLAMPED, &source.name);
        }
        Some(limited)
    }

    /// A texture times a colour, which is white where there is none; the colour where there is no texture. None where
    /// the colour is black, or there is neither.
    fn tinted(&mut self, colour: Option<[f64; 3]>, map: Option<&str>) -> Result<Option<Bounded>> {
        if colour == Some([0.0; 3]) {
            return Ok(None);
        }
        let texture = self.texture(map, colour.unwrap_or([1.0; 3]))?;
        Ok(texture.or_else(|| colour.map(constant)))
    }

    /// The share of a specular albedo with which no more light leaves than arrives.
    fn share_of_gloss(
        &mut self,
        (diffuse, most): &Bounded,
        (specular, largest): &Bounded,
        map: Option<&str>,
    ) -> Result<f64> {
        let share = match (diffuse, specular) {
            (Albedo::Texture { texels: kd, .. }, Albedo::Texture { texels: ks, .. })
                if kd.dims() == ks.dims() =>
            {
                self.take(ks, map)?;
                let none = ks.clone().lower_equal_elem(0.0);
                let room = (kd.clone().neg() + 1.0).clamp_min(0.0) / ks.clone();
                host_values(&room.mask_fill(none, 1.0).min())?[0]
            }
            // Where the brightest texels of both lie is not compared.
            _ => (0..3)
                .filter(|&c| largest[c] > 0.0)
                .map(|c| (1.0 - most[c]) / largest[c])
                .fold(1.0, f64::min),
        };
        Ok(share.max(0.0))
    }

    /// Counts a texture that is made of one that a statement names.
    fn take(&mut self, texels: &Tensor<3>, statement: Option<&str>) -> Result<()> {
        let numbers: usize = texels.dims().iter().product();
        let taken = self.memory.take(numbers as u64, TEXEL, self.limits);
        let number = statement.and_then(number).unwrap_or(0);
        taken.map_err(|m| Error::format(&self.textures[number], format!("it {m}")))
    }

    /// The texture that a statement names, times a colour.
    fn texture(&mut self, statement: Option<&str>, tint: [f64; 3]) -> Result<Option<Bounded>> {
        let Some((statement, number)) = statement.and_then(|s| Some((s, number(s)?))) else {
            return Ok(None);
        };
        let wrap = match statement.ends_with(" clamp") {
            true => Wrap::Clamp,
            false => Wrap::Repeat,
        };
        let Some(plain) = self.read(number, statement)? else {
            return Ok(None);
        };
        let key = (number, tint.map(f64::to_bits));
        let texture = match self.tinted.get(&key) {
            _ if tint == [1.0; 3] => plain,
            Some(known) => known.clone(),
            None => {
                self.take(&plain.texels, Some(statement))?;
                let colour = Tensor::<1>::from_data(TensorData::from(tint), self.device);
                let tinted = Texture {
                    texels: plain.texels * colour.reshape([1, 1, 3]),
                    largest: std::array::from_fn(|c| plain.largest[c] * tint[c]),
                };
                self.tinted.insert(key, tinted.clone());
                tinted
            }
        };
        let Texture { texels, largest } = texture;
        Ok(Some((Albedo::Texture { texels, wrap }, largest)))
    }

    /// A texture, read once; None where it can't be.
    fn read(&mut self, number: usize, statement: &str) -> Result<Option<Texture>> {
        if let Some(read) = self.read.get(&number) {
            return Ok(read.clone());
        }
        let file = &self.textures[number];
        let read = match HostImage::read_within(file, self.limits) {
            Ok(image) => {
                self.memory.read += std::fs::metadata(file).map_or(0, |m| m.len());
                let mut largest = [0.0f32; 3];
                for pixel in image.pixels.chunks_exact(3) {
                    largest = std::array::from_fn(|c| largest[c].max(pixel[c]));
                }
                let texels = image.into_tensor(self.device);
                self.take(&texels, Some(statement))?;
                Some(Texture {
                    texels,
                    largest: largest.map(f64::from),
                })
            }
            Err(error) => {
                self.notes.fault(error, self.limits)?;
                None
            }
        };
        self.read.insert(number, read.clone());
        Ok(read)
    }
}

/// The number of a texture of a statement, as [`MtlText`](super::mtl_text::MtlText) writes it.
fn number(statement: &str) -> Option<usize> {
    statement.split_whitespace().next()?.parse().ok()
}

fn constant(colour: [f64; 3]) -> Bounded {
    (colour.into(), colour)
}

fn albedo_or_black(albedo: Option<Bounded>) -> Albedo {
    albedo.map_or([0.0; 3].into(), |(albedo, _)| albedo)
}
