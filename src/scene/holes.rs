//! Holes in surfaces, by alpha masks.

use std::sync::Arc;

use super::wrap::Wrap;

/// A mask on the host.
#[derive(Debug)]
pub(crate) struct Mask {
    /// Row after row.
    pub alpha: Arc<Vec<f32>>,
    pub width: usize,
    pub height: usize,
    pub wrap: Wrap,
    pub cutoff: f32,
}

impl Mask {
    /// Bilinear, texel centres at half-integers, row 0 at the top (v = 1).
    fn at(&self, [u, v]: [f32; 2]) -> f32 {
        let (width, height) = (self.width, self.height);
        let at = [u * width as f32 - 0.5, (1.0 - v) * height as f32 - 0.5];
        let shares = self.wrap.bilinear(at, [width, height]);
        shares.iter().map(|&(t, w)| self.alpha[t] * w).sum()
    }
}

/// A triangle with a mask: the mask's number, and texture coordinates of the corners.
#[derive(Debug)]
pub(crate) struct Masked {
    pub mask: u32,
    pub uvs: [[f32; 2]; 3],
}

/// The holes of a scene's triangles.
#[derive(Debug)]
pub(crate) struct Holes {
    /// The place of each triangle among those with a mask, `u32::MAX` for one without.
    pub of_triangle: Vec<u32>,
    pub triangles: Vec<Masked>,
    pub masks: Vec<Mask>,
}

impl Holes {
    /// Those of faces, each with the number of its material and texture coordinates if it has any, by the masks of all
    /// materials; None if there are none.
    pub(super) fn new(
        faces: impl Iterator<Item = (usize, Option<[[f32; 2]; 3]>)>,
        of_materials: Vec<Option<Mask>>,
    ) -> Option<Self> {
        let mut masks = Vec::new();
        let mut number = |mask: Option<Mask>| {
            let mask = mask?;
            masks.push(mask);
            Some(masks.len() as u32 - 1)
        };
        let numbers: Vec<Option<u32>> = of_materials.into_iter().map(&mut number).collect();
        let (mut of_triangle, mut triangles) = (Vec::new(), Vec::new());
        for (material, uvs) in faces {
            of_triangle.push(match (numbers[material], uvs) {
                (Some(mask), Some(uvs)) => {
                    triangles.push(Masked { mask, uvs });
                    triangles.len() as u32 - 1
                }
                _ => u32::MAX,
            });
        }
        (!triangles.is_empty()).then_some(Self {
            of_triangle,
            triangles,
            masks,
        })
    }

    /// Whether a triangle may have holes.
    pub fn are_in(&self, triangle: usize) -> bool {
        self.of_triangle[triangle] != u32::MAX
    }

    /// Whether a triangle has a hole at the point with these weights of its corners.
    #[inline(always)]
    pub fn open(&self, triangle: u32, weights: impl FnOnce() -> [f32; 3]) -> bool {
        let place = self.of_triangle[triangle as usize];
        place != u32::MAX && self.open_at(place, weights())
    }

    #[inline(never)]
    fn open_at(&self, place: u32, weights: [f32; 3]) -> bool {
        let Masked { mask, uvs } = &self.triangles[place as usize];
        let mut uv = [0.0; 2];
        for (w, of_corner) in weights.into_iter().zip(uvs) {
            uv[0] += of_corner[0] * w;
            uv[1] += of_corner[1] * w;
        }
        let mask = &self.masks[*mask as usize];
        mask.at(uv) < mask.cutoff
    }
}
