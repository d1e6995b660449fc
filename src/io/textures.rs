//! Textures of materials from images of a file. Each texture is made once, however many materials use it. The image
//! decoded last is kept, so that several textures of one image share the decoding.

use std::collections::{HashMap, HashSet};
use std::io::Cursor;
use std::path::Path;

use burn::tensor::{Tensor, TensorData};

use super::decode::{Decoded, check_size};
use super::description::{Description, ImageSource, TextureUse};
use super::files::Place;
use super::limits::{Memory, TEXEL};
use crate::error::{Error, Result};

/// The part of an image that a texture uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Taken {
    /// Linear RGB, decoded from sRGB.
    Colors,
    /// A normal map.
    Tilts,
    /// A channel without color conversion.
    Channel(usize),
    Alpha,
}

impl Taken {
    fn channels(self) -> usize {
        match self {
            Self::Colors | Self::Tilts => 3,
            Self::Channel(_) | Self::Alpha => 1,
        }
    }
}

/// The key of a texture: the index of its image, the part of the image, and the bits of the channels' factors.
type Key = (usize, Taken, [u64; 3]);

/// A texture on the device.
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
    /// The memory that the file takes, and the textures that it includes.
    memory: Memory,
    counted: HashSet<Key>,
    /// Whether textures are only counted. If so, nothing is decoded, and every texture has a single texel.
    pub counting: bool,
    /// Columns and rows of images, `None` for images that cannot be read.
    sizes: HashMap<usize, Option<[usize; 2]>>,
    /// Images whose decoding was tried.
    sound: HashSet<usize>,
    made: HashMap<Key, Texels>,
    /// The image that was decoded last. Textures of one image usually follow each other.
    last: Option<(usize, Decoded)>,
}

impl<'a> Textures<'a> {
    /// Creates textures that are only counted until [`Self::decode`].
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

    /// Starts the decoding of images.
    pub fn decode(&mut self) {
        self.counting = false;
        self.made.clear();
    }

    /// Returns a texture unless its image is missing or of an unknown format. In this case there is a warning, and
    /// the surface is rendered without the texture.
    ///
    /// # Errors
    /// If the image exceeds the limits, or cannot be read and limits are strict.
    pub fn available(&mut self, texture: Option<TextureUse>) -> Result<Option<TextureUse>> {
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

    /// Returns the result of reading an image. A failure becomes `None` and a warning.
    fn unless_faulty<T>(&self, read: Result<T>) -> Result<Option<T>> {
        match read {
            Ok(read) => Ok(Some(read)),
            Err(error) => {
                self.description.notes.fault(error, &self.place.files)?;
                Ok(None)
            }
        }
    }

    /// Returns the columns and rows of an image.
    fn size(&mut self, image: usize) -> Result<[usize; 2]> {
        let source = &self.description.images[image];
        let size = match source {
            ImageSource::File { path, named_by } => {
                let read = self.place.files.open(path).and_then(|(file, bytes)| {
                    self.memory.read = self.memory.read.saturating_add(bytes);
                    Decoded::read_size(file, path)
                });
                read.map_err(|e| e.named_by(named_by))
            }
            ImageSource::Bytes { name, bytes } => Decoded::read_size(Cursor::new(bytes), name),
        }?;
        check_size(size, name(source), &self.place.files)?;
        Ok(size)
    }

    /// Returns linear RGB, multiplied by a factor.
    pub fn colors(&mut self, image: usize, factor: [f64; 3]) -> Result<Texels> {
        self.texels((image, Taken::Colors, factor.map(f64::to_bits)))
    }

    /// Returns a normal map with its x and y multiplied by a factor.
    pub fn tilts(&mut self, image: usize, factor: f64) -> Result<Tensor<3>> {
        let factors = [factor, factor, 1.0].map(f64::to_bits);
        Ok(self.texels((image, Taken::Tilts, factors))?.tensor)
    }

    /// Returns a channel multiplied by a factor.
    pub fn channel(&mut self, image: usize, channel: usize, factor: f64) -> Result<Tensor<2>> {
        let key = (image, Taken::Channel(channel), [factor.to_bits(); 3]);
        Ok(self.texels(key)?.tensor.squeeze_dim(2))
    }

    /// Returns the alpha multiplied by a factor.
    pub fn alpha(&mut self, image: usize, factor: f64) -> Result<Tensor<2>> {
        let key = (image, Taken::Alpha, [factor.to_bits(); 3]);
        Ok(self.texels(key)?.tensor.squeeze_dim(2))
    }

    /// Returns a texture with one or three numbers per texel.
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

    /// Returns the numbers of a texture, row by row, and its rows and columns.
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
            Taken::Colors => decoded.colors(),
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

    /// Counts the memory of a texture that is made from an image.
    pub fn take(&mut self, image: usize) -> Result<()> {
        // Kernels store three numbers per texel.
        let size = self.sizes.get(&image).copied().flatten().unwrap_or([0; 2]);
        let pixels = size.map(|side| side as u64).into_iter().product();
        let taken = self.memory.take(pixels, 3 * TEXEL, &self.place.files);
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
            ImageSource::File { path, named_by } => {
                let decoded = Decoded::of_file(path, self.place.files);
                decoded.map_err(|e| e.named_by(named_by))
            }
            ImageSource::Bytes { name, bytes } => {
                Decoded::read(Cursor::new(bytes), name, &self.place.files)
            }
        }
    }
}

/// Returns the name of an image in messages.
fn name(source: &ImageSource) -> &Path {
    match source {
        ImageSource::File { path, .. } => path,
        ImageSource::Bytes { name, .. } => name,
    }
}
