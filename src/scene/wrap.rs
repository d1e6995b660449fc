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
    /// The texels about a point of an image of so many columns and rows, and their shares in its bilinear value. The
    /// point is in texels, whose centres are at whole numbers.
    #[inline(always)]
    pub(crate) fn bilinear(
        self,
        [x, y]: [f32; 2],
        [width, height]: [usize; 2],
    ) -> [(usize, f32); 4] {
        let (left, top) = (x.floor(), y.floor());
        let (x, y) = (x - left, y - top);
        let [a, b] = [0, 1].map(|i| self.texel(left as i64 + i, width));
        let [above, below] = [0, 1].map(|j| self.texel(top as i64 + j, height) * width);
        [
            (above + a, (1.0 - x) * (1.0 - y)),
            (above + b, x * (1.0 - y)),
            (below + a, (1.0 - x) * y),
            (below + b, x * y),
        ]
    }

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
