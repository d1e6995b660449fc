//! The texels of an atlas and the points of the surface at them.

use glam::DVec2;
use rayon::prelude::*;

use super::overlap::extent;

/// The rows that one task fills.
const ROWS: usize = 32;

/// A texel that belongs to a face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Texel {
    /// Its place: row · size + column, row 0 at v = 1.
    pub index: u32,
    /// The face.
    pub face: u32,
    /// The barycentric coordinates of the face's point that is nearest to the texel's center: the center itself if it
    /// lies on the face.
    pub barycentric: [f32; 3],
    /// Whether the center lies outside of all faces of the chart.
    pub in_gutter: bool,
}

/// The texels of an atlas that belong to faces: those with centers on a face, and those of the gutters, which belong
/// to the nearest face of a chart within half the gutter along each axis. All texels that a bilinear lookup at a
/// point of the surface reads are among them.
///
/// [The module](super) has an example.
#[derive(Clone, Debug)]
pub struct Texels {
    size: usize,
    list: Vec<Texel>,
    charts: Vec<u32>,
}

impl Texels {
    /// Finds the texels of an atlas of `size` × `size` texels: the texture coordinates, their rows for each face, and
    /// the chart of each face.
    pub(super) fn new(
        size: usize,
        gutter: usize,
        uvs: &[[f64; 2]],
        faces: &[[u32; 3]],
        charts: &[u32],
    ) -> Self {
        // Rows go down, v goes up.
        let place = |&[u, v]: &[f64; 2]| DVec2::new(u, 1.0 - v) * size as f64;
        let points: Vec<DVec2> = uvs.iter().map(place).collect();
        let margin = 0.5 * gutter as f64;
        let bands = size.div_ceil(ROWS);
        let mut of_band: Vec<Vec<u32>> = vec![Vec::new(); bands];
        for (f, face) in faces.iter().enumerate() {
            let y = face.map(|v| points[v as usize].y);
            let low = y[0].min(y[1]).min(y[2]) - margin;
            let high = y[0].max(y[1]).max(y[2]) + margin;
            let last = (high.max(0.0) as usize / ROWS).min(bands - 1);
            for band in &mut of_band[(low.max(0.0) as usize / ROWS).min(last)..=last] {
                band.push(f as u32);
            }
        }
        let lists = of_band.par_iter().enumerate().map(|(band, list)| {
            let mut rows = Band::new(band * ROWS, size);
            for &f in list {
                rows.draw(f, faces[f as usize].map(|v| points[v as usize]), margin);
            }
            rows.list()
        });
        let lists: Vec<Vec<Texel>> = lists.collect();
        Self {
            size,
            list: lists.concat(),
            charts: charts.to_vec(),
        }
    }

    /// The texels that belong to faces, ordered by their places.
    pub fn list(&self) -> &[Texel] {
        &self.list
    }

    /// The number of texels along each side of the atlas.
    pub fn size(&self) -> usize {
        self.size
    }

    /// The number of faces of the atlas.
    pub fn faces(&self) -> usize {
        self.charts.len()
    }

    /// Makes a texture `[size, size, N]`, row 0 at v = 1, from a function of a face and barycentric coordinates.
    /// Texels that belong to no face have the mean of all others.
    pub fn bake<const N: usize>(
        &self,
        value: impl Fn(u32, [f64; 3]) -> [f32; N] + Sync,
    ) -> Vec<f32> {
        let at = |t: &Texel| value(t.face, t.barycentric.map(f64::from));
        let values: Vec<[f32; N]> = self.list.par_iter().map(at).collect();
        self.scatter(&values)
    }

    /// Makes a texture `[size, size, N]` from the values of [`Texels::list`], in its order. Texels that belong to no
    /// face have the mean of all others. Missing values are 0.
    pub fn scatter<const N: usize>(&self, values: &[[f32; N]]) -> Vec<f32> {
        let count = values.len().max(1) as f64;
        let sum = |c: usize| values.iter().map(|v| f64::from(v[c])).sum::<f64>();
        let mean: [f32; N] = std::array::from_fn(|c| (sum(c) / count) as f32);
        let mut texture = mean.repeat(self.size * self.size);
        let zero = [0.0; N];
        let values = values.iter().chain(std::iter::repeat(&zero));
        for (texel, value) in self.list.iter().zip(values) {
            let at = texel.index as usize * N;
            texture[at..at + N].copy_from_slice(value);
        }
        texture
    }

    /// Pairs of texels of the same chart, side by side or one above the other, as their places row · size + column. A
    /// regularizer of textures compares their values; [`Atlas::seam_pairs`](super::Atlas::seam_pairs) has the pairs
    /// across seams.
    pub fn neighbors(&self) -> Vec<[u32; 2]> {
        let size = self.size as u32;
        let chart = |t: &Texel| self.charts[t.face as usize];
        let mut below = 0;
        let mut pairs = Vec::new();
        for (k, texel) in self.list.iter().enumerate() {
            if let Some(next) = self.list.get(k + 1)
                && next.index == texel.index + 1
                && next.index % size != 0
                && chart(next) == chart(texel)
            {
                pairs.push([texel.index, next.index]);
            }
            while self
                .list
                .get(below)
                .is_some_and(|t| t.index < texel.index + size)
            {
                below += 1;
            }
            if let Some(next) = self.list.get(below)
                && next.index == texel.index + size
                && chart(next) == chart(texel)
            {
                pairs.push([texel.index, next.index]);
            }
        }
        pairs
    }
}

/// The square of a distance, and the face and the barycentric coordinates of the nearest point.
type Found = (f32, Option<(u32, [f32; 3])>);

/// Some rows of texels, with the nearest face of each and the square of its distance.
struct Band {
    first: usize,
    size: usize,
    nearest: Vec<Found>,
}

impl Band {
    fn new(first: usize, size: usize) -> Self {
        let rows = ROWS.min(size - first);
        Self {
            first,
            size,
            nearest: vec![(f32::INFINITY, None); rows * size],
        }
    }

    /// Draws a triangle and the texels within `margin` of it along each axis.
    fn draw(&mut self, face: u32, t: [DVec2; 3], margin: f64) {
        let rows = self.nearest.len() / self.size;
        let low = t.iter().fold(f64::INFINITY, |m, p| m.min(p.y)) - margin;
        let high = t.iter().fold(f64::NEG_INFINITY, |m, p| m.max(p.y)) + margin;
        let from = ((low - 0.5).ceil().max(0.0) as usize).max(self.first);
        for row in from..self.first + rows {
            let y = row as f64 + 0.5;
            if y > high {
                return;
            }
            let Some([left, right]) = extent(t, y - margin, y + margin) else {
                continue;
            };
            let from = (left - margin - 0.5).ceil().max(0.0) as usize;
            let to = ((right + margin - 0.5).floor() + 1.0).clamp(0.0, self.size as f64) as usize;
            for column in from..to {
                let center = DVec2::new(column as f64 + 0.5, y);
                let (square, barycentric) = nearest(t, center);
                let place = &mut self.nearest[(row - self.first) * self.size + column];
                if (square as f32) < place.0 {
                    *place = (square as f32, Some((face, barycentric.map(|b| b as f32))));
                }
            }
        }
    }

    fn list(&self) -> Vec<Texel> {
        let start = self.first * self.size;
        let texels = self.nearest.iter().enumerate();
        let texels = texels.filter_map(|(k, &(square, found))| {
            let (face, barycentric) = found?;
            Some(Texel {
                index: (start + k) as u32,
                face,
                barycentric,
                in_gutter: square > 0.0,
            })
        });
        texels.collect()
    }
}

/// The square of the distance of a point from a triangle, and the barycentric coordinates of the nearest point.
fn nearest(t: [DVec2; 3], p: DVec2) -> (f64, [f64; 3]) {
    let area = (t[1] - t[0]).perp_dot(t[2] - t[0]);
    let part = |i: usize| (t[(i + 1) % 3] - p).perp_dot(t[(i + 2) % 3] - p) / area;
    let inside = [0, 1, 2].map(part);
    if inside.iter().all(|b| *b >= 0.0) {
        return (0.0, inside);
    }
    let mut best = (f64::INFINITY, [1.0, 0.0, 0.0]);
    for i in 0..3 {
        let (j, along) = ((i + 1) % 3, t[(i + 1) % 3] - t[i]);
        let part = (p - t[i]).dot(along) / along.length_squared();
        let part = if part.is_finite() {
            part.clamp(0.0, 1.0)
        } else {
            0.0
        };
        let square = p.distance_squared(t[i] + along * part);
        if square < best.0 {
            let mut barycentric = [0.0; 3];
            barycentric[i] = 1.0 - part;
            barycentric[j] = part;
            best = (square, barycentric);
        }
    }
    best
}
