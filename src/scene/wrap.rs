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

impl Wrap {
    /// The texel for any integer coordinate.
    pub(crate) fn texel(self, i: i64, size: usize) -> usize {
        let n = size as i64;
        match self {
            Self::Repeat => i.rem_euclid(n) as usize,
            Self::Clamp => i.clamp(0, n - 1) as usize,
            Self::Mirror => {
                let j = i.rem_euclid(2 * n);
                (if j < n { j } else { 2 * n - 1 - j }) as usize
            }
        }
    }
}
