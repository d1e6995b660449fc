//! Triangles and materials of a packed scene.

use super::texture::Colour;
use crate::model::V3;
use crate::scene::{CHANNELS, Channel, MaterialKind};

/// A triangle, in inner coordinates at the start of the shutter.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Triangle {
    pub corners: [V3; 3],
    /// Unit normal of the front.
    pub normal: V3,
    /// normal · corner.
    pub plane: f32,
    pub area: f32,
    pub material: u32,
    pub object: u32,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Material {
    /// In the order of [`Channel::ALL`].
    pub channels: [Colour; CHANNELS],
    pub kind: MaterialKind,
}

impl Material {
    pub fn emission(&self) -> V3 {
        self.channels[Channel::Emission as usize].constant
    }

    pub fn is_textured(&self) -> bool {
        self.channels.iter().any(|c| c.texture.is_some())
    }
}
