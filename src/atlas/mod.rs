//! Texture atlases: texture coordinates for any mesh, textures baked from functions of its surface, and textures moved
//! from one mesh to another.
//!
//! ```
//! use softray::atlas::{Atlas, AtlasOptions};
//! let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
//! let faces = [[0, 1, 2], [0, 2, 3]];
//! let atlas = Atlas::new(&positions, &faces, 64, &AtlasOptions::default())?;
//! assert_eq!((atlas.faces.len(), atlas.chart_count()), (2, 1));
//! // A texture `[64, 64, 1]` of the first coordinate.
//! let texture = atlas.texels().bake(|face, at| {
//!     let corners = faces[face as usize].map(|v| positions[v as usize][0]);
//!     [(0..3).map(|i| corners[i] * at[i]).sum::<f64>() as f32]
//! });
//! assert_eq!(texture.len(), 64 * 64);
//! # Ok::<(), softray::Error>(())
//! ```

mod arap;
mod cells;
mod crevice;
mod flatten;
mod grow;
mod nearest;
mod overlap;
mod pack;
mod seams;
mod surface;
#[cfg(test)]
mod tests;
mod texels;
mod transfer;

pub use nearest::{Nearest, NearestFaces};
pub use texels::{Texel, Texels};
pub use transfer::{Textured, lookup, transfer};

use crate::error::{Error, Result};
use surface::{Surface, check};

/// The smallest gutter: bilinear lookups reach one texel beyond a chart.
const LEAST_GUTTER: usize = 2;
/// Charts are made for the density at which their area is this part of the atlas, and again if it is lower.
const USED: f64 = 0.5;
/// How often charts are made.
const ROUNDS: usize = 4;
/// The largest atlas, texels along a side.
const MOST_TEXELS: usize = 32768;

/// Settings of an [`Atlas`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AtlasOptions {
    /// The smallest distance between two charts, in texels: at least 2. Half of it lies between charts and the sides of the
    /// atlas.
    pub gutter: usize,
    /// The largest angle between a normal and the mean normal of its chart, in degrees, from 10 to 75. Normals are smoothed
    /// over neighbors first. Larger angles give fewer charts with more distortion.
    pub max_angle: f64,
}

impl Default for AtlasOptions {
    fn default() -> Self {
        Self {
            gutter: 4,
            max_angle: 60.0,
        }
    }
}

/// Texture coordinates of a mesh: it is cut into charts, which are flattened with low distortion and packed into a square.
///
/// Charts are sets of faces with similar normals. No two faces overlap in texture space, and all have an area there, so
/// each point of the surface has texels of its own. The number of texels for an area of the surface is about the same
/// everywhere. Vertices at the same position count as one. Faces without area, and faces at edges of more than two faces or
/// of two with the same direction, are not joined across these edges.
///
/// [The module](self) has an example.
#[derive(Clone, Debug)]
pub struct Atlas {
    /// Texture coordinates (u, v) in [0, 1], v upwards: the texels' row 0 is at v = 1.
    pub uvs: Vec<[f64; 2]>,
    /// Rows of `uvs` for the three corners of each face of the mesh.
    pub faces: Vec<[u32; 3]>,
    /// The chart of each face.
    pub charts: Vec<u32>,
    /// The number of texels along each side.
    pub size: usize,
    /// The texels along a unit of length on the surface.
    pub density: f64,
    /// The smallest distance between two charts, in texels.
    pub gutter: usize,
    /// The edges between charts: their two ends on one side, then on the other.
    seams: Vec<[[u32; 2]; 2]>,
}

impl Atlas {
    /// Makes an atlas of `size` × `size` texels for a mesh of any topology.
    ///
    /// Charts are flattened as rigidly as possible (Liu et al. 2008, *A Local/Global Approach to Mesh
    /// Parameterization*). Those that would overlap themselves are divided.
    ///
    /// # Errors
    /// If a position is not finite, an index is out of range, an option is out of its range, `size` is not from 8 to
    /// 32768, or `size` is too small for the number of charts.
    pub fn new(
        positions: &[[f64; 3]],
        faces: &[[u32; 3]],
        size: usize,
        options: &AtlasOptions,
    ) -> Result<Self> {
        check(positions, faces)?;
        let in_range = (8..=MOST_TEXELS).contains(&size);
        Error::unless(in_range, "atlas", "size", size, "8 to 32768 texels")?;
        let gutter = options.gutter;
        let in_range = (LEAST_GUTTER..=size / 4).contains(&gutter);
        let expected = "at least 2 texels, at most a quarter of the size";
        Error::unless(in_range, "atlas", "gutter", gutter, expected)?;
        let angle = options.max_angle;
        let in_range = (10.0..=75.0).contains(&angle);
        Error::unless(in_range, "atlas", "max_angle", angle, "10° to 75°")?;

        let surface = Surface::new(positions, faces)?;
        let mut charts = grow::charts(&surface, angle.to_radians());
        let area: f64 = surface.areas.iter().sum();
        let mut least = size as f64 * (USED / area).sqrt();
        let mut rounds = 0;
        let (flats, density) = loop {
            let mut flats = flatten::flatten(&surface, charts, 1.0 / least);
            let density = pack::pack(&mut flats, size, gutter)?;
            rounds += 1;
            if density >= least || rounds == ROUNDS {
                break (flats, density);
            }
            least = 0.9 * density;
            charts = flats.into_iter().map(|flat| flat.faces).collect();
        };
        let mut atlas = Self {
            uvs: Vec::new(),
            faces: vec![[0; 3]; faces.len()],
            charts: vec![0; faces.len()],
            size,
            density: density / surface.size,
            gutter,
            seams: Vec::new(),
        };
        for (chart, flat) in flats.iter().enumerate() {
            let first = atlas.uvs.len() as u32;
            let uvs = flat.points.iter().map(|p| (*p / size as f64).to_array());
            atlas.uvs.extend(uvs);
            for (&face, corners) in flat.faces.iter().zip(&flat.corners) {
                atlas.faces[face as usize] = corners.map(|v| first + v);
                atlas.charts[face as usize] = chart as u32;
            }
        }
        atlas.seams = seams::seams(&surface, &atlas.faces);
        Ok(atlas)
    }

    /// The number of charts.
    pub fn chart_count(&self) -> usize {
        self.charts.iter().max().map_or(0, |&c| c as usize + 1)
    }

    /// The texture coordinates of a point of a face, from its barycentric coordinates.
    ///
    /// # Panics
    /// If there is no such face.
    pub fn uv(&self, face: u32, barycentric: [f64; 3]) -> [f64; 2] {
        let corners = self.faces[face as usize].map(|v| self.uvs[v as usize]);
        [0, 1].map(|axis| (0..3).map(|i| corners[i][axis] * barycentric[i]).sum())
    }

    /// The part of the texels whose centers are on faces.
    pub fn coverage(&self) -> f64 {
        let area = |f: &[u32; 3]| {
            let [a, b, c] = f.map(|v| glam::DVec2::from(self.uvs[v as usize]));
            0.5 * (b - a).perp_dot(c - a)
        };
        self.faces.iter().map(area).sum()
    }

    /// The texels that belong to faces, for baking.
    pub fn texels(&self) -> Texels {
        Texels::new(self.size, self.gutter, &self.uvs, &self.faces, &self.charts)
    }

    /// Pairs of texture coordinates of the same points on the surface, on the two sides of edges between charts: about one
    /// for each texel along the edge, at least one for each edge. A regularizer of textures compares the lookups at both.
    pub fn seam_pairs(&self) -> Vec<([f64; 2], [f64; 2])> {
        seams::pairs(&self.seams, &self.uvs, self.size)
    }
}
