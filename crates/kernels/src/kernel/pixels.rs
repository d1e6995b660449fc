//! Derivatives of the loss with respect to pixels, and how much it depends on those around a film point.

use std::collections::HashMap;

use crate::kernel::view::View;
use crate::kernel::walk::Seen;
use crate::model::film::{CELL, NEIGHBORS, cell_at};
use crate::model::{V2, v2};
use crate::trace::{FilmSlopes, Scene, pixels_around};

/// Derivatives of the loss with respect to the pixels of an image, each of which is the mean of its samples.
pub struct PixelGradients {
    /// The derivatives of all pixels, or of those in `which`.
    values: Vec<Seen>,
    which: Option<HashMap<u32, u32>>,
    width: u32,
    height: u32,
    /// For each cell, a weighted sum of how much the loss depends on the pixels of the cell and of its neighbors.
    cells: Vec<f32>,
}

impl PixelGradients {
    /// Takes the derivatives with respect to the pixels of a view.
    pub fn new(list: &[(u32, Seen)], view: &View) -> Self {
        let (width, height) = (view.settings.width, view.settings.height);
        let all = list.len() == (width * height) as usize
            && list.iter().enumerate().all(|(i, p)| p.0 as usize == i);
        let columns = width.div_ceil(CELL) as usize;
        let rows = height.div_ceil(CELL) as usize;
        let mut own = vec![0.0; columns * rows];
        for (pixel, g) in list {
            let (x, y) = (pixel % width, pixel / width);
            let size = g.size();
            // Pixels whose derivative is not finite are left out.
            if size.is_finite() {
                own[(y / CELL) as usize * columns + (x / CELL) as usize] += size;
            }
        }
        // The number of cells in each direction whose pixels may see a point of a cell.
        let around = 1 + (view.filter.radius() / CELL as f32).ceil() as usize;
        let spread = |from: &[f32], along: usize, across: usize, step: usize, stride: usize| {
            let mut to = vec![0.0; from.len()];
            for j in 0..across {
                for i in 0..along {
                    let (first, last) = (i.saturating_sub(around), (i + around).min(along - 1));
                    to[j * stride + i * step] =
                        (first..=last).map(|k| from[j * stride + k * step]).sum();
                }
            }
            to
        };
        let cells = spread(&own, columns, rows, 1, columns);
        let cells = spread(&cells, rows, columns, columns, 1);
        // The cell itself counts most.
        let cells = cells
            .iter()
            .zip(&own)
            .map(|(a, b)| NEIGHBORS * a + b)
            .collect();
        Self {
            values: list.iter().map(|p| p.1).collect(),
            which: (!all).then(|| {
                let pairs = list.iter().enumerate();
                pairs.map(|(i, p)| (p.0, i as u32)).collect()
            }),
            width,
            height,
            cells,
        }
    }

    /// Returns the derivatives with respect to the pixel in which a film point lies.
    pub fn get(&self, x: f32, y: f32) -> Option<&Seen> {
        if !(x >= 0.0 && y >= 0.0 && x < self.width as f32 && y < self.height as f32) {
            return None;
        }
        let pixel = y as u32 * self.width + x as u32;
        let i = match &self.which {
            None => pixel,
            Some(which) => *which.get(&pixel)?,
        };
        Some(&self.values[i as usize])
    }

    /// Returns the slope of the derivative of the loss at a film point, or `None` if not all pixels of the image are known.
    pub fn slopes(&self, scene: &Scene, at: V2) -> Option<FilmSlopes> {
        if self.which.is_some() {
            return None;
        }
        let mut slopes = FilmSlopes::default();
        let [rows, columns] = [(at.y, self.height), (at.x, self.width)]
            .map(|(at, count)| pixels_around(scene, at, count));
        for y in rows.first..rows.past {
            for x in columns.first..columns.past {
                let g = &self.values[(y * self.width + x) as usize];
                // Pixels on which the loss doesn't depend have no samples.
                if *g != Seen::default() {
                    let offset = v2(at.x - x as f32 - 0.5, at.y - y as f32 - 0.5);
                    slopes.add(scene, g, offset);
                }
            }
        }
        Some(slopes)
    }

    /// Returns how much the loss depends on the pixels around a point.
    pub fn near(&self, at: V2) -> f32 {
        self.cells[cell_at(at.x, at.y, self.width, self.height) as usize]
    }
}
