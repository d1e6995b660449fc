//! Colours that are constant or come from textures, and their bilinear look-up.

use std::sync::Arc;

use glam::DVec3;

use super::triangle::uniform_point;
use super::{V3, v3};
use crate::scene::Wrap;

/// The colours of textures, three numbers each.
#[derive(Clone, Debug, Default)]
pub(crate) struct Texels(pub Vec<f32>);

impl Texels {
    pub fn len(&self) -> usize {
        self.0.len() / 3
    }

    #[inline(always)]
    pub fn at(&self, texel: usize) -> V3 {
        let t = &self.0[3 * texel..3 * texel + 3];
        v3(t[0], t[1], t[2])
    }

    /// Appends a list; the first is not copied, unless others have it too.
    pub fn push(&mut self, numbers: Arc<Vec<f32>>) {
        match Arc::try_unwrap(numbers) {
            Ok(own) if self.0.is_empty() => self.0 = own,
            Ok(own) => self.extend(&own),
            Err(shared) => self.extend(&shared),
        }
    }

    fn extend(&mut self, numbers: &[f32]) {
        // Not twice as much as there is, as a list otherwise grows.
        self.0.reserve_exact(numbers.len());
        self.0.extend_from_slice(numbers);
    }
}

/// Four texels about a point, and the point's place between their centres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    texels: [usize; 4],
    /// Both coordinates in [0, 1).
    at: [f32; 2],
}

impl Cell {
    /// The cell of a point in texels, whose centres are at whole numbers; `texel` is the index of a column
    /// and a row.
    #[inline(always)]
    pub fn new(x: f32, y: f32, texel: impl Fn(i64, i64) -> usize) -> Self {
        let (left, top) = (x.floor(), y.floor());
        let (i, j) = (left as i64, top as i64);
        Self {
            texels: [
                texel(i, j),
                texel(i + 1, j),
                texel(i, j + 1),
                texel(i + 1, j + 1),
            ],
            at: [x - left, y - top],
        }
    }

    #[inline(always)]
    fn weights(&self) -> [f32; 4] {
        let [x, y] = self.at;
        [(1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y]
    }

    /// The colour at the point.
    #[inline(always)]
    pub fn colour(&self, texels: &Texels) -> V3 {
        let mut sum = V3::ZERO;
        for (&t, w) in self.texels.iter().zip(self.weights()) {
            sum += texels.at(t) * w;
        }
        sum
    }

    /// Adds the derivatives of g·colour by the texels, unless that list is empty; returns those by the
    /// point, in texels.
    #[inline(always)]
    pub fn backward(&self, texels: &Texels, g: V3, by_texel: &mut [DVec3]) -> [f32; 2] {
        if !by_texel.is_empty() {
            for (&t, w) in self.texels.iter().zip(self.weights()) {
                by_texel[t] += DVec3::from(g * w);
            }
        }
        let [a, b, c, d] = self.texels.map(|t| texels.at(t).dot(g));
        let [x, y] = self.at;
        [
            (1.0 - y) * (b - a) + y * (d - c),
            (1.0 - x) * (c - a) + x * (d - b),
        ]
    }
}

/// The place of a texture among the texels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Texture {
    pub offset: usize,
    pub width: usize,
    pub height: usize,
    pub wrap: Wrap,
}

impl Texture {
    /// Texel centres are at half-integers, row 0 at the top (v = 1).
    fn cell(&self, uv: [f32; 2]) -> Cell {
        let x = uv[0] * self.width as f32 - 0.5;
        let y = (1.0 - uv[1]) * self.height as f32 - 0.5;
        Cell::new(x, y, |i, j| {
            let column = self.wrap.texel(i, self.width);
            let row = self.wrap.texel(j, self.height);
            self.offset + row * self.width + column
        })
    }

    #[inline(never)]
    pub fn look_up(&self, texels: &Texels, uv: [f32; 2]) -> V3 {
        self.cell(uv).colour(texels)
    }

    /// Adds the derivatives of g·colour by the texels; returns those by the coordinates.
    #[inline(never)]
    pub fn backward(
        &self,
        texels: &Texels,
        uv: [f32; 2],
        g: V3,
        by_texel: &mut [DVec3],
    ) -> [f32; 2] {
        let [by_x, by_y] = self.cell(uv).backward(texels, g, by_texel);
        [by_x * self.width as f32, -by_y * self.height as f32]
    }
}

/// A colour of a material: constant, or a texture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Colour {
    pub constant: V3,
    pub texture: Option<Texture>,
}

impl Colour {
    #[inline(always)]
    pub fn at(&self, texels: &Texels, uv: [f32; 2]) -> V3 {
        match &self.texture {
            None => self.constant,
            Some(texture) => texture.look_up(texels, uv),
        }
    }

    /// The mean over a triangle with these coordinates at its corners, about: of all channels, without their signs.
    pub fn mean_over(&self, texels: &Texels, uvs: [[f32; 2]; 3]) -> f32 {
        let mean = |colour: V3| colour.abs().element_sum() / 3.0;
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

    /// Adds the derivatives of g·colour by the constant or the texels; returns those by the coordinates.
    #[inline(always)]
    pub fn backward(
        &self,
        texels: &Texels,
        uv: [f32; 2],
        g: V3,
        (constant, by_texel): (&mut DVec3, &mut [DVec3]),
    ) -> [f32; 2] {
        match &self.texture {
            None => {
                *constant += DVec3::from(g);
                [0.0; 2]
            }
            Some(texture) => texture.backward(texels, uv, g, by_texel),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A texture of 3 × 2 texels, each channel another, after one that is not looked at.
    fn textures() -> (Texels, Texture) {
        let texels = Texels((0..21).map(|i| (0.7 * i as f32).sin()).collect());
        let texture = Texture {
            offset: 1,
            width: 3,
            height: 2,
            wrap: Wrap::Mirror,
        };
        (texels, texture)
    }

    #[test]
    fn the_middle_of_a_texel_has_its_colour() {
        let (texels, texture) = textures();
        assert_eq!(texture.look_up(&texels, [0.5, 0.75]), texels.at(2));
        assert_eq!(texture.look_up(&texels, [0.5, 0.25]), texels.at(5));
    }

    #[test]
    fn derivatives_by_texels_and_coordinates() {
        let (mut texels, texture) = textures();
        let g = v3(0.3, -0.8, 0.5);
        for uv in [[0.4, 0.55], [0.95, 0.1], [-0.3, 1.4]] {
            let mut by_texel = vec![DVec3::ZERO; texels.len()];
            let by_uv = texture.backward(&texels, uv, g, &mut by_texel);
            let h = 1e-3;
            for k in 0..2 {
                let at = |h: f32| {
                    let mut uv = uv;
                    uv[k] += h;
                    g.dot(texture.look_up(&texels, uv))
                };
                let wanted = (at(h) - at(-h)) / (2.0 * h);
                assert!(
                    (by_uv[k] - wanted).abs() < 1e-3,
                    "{uv:?}: {by_uv:?} {wanted}"
                );
            }
            for (t, by) in by_texel.iter().enumerate() {
                let before = g.dot(texture.look_up(&texels, uv));
                texels.0[3 * t + 1] += 1.0;
                let wanted = g.dot(texture.look_up(&texels, uv)) - before;
                texels.0[3 * t + 1] -= 1.0;
                assert!((by.y - f64::from(wanted)).abs() < 1e-5, "{t}");
            }
        }
    }
}
