//! Writes EXR files.

use std::io::{Seek, Write};

use exr::prelude::{Image, SpecificChannels, Vec2, WritableImage};

use super::HostImage;

/// What an EXR layer holds: its name, and a comment on how its values are to be read.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layer {
    pub name: &'static str,
    pub comment: &'static str,
}

impl HostImage {
    /// Writes one layer of 32-bit floats in the channels R, G and B.
    pub(super) fn write_exr(
        &self,
        file: &mut (impl Write + Seek),
        layer: Option<Layer>,
    ) -> exr::error::UnitResult {
        let pixel = |at: Vec2<usize>| {
            let first = 3 * (at.y() * self.width + at.x());
            (
                self.pixels[first],
                self.pixels[first + 1],
                self.pixels[first + 2],
            )
        };
        let size = (self.width, self.height);
        let mut image = Image::from_channels(size, SpecificChannels::rgb(pixel));
        if let Some(Layer { name, comment }) = layer {
            let attributes = &mut image.layer_data.attributes;
            attributes.layer_name = Some(name.into());
            attributes.comments = Some(comment.into());
        }
        image.write().to_buffered(file)
    }
}
