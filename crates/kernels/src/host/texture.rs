//! Textures.

use std::sync::Arc;

use super::Wrap;

/// A color, or an image of colors.
pub enum HostTexture {
    Constant([f64; 3]),
    Image {
        /// RGB, row by row. Textures of one untracked tensor share them.
        texels: Arc<Vec<f32>>,
        width: usize,
        height: usize,
        wrap: Wrap,
    },
}

impl HostTexture {
    /// Whether any value is other than 0.
    pub fn shines(&self) -> bool {
        match self {
            Self::Constant(c) => *c != [0.0; 3],
            Self::Image { texels, .. } => texels.iter().any(|&v| v != 0.0),
        }
    }
}
