//! Textures of materials from images of a file: each image is decoded and each texture made once, however many
//! materials have it.

use std::collections::HashMap;
use std::io::{BufReader, Cursor};
use std::path::Path;

use burn::tensor::{Device, Tensor, TensorData};

use super::LoadLimits;
use super::decode::{Decoded, check_size};
use super::description::{Description, ImageSource, TextureUse};
use super::limits::{Memory, TEXEL, open};
use crate::error::{Error, Result};

/// What is taken from an image, and the bits of the factors by which it is multiplied.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Taken {
    /// Linear RGB from sRGB.
    Colours([u64; 3]),
    /// A normal map, its x and y times a factor.
    Tilts(u64),
    /// A channel as it is.
    Channel(usize, u64),
    Alpha(u64),
}

/// The textures of a file's materials.
pub(super) struct Textures<'a> {
    description: &'a Description,
    path: &'a Path,
    limits: &'a LoadLimits,
    device: &'a Device,
    /// What the file takes in memory, while it is counted: then nothing is decoded, and a texel stands for a texture.
    counted: Option<Memory>,
    /// Columns and rows of images, None of those that can't be read.
    sizes: HashMap<usize, Option<[usize; 2]>>,
    colours: HashMap<(usize, Taken), Tensor<3>>,
    numbers: HashMap<(usize, Taken), Tensor<2>>,
    /// The image that was decoded last: what is taken from one comes one after the other.
    last: Option<(usize, Decoded)>,
}

impl<'a> Textures<'a> {
    /// Textures that are only counted until [`Self::decode`].
    pub fn new(
        description: &'a Description,
        path: &'a Path,
        limits: &'a LoadLimits,
        device: &'a Device,
    ) -> Self {
        Self {
            description,
            path,
            limits,
            device,
            counted: Some(description.memory),
            sizes: HashMap::new(),
            colours: HashMap::new(),
            numbers: HashMap::new(),
            last: None,
        }
    }

    /// Decodes images from now on.
    pub fn decode(&mut self) {
        self.counted = None;
        self.colours.clear();
        self.numbers.clear();
    }

    /// A texture, unless its image is missing or is none that is known: then there is a warning, and the surface is as it
    /// is without it.
    ///
    /// # Errors
    /// If the image is larger than the limits.
    pub fn found(&mut self, texture: Option<TextureUse>) -> Result<Option<TextureUse>> {
        let Some(TextureUse { image, .. }) = texture else {
            return Ok(None);
        };
        if let Some(size) = self.sizes.get(&image) {
            return Ok(texture.filter(|_| size.is_some()));
        }
        let source = &self.description.images[image];
        let size = match source {
            ImageSource::File(path) => open(path).and_then(|(file, bytes)| {
                if let Some(memory) = &mut self.counted {
                    memory.read = memory.read.saturating_add(bytes);
                }
                Decoded::read_size(BufReader::new(file), path)
            }),
            ImageSource::Bytes { name, bytes } => {
                Decoded::read_size(Cursor::new(bytes.slice()), name)
            }
        };
        let size = match size {
            Ok(size) => {
                check_size(size, name(source), self.limits)?;
                Some(size)
            }
            Err(error) => {
                let path = self.path.display();
                log::warn!("{path}: a texture is left out, its image can't be read: {error}");
                None
            }
        };
        self.sizes.insert(image, size);
        Ok(texture.filter(|_| size.is_some()))
    }

    /// Colours in sRGB, times a factor.
    pub fn colours(&mut self, image: usize, factor: [f64; 3]) -> Result<Tensor<3>> {
        self.of_three(image, Taken::Colours(factor.map(f64::to_bits)))
    }

    /// A normal map, its x and y times a factor.
    pub fn tilts(&mut self, image: usize, factor: f64) -> Result<Tensor<3>> {
        self.of_three(image, Taken::Tilts(factor.to_bits()))
    }

    /// A channel times a factor.
    pub fn channel(&mut self, image: usize, channel: usize, factor: f64) -> Result<Tensor<2>> {
        self.of_one(image, Taken::Channel(channel, factor.to_bits()))
    }

    /// The alpha times a factor.
    pub fn alpha(&mut self, image: usize, factor: f64) -> Result<Tensor<2>> {
        self.of_one(image, Taken::Alpha(factor.to_bits()))
    }

    fn of_three(&mut self, image: usize, taken: Taken) -> Result<Tensor<3>> {
        if let Some(known) = self.colours.get(&(image, taken)) {
            return Ok(known.clone());
        }
        let (values, [height, width]) = self.values(image, taken)?;
        let data = TensorData::new(values, [height, width, 3]);
        let texels = Tensor::from_data(data, self.device);
        self.colours.insert((image, taken), texels.clone());
        Ok(texels)
    }

    fn of_one(&mut self, image: usize, taken: Taken) -> Result<Tensor<2>> {
        if let Some(known) = self.numbers.get(&(image, taken)) {
            return Ok(known.clone());
        }
        let (values, size) = self.values(image, taken)?;
        let texels = Tensor::from_data(TensorData::new(values, size), self.device);
        self.numbers.insert((image, taken), texels.clone());
        Ok(texels)
    }

    /// The numbers of a texture, row by row, and its rows and columns.
    fn values(&mut self, image: usize, taken: Taken) -> Result<(Vec<f32>, [usize; 2])> {
        let three = matches!(taken, Taken::Colours(_) | Taken::Tilts(_));
        if let Some(memory) = &mut self.counted {
            // Kernels have three numbers a texel.
            let size = self.sizes.get(&image).copied().flatten().unwrap_or([0; 2]);
            let pixels = size.map(|side| side as u64).into_iter().product();
            let name = name(&self.description.images[image]).display();
            let fail = |m| Error::format(self.path, format!("the image {name} {m}"));
            let taken = memory.take(pixels, 3 * TEXEL, self.limits);
            taken.map_err(fail)?;
            return Ok((vec![0.0; if three { 3 } else { 1 }], [1, 1]));
        }
        let decoded = self.decoded(image)?;
        let [width, height] = decoded.size();
        let float = |bits: u64| f64::from_bits(bits) as f32;
        let times = |mut values: Vec<f32>, factor: u64| {
            if float(factor) != 1.0 {
                values.iter_mut().for_each(|v| *v *= float(factor));
            }
            values
        };
        let values = match taken {
            Taken::Colours(factor) => {
                let mut values = decoded.colours();
                if factor.map(float) != [1.0; 3] {
                    for texel in values.chunks_exact_mut(3) {
                        (0..3).for_each(|c| texel[c] *= float(factor[c]));
                    }
                }
                values
            }
            Taken::Tilts(factor) => {
                let mut values = decoded.numbers();
                values.iter_mut().for_each(|v| *v = *v * 2.0 - 1.0);
                if float(factor) != 1.0 {
                    for texel in values.chunks_exact_mut(3) {
                        texel[..2].iter_mut().for_each(|v| *v *= float(factor));
                    }
                }
                values
            }
            Taken::Channel(channel, factor) => times(decoded.channel(channel), factor),
            Taken::Alpha(factor) => times(decoded.alpha(), factor),
        };
        Ok((values, [height, width]))
    }

    fn decoded(&mut self, image: usize) -> Result<&Decoded> {
        let known = self.last.take().filter(|(last, _)| *last == image);
        let decoded = match (known, &self.description.images[image]) {
            (Some((_, known)), _) => known,
            (None, ImageSource::File(path)) => {
                Decoded::read(BufReader::new(open(path)?.0), path, self.limits)?
            }
            (None, ImageSource::Bytes { name, bytes }) => {
                Decoded::read(Cursor::new(bytes.slice()), name, self.limits)?
            }
        };
        Ok(&self.last.insert((image, decoded)).1)
    }
}

/// What an image is called in messages.
fn name(source: &ImageSource) -> &Path {
    match source {
        ImageSource::File(path) => path,
        ImageSource::Bytes { name, .. } => name,
    }
}
