//! Textures of one mesh, moved to another.

use glam::DVec3;
use rayon::prelude::*;

use super::nearest::NearestFaces;
use super::surface::{check, check_faces};
use super::texels::Texels;
use crate::error::{Error, Result};

/// A mesh with a texture.
#[derive(Clone, Copy, Debug)]
pub struct Textured<'a> {
    /// Positions.
    pub positions: &'a [[f64; 3]],
    /// Rows of `positions` for each face.
    pub faces: &'a [[u32; 3]],
    /// Texture coordinates.
    pub uvs: &'a [[f64; 2]],
    /// Rows of `uvs` for the three corners of each face.
    pub uv_faces: &'a [[u32; 3]],
    /// Texels `[height, width, N]`, row 0 at v = 1.
    pub texels: &'a [f32],
    /// Height and width of the texture.
    pub shape: [usize; 2],
}

/// Looks a texture `[height, width, N]` up bilinearly at (u, v), as renders do: texel centers are at half-integers, row 0
/// is at v = 1, and the texture repeats outside of the unit square. Texels beyond the end of the list count as 0.
pub fn lookup<const N: usize>(
    texels: &[f32],
    [height, width]: [usize; 2],
    uv: [f64; 2],
) -> [f32; N] {
    let (x, y) = (
        uv[0] * width as f64 - 0.5,
        (1.0 - uv[1]) * height as f64 - 0.5,
    );
    let (left, top) = (x.floor(), y.floor());
    let mut sum = [0.0f64; N];
    for (row, by_row) in [(top, top + 1.0 - y), (top + 1.0, y - top)] {
        for (column, by_column) in [(left, left + 1.0 - x), (left + 1.0, x - left)] {
            let row = row.rem_euclid(height as f64) as usize;
            let at = row * width + column.rem_euclid(width as f64) as usize;
            let texel = texels.get(at * N..at * N + N).unwrap_or(&[]);
            for (s, &t) in sum.iter_mut().zip(texel) {
                *s += by_row * by_column * f64::from(t);
            }
        }
    }
    sum.map(|s| s as f32)
}

/// Moves a texture to another mesh of about the same shape: each texel of `to`, made from an atlas of the mesh `positions`
/// and `faces`, is looked up at the nearest point of `from` whose face has a similar direction. Returns a texture
/// `[size, size, N]`.
///
/// # Errors
/// If a mesh has a position that is not finite or an index out of range, if `from` has no face, if its lists don't belong
/// together, or `to` is not from an atlas of the mesh.
pub fn transfer<const N: usize>(
    from: &Textured,
    positions: &[[f64; 3]],
    faces: &[[u32; 3]],
    to: &Texels,
) -> Result<Vec<f32>> {
    check(positions, faces)?;
    let tree = NearestFaces::new(from.positions, from.faces)?;
    from.check(N)?;
    let expected = format!("{} as in the atlas", to.faces());
    Error::unless(
        to.faces() == faces.len(),
        "mesh",
        "faces",
        faces.len(),
        &expected,
    )?;
    let value = |face: u32, at: [f64; 3]| {
        let t = faces[face as usize].map(|v| DVec3::from(positions[v as usize]));
        let point = t[0] * at[0] + t[1] * at[1] + t[2] * at[2];
        let normal = (t[1] - t[0]).cross(t[2] - t[0]);
        let nearest = tree.nearest_facing(point.into(), normal.into());
        let corners = from.uv_faces[nearest.face as usize].map(|v| from.uvs[v as usize]);
        let uv = [0, 1].map(|c| (0..3).map(|i| corners[i][c] * nearest.barycentric[i]).sum());
        lookup::<N>(from.texels, from.shape, uv)
    };
    Ok(to.bake(value))
}

impl Textured<'_> {
    /// Checks that the lists belong together.
    fn check(&self, channels: usize) -> Result<()> {
        let count = self.uv_faces.len();
        let expected = format!("{} as faces", self.faces.len());
        Error::unless(
            count == self.faces.len(),
            "mesh",
            "uv_faces",
            count,
            &expected,
        )?;
        check_faces("uv_face", self.uv_faces, self.uvs.len())?;
        let finite = self
            .uvs
            .par_iter()
            .all(|uv| uv.iter().all(|x| x.is_finite()));
        Error::unless(finite, "mesh", "uvs", "not finite", "finite numbers")?;
        let [height, width] = self.shape;
        let all = height
            .checked_mul(width)
            .and_then(|n| n.checked_mul(channels));
        let (count, expected) = (
            self.texels.len(),
            format!("{height} · {width} · {channels}"),
        );
        let valid = count > 0 && all == Some(count);
        Error::unless(valid, "texture", "number of values", count, &expected)
    }
}
