//! Wrap modes of textures.

/// The mapping of texture coordinates outside of [0, 1] into the image. The default is `Repeat`.
///
/// `TextureParams` has an example.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Wrap {
    /// The image is tiled.
    #[default]
    Repeat,
    /// The texels of the border continue.
    Clamp,
    /// The image is tiled, with every other tile mirrored.
    Mirror,
}
