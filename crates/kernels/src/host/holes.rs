//! Holes in surfaces from alpha masks.

use std::collections::HashMap;
use std::sync::Arc;

use super::wrap::Wrap;

/// An alpha mask.
#[derive(Debug)]
pub struct Mask {
    /// Alpha, row by row.
    pub alpha: Arc<Vec<f32>>,
    /// Columns and rows.
    pub size: [usize; 2],
    /// What is outside of the unit square.
    pub wrap: Wrap,
    /// A surface has a hole where its alpha is below this.
    pub cutoff: f32,
}

/// The holes of a scene's triangles, as flat lists.
#[derive(Debug, Default)]
pub struct Holes {
    /// The index of each triangle among the triangles with a mask, `u32::MAX` for a triangle without one.
    pub of_triangle: Vec<u32>,
    /// The image of each triangle with a mask: the index of its first alpha, columns, rows, and wrap mode.
    pub images: Vec<u32>,
    /// [`OF_MASKED`] numbers per triangle with a mask: texture coordinates of its corners, and the cutoff of alpha.
    pub uvs: Vec<f32>,
    /// The alpha values of all masks. A shared mask is stored once.
    pub alphas: Vec<f32>,
}

/// The number of floats for each triangle with a mask.
pub const OF_MASKED: usize = 7;

impl Holes {
    /// Collects the holes of faces, given the masks of all materials. Each face has the index of its material, and
    /// texture coordinates if its mesh has any. Returns None if no face has a mask.
    pub fn new(
        faces: impl Iterator<Item = (usize, Option<[[f32; 2]; 3]>)>,
        of_materials: Vec<Option<Mask>>,
    ) -> Option<Self> {
        let mut holes = Self::default();
        let mut known: HashMap<*const Vec<f32>, u32> = HashMap::new();
        let mut image = |mask: &Option<Mask>| {
            let Mask {
                alpha, size, wrap, ..
            } = mask.as_ref()?;
            let first = *known.entry(Arc::as_ptr(alpha)).or_insert_with(|| {
                holes.alphas.extend(alpha.iter());
                (holes.alphas.len() - alpha.len()) as u32
            });
            Some([first, size[0] as u32, size[1] as u32, *wrap as u32])
        };
        let images: Vec<Option<[u32; 4]>> = of_materials.iter().map(&mut image).collect();
        let mut count = 0;
        for (material, uvs) in faces {
            let (Some(mask), Some(uvs)) = (&of_materials[material], uvs) else {
                holes.of_triangle.push(u32::MAX);
                continue;
            };
            holes.of_triangle.push(count);
            count += 1;
            holes.images.extend(images[material].into_iter().flatten());
            holes.uvs.extend(uvs.as_flattened());
            holes.uvs.push(mask.cutoff);
        }
        (count > 0).then_some(holes)
    }

    /// Whether a triangle may have holes.
    pub fn are_in(&self, triangle: usize) -> bool {
        self.of_triangle[triangle] != u32::MAX
    }
}
