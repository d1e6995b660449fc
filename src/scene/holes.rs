//! Holes in surfaces, by alpha masks.

use std::collections::HashMap;
use std::sync::Arc;

use super::wrap::Wrap;

/// A mask on the host.
#[derive(Debug)]
pub(crate) struct Mask {
    /// Row after row.
    pub alpha: Arc<Vec<f32>>,
    /// Columns and rows.
    pub size: [usize; 2],
    pub wrap: Wrap,
    pub cutoff: f32,
}

/// The holes of a scene's triangles, as flat lists.
#[derive(Debug, Default)]
pub(crate) struct Holes {
    /// The place of each triangle among those with a mask, `u32::MAX` for one without.
    pub of_triangle: Vec<u32>,
    /// The image of each of these: the place of its first alpha, columns, rows, and how it goes on outside.
    pub images: Vec<u32>,
    /// [`OF_MASKED`] numbers of each: texture coordinates of its corners, and the alpha under which it has a hole.
    pub uvs: Vec<f32>,
    /// What all masks hold, once.
    pub alphas: Vec<f32>,
}

pub(crate) const OF_MASKED: usize = 7;

impl Holes {
    /// Those of faces, each with the number of its material and texture coordinates if it has any, by the masks of all
    /// materials; None if there are none.
    pub(super) fn new(
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
