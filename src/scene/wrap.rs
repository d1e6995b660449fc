//! Textures outside of the unit square.

/// How texture coordinates outside of [0, 1] are mapped into the image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wrap {
    /// Tiles.
    #[default]
    Repeat,
    /// The border's texel goes on.
    Clamp,
    /// Tiles, every other one mirrored.
    Mirror,
}
