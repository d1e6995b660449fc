//! Textures.

use std::sync::Arc;

use super::Wrap;

/// A color, or an image of colors.
pub enum HostTexture {
    /// RGB; a number is the first of three.
    Constant([f64; 3]),
    /// An image that is looked up bilinearly.
    Image {
        /// RGB, row by row. Textures of one untracked tensor share them.
        texels: Arc<Vec<f32>>,
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// What is outside of the unit square.
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
