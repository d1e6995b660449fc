//! Colors that are constant or come from textures, alpha masks, and bilinear image lookup.

use std::sync::Arc;

use super::lists::vector;
use super::triangle::uniform_point;
use super::{V2, V3, v2};
use crate::cube::*;
use crate::host::{Holes, OF_MASKED, Wrap};

/// The texels of all textures, three floats each.
#[derive(Clone, Debug, Default)]
pub struct Texels(pub Vec<f32>);

impl Texels {
    pub fn count(&self) -> usize {
        self.0.len() / 3
    }

    /// Appends a list. The first list is moved instead of copied, unless it is shared.
    pub fn push(&mut self, numbers: Arc<Vec<f32>>) {
        match Arc::try_unwrap(numbers) {
            Ok(own) if self.0.is_empty() => self.0 = own,
            Ok(own) => self.extend(&own),
            Err(shared) => self.extend(&shared),
        }
    }

    fn extend(&mut self, numbers: &[f32]) {
        // Reserve exactly, as a vector would otherwise double its capacity.
        self.0.reserve_exact(numbers.len());
        self.0.extend_from_slice(numbers);
    }
}

/// The four texels around a point, as indices into a list, and the point's position between their centers.
#[apply(zeroed!)]
pub struct Cell {
    pub a: u32,
    pub b: u32,
    pub c: u32,
    pub d: u32,
    /// In [0, 1).
    pub x: f32,
    pub y: f32,
}

#[cfg_attr(feature = "gpu", cube)]
impl Cell {
    /// Returns texel `k` of the cell, 0 … 3; [`Cell::share`] is its bilinear weight at the point.
    #[inline(always)]
    pub fn texel(&self, k: u32) -> u32 {
        let mut texel = self.a;
        if k == 1 {
            texel = self.b;
        } else if k == 2 {
            texel = self.c;
        } else if k == 3 {
            texel = self.d;
        }
        texel
    }

    #[inline(always)]
    pub fn share(&self, k: u32) -> f32 {
        let x = self.x;
        let x = select(k & 1 == 0, 1.0 - x, x);
        let y = self.y;
        let y = select(k < 2, 1.0 - y, y);
        x * y
    }

    /// Returns the interpolated value of single-channel texels, which start at index `from`.
    #[inline(always)]
    pub fn number(&self, list: &[f32], from: u32) -> f32 {
        list[(from + self.a) as usize] * self.share(0)
            + list[(from + self.b) as usize] * self.share(1)
            + list[(from + self.c) as usize] * self.share(2)
            + list[(from + self.d) as usize] * self.share(3)
    }

    /// Returns the interpolated color of three-channel texels, which start at index `from`.
    #[inline(always)]
    pub fn color(&self, list: &[f32], from: u32) -> V3 {
        vector(list, from + 3 * self.a) * self.share(0)
            + vector(list, from + 3 * self.b) * self.share(1)
            + vector(list, from + 3 * self.c) * self.share(2)
            + vector(list, from + 3 * self.d) * self.share(3)
    }

    /// Returns the derivatives of g·color with respect to the point, in texels.
    #[inline(always)]
    pub fn slopes(&self, list: &[f32], from: u32, g: V3) -> V2 {
        let a = vector(list, from + 3 * self.a).dot(g);
        let b = vector(list, from + 3 * self.b).dot(g);
        let c = vector(list, from + 3 * self.c).dot(g);
        let d = vector(list, from + 3 * self.d).dot(g);
        v2(
            (1.0 - self.y) * (b - a) + self.y * (d - c),
            (1.0 - self.x) * (c - a) + self.x * (d - b),
        )
    }
}

/// Wrap modes of an image: the values of [`Wrap`], and columns that repeat with rows that are clamped.
const CLAMP: u32 = Wrap::Clamp as u32;
const MIRROR: u32 = Wrap::Mirror as u32;
pub const AROUND: u32 = 3;

/// Returns the column or row for any integer under a wrap mode.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn wrapped(i: i32, size: u32, wrap: u32) -> u32 {
    let n = size as i32;
    let mut texel = i.max(0).min(n - 1);
    if wrap != CLAMP {
        let period = select(wrap == MIRROR, 2 * n, n);
        texel = ((i % period) + period) % period;
        texel = select(texel >= n, 2 * n - 1 - texel, texel);
    }
    texel as u32
}

/// Columns and rows are clamped to this magnitude.
const FAR: f32 = 1e9;

/// An image in a list of texels: the index of its first texel, its size, and its wrap mode.
#[apply(record!)]
pub struct Texture {
    pub first: u32,
    pub width: u32,
    pub height: u32,
    pub wrap: u32,
}

#[cfg_attr(feature = "gpu", cube)]
impl Texture {
    /// Returns the cell of a point in texels, whose centers are at integers.
    #[inline(always)]
    pub fn cell(&self, x: f32, y: f32) -> Cell {
        let left = x.floor();
        let top = y.floor();
        let i = min(max(left, -FAR), FAR) as i32;
        let j = min(max(top, -FAR), FAR) as i32;
        let rows = self.wrap;
        let rows = select(rows == AROUND, CLAMP, rows);
        let above = self.first + wrapped(j, self.height, rows) * self.width;
        let below = self.first + wrapped(j + 1, self.height, rows) * self.width;
        let before = wrapped(i, self.width, self.wrap);
        let behind = wrapped(i + 1, self.width, self.wrap);
        Cell {
            a: above + before,
            b: above + behind,
            c: below + before,
            d: below + behind,
            x: x - left,
            y: y - top,
        }
    }

    /// Returns the cell of texture coordinates. Texel centers are at half-integers, and row 0 is at the top (v = 1).
    #[inline(always)]
    pub fn cell_at(&self, uv: V2) -> Cell {
        let x = uv.x * self.width as f32 - 0.5;
        let y = (1.0 - uv.y) * self.height as f32 - 0.5;
        self.cell(x, y)
    }

    /// Turns derivatives with respect to a cell's point into those with respect to texture coordinates.
    #[inline(always)]
    pub fn by_coordinates(&self, by: V2) -> V2 {
        v2(by.x * self.width as f32, -by.y * self.height as f32)
    }
}

impl Texture {
    /// Makes a texture of the given width and height.
    pub fn new(first: usize, [width, height]: [usize; 2], wrap: Wrap) -> Self {
        Self {
            first: first as u32,
            width: width as u32,
            height: height as u32,
            wrap: wrap as u32,
        }
    }

    /// Returns its words in a list.
    pub fn words(&self) -> [u32; 4] {
        [self.first, self.width, self.height, self.wrap]
    }
}

/// Reads the image whose words start at index `at`.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn texture_at(words: &[u32], at: u32) -> Texture {
    let i = at as usize;
    let wrap = words[i + 3];
    Texture {
        first: words[i],
        width: words[i + 1],
        height: words[i + 2],
        wrap,
    }
}

/// The alpha masks of triangles.
#[cfg_attr(feature = "gpu", derive(CubeType))]
#[derive(Clone, Copy)]
pub struct Masks<'a> {
    /// The index of each triangle among the triangles with a mask, `u32::MAX` for a triangle without one.
    pub masked: &'a [u32],
    /// For each triangle with a mask: its image, and [`OF_MASKED`] floats, which are the texture coordinates of its
    /// corners and the alpha below which it has a hole.
    pub images: &'a [u32],
    pub uvs: &'a [f32],
    pub alphas: &'a [f32],
}

#[cfg_attr(feature = "gpu", cube)]
impl<'a> Masks<'a> {
    /// Returns whether a triangle has a hole at the point with these barycentric weights.
    #[inline(always)]
    pub fn open(&self, triangle: u32, weights: V3) -> bool {
        let place = self.masked[triangle as usize];
        let mut open = false;
        if place != u32::MAX {
            open = self.open_at(place, weights);
        }
        open
    }

    /// [`Masks::open`] of a triangle with a mask, by its index among those.
    #[inline(never)]
    pub fn open_at(&self, place: u32, weights: V3) -> bool {
        let of = &self.uvs[OF_MASKED * place as usize..];
        let cutoff = of[6];
        let uv = v2(
            of[0] * weights.x + of[2] * weights.y + of[4] * weights.z,
            of[1] * weights.x + of[3] * weights.y + of[5] * weights.z,
        );
        let cell = texture_at(self.images, 4 * place).cell_at(uv);
        cell.number(self.alphas, 0u32) < cutoff
    }
}

impl Holes {
    #[inline(always)]
    pub fn masks(&self) -> Masks<'_> {
        Masks {
            masked: &self.of_triangle,
            images: &self.images,
            uvs: &self.uvs,
            alphas: &self.alphas,
        }
    }
}

/// A color of a material: constant, or a texture.
#[derive(Clone, Copy, Debug)]
pub struct Color {
    pub constant: V3,
    pub texture: Option<Texture>,
}

impl Color {
    #[inline(always)]
    pub fn at(&self, texels: &Texels, uv: [f32; 2]) -> V3 {
        match &self.texture {
            None => self.constant,
            Some(texture) => texture.cell_at(v2(uv[0], uv[1])).color(&texels.0, 0),
        }
    }

    /// Returns approximately the mean of the absolute channel values over a triangle with these texture coordinates
    /// at its corners.
    pub fn mean_over(&self, texels: &Texels, uvs: [[f32; 2]; 3]) -> f32 {
        let mean = |color: V3| color.abs().element_sum() / 3.0;
        if self.texture.is_none() {
            return mean(self.constant);
        }
        const SIDE: usize = 16;
        let of_part = |i: usize| {
            let [u, v] = [i % SIDE, i / SIDE].map(|k| (k as f32 + 0.5) / SIDE as f32);
            let on = uniform_point(u, v);
            let weights = [1.0 - on.x - on.y, on.x, on.y];
            let at = |c: usize| (0..3).map(|k| uvs[k][c] * weights[k]).sum();
            mean(self.at(texels, [at(0), at(1)]))
        };
        (0..SIDE * SIDE).map(of_part).sum::<f32>() / (SIDE * SIDE) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::v3;

    /// A texture of 3 × 2 texels with different channels, behind one texel that is not part of it.
    fn textures() -> (Texels, Texture) {
        let texels = Texels((0..21).map(|i| (0.7 * i as f32).sin()).collect());
        let texture = Texture {
            first: 1,
            width: 3,
            height: 2,
            wrap: MIRROR,
        };
        (texels, texture)
    }

    fn look_up((texels, texture): &(Texels, Texture), [u, v]: [f32; 2]) -> V3 {
        texture.cell_at(v2(u, v)).color(&texels.0, 0)
    }

    #[test]
    fn the_middle_of_a_texel_has_its_color() {
        let image = textures();
        let texel = |k: u32| vector(&image.0.0, 3 * k);
        assert_eq!(look_up(&image, [0.5, 0.75]), texel(2));
        assert_eq!(look_up(&image, [0.5, 0.25]), texel(5));
    }

    #[test]
    fn derivatives_by_texels_and_coordinates() {
        let mut image = textures();
        let g = v3(0.3, -0.8, 0.5);
        for uv in [[0.4, 0.55], [0.95, 0.1], [-0.3, 1.4]] {
            let (texels, texture) = &image;
            let cell = texture.cell_at(v2(uv[0], uv[1]));
            let by = texture.by_coordinates(cell.slopes(&texels.0, 0, g));
            let h = 1e-3;
            for (k, by) in [by.x, by.y].into_iter().enumerate() {
                let at = |h: f32| {
                    let mut uv = uv;
                    uv[k] += h;
                    g.dot(look_up(&image, uv))
                };
                let wanted = (at(h) - at(-h)) / (2.0 * h);
                assert!((by - wanted).abs() < 1e-3, "{uv:?}: {by:?} {wanted}");
            }
            for t in 0..image.0.count() {
                let shares = (0..4).filter(|&k| cell.texel(k) as usize == t);
                let share: f32 = shares.map(|k| cell.share(k)).sum();
                let before = look_up(&image, uv).y;
                image.0.0[3 * t + 1] += 1.0;
                let wanted = look_up(&image, uv).y - before;
                image.0.0[3 * t + 1] -= 1.0;
                assert!((share - wanted).abs() < 1e-5, "{t}");
            }
        }
    }
}
