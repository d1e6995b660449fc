//! Textures of materials from images of a file: each image is decoded and each texture made once, however many
//! materials have it.

use std::collections::{HashMap, HashSet};
use std::io::{BufReader, Cursor};
use std::path::Path;

use burn::tensor::{Tensor, TensorData};

use super::decode::{Decoded, check_size};
use super::description::{Description, ImageSource, TextureUse};
use super::limits::{Memory, Place, TEXEL, open};
use crate::error::{Error, Result};

/// What is taken from an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Taken {
    /// Linear RGB from sRGB.
    Colours,
    /// A normal map.
    Tilts,
    /// A channel as it is.
    Channel(usize),
    Alpha,
}

impl Taken {
    fn channels(self) -> usize {
        match self {
            Self::Colours | Self::Tilts => 3,
            Self::Channel(_) | Self::Alpha => 1,
        }
    }
}

/// A texture: the number of its image, what is taken from that, and the bits of the factors of the channels.
type Key = (usize, Taken, [u64; 3]);

/// A texture.
#[derive(Clone)]
pub(super) struct Texels {
    pub tensor: Tensor<3>,
    /// The largest value of each channel.
    pub largest: [f64; 3],
}

/// The textures of a file's materials.
pub(super) struct Textures<'a> {
    description: &'a Description,
    place: Place<'a>,
    /// What the file takes in memory, and the textures that are in it.
    memory: Memory,
    counted: HashSet<Key>,
    /// Whether textures are only counted: then nothing is decoded, and a texel stands for a texture.
    pub counting: bool,
    /// Columns and rows of images, None of those that can't be read.
    sizes: HashMap<usize, Option<[usize; 2]>>,
    /// Images that were decoded before.
    sound: HashSet<usize>,
    made: HashMap<Key, Texels>,
    /// The image that was decoded last: what is taken from one comes one after the other.
    last: Option<(usize, Decoded)>,
}

impl<'a> Textures<'a> {
    /// Textures that are only counted until [`Self::decode`].
    pub fn new(description: &'a Description, place: Place<'a>) -> Self {
        Self {
            description,
            place,
            memory: description.memory,
            counted: HashSet::new(),
            counting: true,
            sizes: HashMap::new(),
            sound: HashSet::new(),
            made: HashMap::new(),
            last: None,
        }
    }

    /// Decodes images from now on.
    pub fn decode(&mut self) {
        self.counting = false;
        self.made.clear();
    }

    /// A texture, unless its image is missing or is none that is known: then there is a warning, and the surface is as it
    /// is without it.
    ///
    /// # Errors
    /// If the image is larger than the limits, or can't be read and limits are strict.
    pub fn found(&mut self, texture: Option<TextureUse>) -> Result<Option<TextureUse>> {
        let Some(TextureUse { image, .. }) = texture else {
            return Ok(None);
        };
        let mut size = match self.sizes.get(&image) {
            Some(known) => *known,
            None => {
                let size = self.size(image);
                self.unless_faulty(size)?
            }
        };
        if size.is_some() && !self.counting && self.sound.insert(image) {
            let decoded = self.decoded(image).map(|_| ());
            if self.unless_faulty(decoded)?.is_none() {
                size = None;
            }
        }
        self.sizes.insert(image, size);
        Ok(texture.filter(|_| size.is_some()))
    }

    /// What was read of an image; None if it can't be, which is noted.
    fn unless_faulty<T>(&self, read: Result<T>) -> Result<Option<T>> {
        match read {
            Ok(read) => Ok(Some(read)),
            Err(error) => {
                self.description.notes.fault(error, self.place.limits)?;
                Ok(None)
            }
        }
    }

    /// Columns and rows of an image.
    fn size(&mut self, image: usize) -> Result<[usize; 2]> {
        let source = &self.description.images[image];
        let size = match source {
            ImageSource::File(path) => {
                let (file, bytes) = open(path)?;
                self.memory.read = self.memory.read.saturating_add(bytes);
                Decoded::read_size(BufReader::new(file), path)
            }
            ImageSource::Bytes { name, bytes } => Decoded::read_size(Cursor::new(bytes), name),
        }?;
        check_size(size, name(source), self.place.limits)?;
        Ok(size)
    }

    /// Colours in sRGB, times a factor.
    pub fn colours(&mut self, image: usize, factor: [f64; 3]) -> Result<Texels> {
        self.texels((image, Taken::Colours, factor.map(f64::to_bits)))
    }

    /// A normal map, its x and y times a factor.
    pub fn tilts(&mut self, image: usize, factor: f64) -> Result<Tensor<3>> {
        let factors = [factor, factor, 1.0].map(f64::to_bits);
        Ok(self.texels((image, Taken::Tilts, factors))?.tensor)
    }

    /// A channel times a factor.
    pub fn channel(&mut self, image: usize, channel: usize, factor: f64) -> Result<Tensor<2>> {
        let key = (image, Taken::Channel(channel), [factor.to_bits(); 3]);
        Ok(self.texels(key)?.tensor.squeeze_dim(2))
    }

    /// The alpha times a factor.
    pub fn alpha(&mut self, image: usize, factor: f64) -> Result<Tensor<2>> {
        let key = (image, Taken::Alpha, [factor.to_bits(); 3]);
        Ok(self.texels(key)?.tensor.squeeze_dim(2))
    }

    /// A texture of one number or three a texel.
    fn texels(&mut self, key: Key) -> Result<Texels> {
        if let Some(known) = self.made.get(&key) {
            return Ok(known.clone());
        }
        let ((values, [height, width]), channels) = (self.values(key)?, key.1.channels());
        let mut largest = [0.0f32; 3];
        for texel in values.chunks_exact(channels) {
            let both = largest.iter_mut().zip(texel);
            both.for_each(|(largest, &v)| *largest = largest.max(v));
        }
        let data = TensorData::new(values, [height, width, channels]);
        let texels = Texels {
            tensor: Tensor::from_data(data, self.place.device),
            largest: largest.map(f64::from),
        };
        self.made.insert(key, texels.clone());
        Ok(texels)
    }

    /// The numbers of a texture, row by row, and its rows and columns.
    fn values(&mut self, key: Key) -> Result<(Vec<f32>, [usize; 2])> {
        let (image, taken, factors) = key;
        if self.counted.insert(key) {
            self.take(image)?;
        }
        if self.counting {
            return Ok((vec![0.0; taken.channels()], [1, 1]));
        }
        let decoded = self.decoded(image)?;
        let [width, height] = decoded.size();
        let mut values = match taken {
            Taken::Colours => decoded.colours(),
            Taken::Tilts => {
                let shares = decoded.numbers().into_iter();
                shares.map(|v| v * 2.0 - 1.0).collect()
            }
            Taken::Channel(channel) => decoded.channel(channel),
            Taken::Alpha => decoded.alpha(),
        };
        let factors = factors.map(|bits| f64::from_bits(bits) as f32);
        if factors != [1.0; 3] {
            let all = values.iter_mut().zip(factors.iter().cycle());
            all.for_each(|(v, factor)| *v *= factor);
        }
        Ok((values, [height, width]))
    }

    /// Counts the memory of a texture that is made of an image.
    pub fn take(&mut self, image: usize) -> Result<()> {
        // Kernels have three numbers a texel.
        let size = self.sizes.get(&image).copied().flatten().unwrap_or([0; 2]);
        let pixels = size.map(|side| side as u64).into_iter().product();
        let taken = self.memory.take(pixels, 3 * TEXEL, self.place.limits);
        let name = name(&self.description.images[image]).display();
        taken.map_err(|m| Error::format(self.place.path, format!("the image {name} {m}")))
    }

    fn decoded(&mut self, image: usize) -> Result<&Decoded> {
        let known = self.last.take().filter(|(last, _)| *last == image);
        let decoded = match known {
            Some((_, known)) => known,
            None => self.read(image)?,
        };
        Ok(&self.last.insert((image, decoded)).1)
    }

    fn read(&self, image: usize) -> Result<Decoded> {
        match &self.description.images[image] {
            ImageSource::File(path) => Decoded::of_file(path, self.place.limits),
            ImageSource::Bytes { name, bytes } => {
                Decoded::read(Cursor::new(bytes), name, self.place.limits)
            }
        }
    }
}

/// What an image is called in messages.
fn name(source: &ImageSource) -> &Path {
    match source {
        ImageSource::File(path) => path,
        ImageSource::Bytes { name, .. } => name,
    }
}
