//! Writes EXR files.

use std::io::{Seek, Write};

use exr::prelude::{Image, SpecificChannels, Vec2, WritableImage};

/// What an EXR layer holds: its name, and a comment on how its values are to be read.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layer {
    pub name: &'static str,
    pub comment: &'static str,
}

/// Writes the pixels of an image as one layer of 32-bit floats in the channels R, G and B.
pub(super) fn write_exr(
    file: &mut (impl Write + Seek),
    (width, height): (usize, usize),
    pixels: &[f32],
    layer: Option<Layer>,
) -> exr::error::UnitResult {
    let pixel = |at: Vec2<usize>| {
        let first = 3 * (at.y() * width + at.x());
        (pixels[first], pixels[first + 1], pixels[first + 2])
    };
    let mut image = Image::from_channels((width, height), SpecificChannels::rgb(pixel));
    if let Some(Layer { name, comment }) = layer {
        let attributes = &mut image.layer_data.attributes;
        attributes.layer_name = Some(name.into());
        attributes.comments = Some(comment.into());
    }
    image.write().to_buffered(file)
}
