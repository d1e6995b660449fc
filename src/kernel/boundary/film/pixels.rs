//! Derivatives of a loss by the pixels of an image.

use std::collections::HashMap;

use crate::kernel::walk::Seen;

/// Derivatives by the pixels of an image, each the mean of its samples.
pub(crate) struct PixelGradients {
    /// One for every pixel, or for those that `which` names.
    values: Vec<Seen>,
    which: Option<HashMap<u32, u32>>,
    width: u32,
    height: u32,
    /// The sum of how much the loss depends on the pixels of a cell and its neighbours.
    cells: Vec<f32>,
    columns: usize,
}

/// Pixels of a side of a cell.
const CELL: u32 = 8;

impl PixelGradients {
    /// Takes the derivatives by pixels of a list. `reach` is the distance beyond a pixel that its filter
    /// reaches, in pixels.
    pub fn new(list: &[(u32, Seen)], width: u32, height: u32, reach: f32) -> Self {
        let all = list.len() == (width * height) as usize
            && list.iter().enumerate().all(|(i, p)| p.0 as usize == i);
        let columns = width.div_ceil(CELL) as usize;
        let rows = height.div_ceil(CELL) as usize;
        let mut own = vec![0.0; columns * rows];
        for (pixel, g) in list {
            let (x, y) = (pixel % width, pixel / width);
            own[(y / CELL) as usize * columns + (x / CELL) as usize] += weight(g);
        }
        // The cells of pixels that see a point of a cell.
        let around = 1 + (reach / CELL as f32).ceil() as usize;
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
        // Its own counts most.
        let cells = cells.iter().zip(&own).map(|(a, b)| 0.1 * a + b).collect();
        Self {
            values: list.iter().map(|p| p.1).collect(),
            which: (!all).then(|| {
                let pairs = list.iter().enumerate();
                pairs.map(|(i, p)| (p.0, i as u32)).collect()
            }),
            width,
            height,
            cells,
            columns,
        }
    }

    /// The derivatives by the pixel that a point of the film lies in.
    pub(super) fn get(&self, x: f32, y: f32) -> Option<&Seen> {
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

    /// The sum of how much the loss depends on the pixels about a point.
    pub(super) fn near(&self, x: f32, y: f32) -> f32 {
        let x = x.clamp(0.0, self.width as f32 - 1.0) as u32 / CELL;
        let y = y.clamp(0.0, self.height as f32 - 1.0) as u32 / CELL;
        self.cells[y as usize * self.columns + x as usize]
    }
}

fn weight(g: &Seen) -> f32 {
    g.radiance.abs().element_sum() + g.opacity.abs() + g.depth.abs() + g.normal.abs().element_sum()
}
