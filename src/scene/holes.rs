//! Holes in surfaces, by alpha masks.

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
}
