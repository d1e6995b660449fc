//! Pieces of edges on the film, weighted by the bound of their jump and by how much the loss depends on them.

use std::collections::HashMap;

use rayon::prelude::*;

use crate::kernel::edges::{Edge, Kind};
use crate::kernel::view::View;
use crate::kernel::walk::Seen;
use crate::model::film::{CELL, NEIGHBORS};
use crate::model::integers::morton;
use crate::model::segment::clip_linear;

/// The approximate length of a piece, in pixels.
const PIECE: f32 = 8.0;

/// A piece of an edge, between two values of λ.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Piece {
    pub edge: u32,
    pub from: f32,
    pub to: f32,
    /// The bound of its jump times its length in pixels.
    pub weight: f32,
    /// Its middle on the film in pixels, and the place of the middle along a Z-order curve.
    middle: [f32; 2],
    place: u64,
}

/// Returns the place of a film point along a Z-order curve, in quarters of pixels.
fn place(x: f32, y: f32, last: bool) -> u64 {
    // Film coordinates start at −2¹⁷.
    let [x, y] = [x, y].map(|v| (4.0 * v + 524_288.0).clamp(0.0, 1_048_575.0) as u32);
    u64::from(morton(x, y)) | (u64::from(last) << 63)
}

impl View {
    /// Returns the pieces of edges that jump on the film. The weight of each is multiplied by `near` of its middle, and
    /// pieces of weight 0 are left out. Neighbors on the film are adjacent in the list, and creases come after
    /// silhouettes. So numbers that are spread evenly over pieces are spread evenly over the film.
    pub fn film_pieces(&self, near: impl Fn([f32; 2]) -> f32 + Sync) -> Vec<Piece> {
        let Some(sets) = &self.edge_sets else {
            return Vec::new();
        };
        // If the camera moves, all edges move relative to it.
        let seen = |e: &Edge| self.wanted.of.camera || e.moves(&self.scene, &self.wanted);
        let of_edge = |mut found: Vec<Piece>, index: usize| {
            let e = sets.edges.get(index);
            if seen(&e) {
                self.pieces_of(index as u32, &e, &mut |mut piece| {
                    piece.weight *= near(piece.middle);
                    if piece.weight > 0.0 {
                        found.push(piece);
                    }
                });
            }
            found
        };
        let indices = (0..sets.edges.count).into_par_iter();
        let lists = indices.fold(Vec::new, of_edge);
        let mut pieces: Vec<Piece> = lists.flatten_iter().collect();
        pieces.par_sort_by_key(|p| p.place);
        pieces
    }

    /// Returns an upper bound of the jump at an edge that the camera sees. `slack` is the largest distance of a ray's
    /// start from the camera's middle, plus the distance by which the edge moves. Within it, a face may be seen from
    /// either side.
    fn film_jump(&self, e: &Edge, slack: f32) -> f32 {
        if e.kind != Kind::Fold {
            return 1.0;
        }
        let c = &self.camera;
        let above = |k: u32| {
            let t = self.scene.triangle(k);
            if c.parallel {
                -t.normal.dot(c.forward)
            } else {
                t.above(c.eye)
            }
        };
        let (front, back) = (above(e.faces[0]), above(e.faces[1]));
        if front.abs().min(back.abs()) <= slack || front * back < 0.0 {
            return 1.0;
        }
        if e.closed && front < 0.0 {
            0.0
        } else {
            e.crease
        }
    }

    fn pieces_of(&self, index: u32, e: &Edge, found: &mut impl FnMut(Piece)) {
        let c = &self.camera;
        let velocity = self.scene.shift(e.faces[0], 1.0);
        let moved = velocity.length();
        // Parallel rays see a face from the same side wherever it moves.
        let slack = if c.parallel { 0.0 } else { c.aperture + moved };
        let jump = self.film_jump(e, slack);
        if jump == 0.0 {
            return;
        }
        // In the camera's basis, at the middle of the shutter.
        let a = c.local(e.a + velocity * 0.5 - c.eye).to_array();
        let b = c.local(e.a + e.along + velocity * 0.5 - c.eye).to_array();
        let near = 1e-4 * (a[2].abs().max(b[2].abs()) + c.aperture + moved);
        let [from, to] = clip_linear([0.0, 1.0], a[2] - near, b[2] - near);
        if from >= to {
            return;
        }
        // Lens and shutter displace near points more than far ones. So the edge is divided into parts of about one
        // depth each.
        let depth = |l: f32| a[2] + (b[2] - a[2]) * l;
        let ratio = depth(to) / depth(from);
        let parts = if (c.aperture > 0.0 || moved > 0.0) && !e.apart && !c.parallel {
            ratio.log2().abs().ceil().clamp(1.0, 16.0) as usize
        } else {
            1
        };
        let mut start = from;
        for k in 1..=parts {
            let end = if k == parts {
                to
            } else {
                let deeper = depth(from) * (ratio.powf(k as f32 / parts as f32) - 1.0);
                from + deeper / (b[2] - a[2])
            };
            if let Some((part, ends)) = self.on_film([start, end], [a, b], moved) {
                push_pieces(index, (!e.apart).then_some(part), ends, jump, found);
            }
            start = end;
        }
    }

    /// Clips a part of an edge, whose ends are in the camera's frame, to the film. Returns the visible part, and for
    /// each of its ends the film coordinates, the depth, and the probability that a point there is seen.
    fn on_film(
        &self,
        mut part: [f32; 2],
        [a, b]: [[f32; 3]; 2],
        moved: f32,
    ) -> Option<([f32; 2], [[f32; 4]; 2])> {
        let c = &self.camera;
        let at = |l: f32| -> [f32; 3] { std::array::from_fn(|k| a[k] + (b[k] - a[k]) * l) };
        // The divisor of coordinates: the depth in a perspective.
        let divisor = |p: [f32; 3]| if c.parallel { 1.0 } else { p[2] };
        // The film is enlarged by the reach of its filter, and by the displacement through lens and shutter.
        let stretch = c.dual.x.length().max(c.dual.y.length());
        let margin = |p: [f32; 3]| {
            let lens = c.aperture * stretch * (1.0 / p[2] - c.per_focus).abs();
            let per = 1.0 / divisor(p);
            let mut moves = stretch;
            if !c.parallel {
                moves += (p[0].abs() + p[1].abs()) * per;
            }
            lens + 0.5 * moved * moves * per
        };
        let more = margin(at(part[0])).max(margin(at(part[1])));
        let aspect = c.width / c.height;
        let reach = (0.5 + self.filter.radius()) * 2.0 / c.height;
        for (k, limit) in [(0, aspect + reach + more), (1, 1.0 + reach + more)] {
            let (at_a, at_b) = (limit * divisor(a), limit * divisor(b));
            part = clip_linear(part, at_a + a[k], at_b + b[k]);
            part = clip_linear(part, at_a - a[k], at_b - b[k]);
        }
        if part[0] >= part[1] {
            return None;
        }
        let share = 1.0 / (1.0 + more);
        let on_film = |l: f32| {
            let p = at(l);
            let scale = 0.5 * c.height / divisor(p);
            [
                0.5 * c.width + p[0] * scale,
                0.5 * c.height - p[1] * scale,
                divisor(p),
                share * share,
            ]
        };
        Some((part, part.map(on_film)))
    }
}

/// Divides a part of an edge into pieces of equal length on the film. If the edge's line moves, the whole edge is one
/// piece.
fn push_pieces(
    edge: u32,
    part: Option<[f32; 2]>,
    [p, q]: [[f32; 4]; 2],
    jump: f32,
    found: &mut impl FnMut(Piece),
) {
    let length = (q[0] - p[0]).hypot(q[1] - p[1]);
    let (count, [from, to]) = match part {
        None => (1, [0.0, 1.0]),
        Some(part) => ((length / PIECE).ceil().clamp(1.0, 4096.0) as usize, part),
    };
    let lambda = |i: usize| {
        let s = i as f32 / count as f32;
        let share = s * p[2] / (q[2] * (1.0 - s) + s * p[2]);
        from + (to - from) * share
    };
    for i in 0..count {
        let s = (i as f32 + 0.5) / count as f32;
        let (x, y) = (p[0] + (q[0] - p[0]) * s, p[1] + (q[1] - p[1]) * s);
        found(Piece {
            edge,
            from: lambda(i),
            to: lambda(i + 1),
            weight: (length / count as f32) * jump * p[3],
            middle: [x, y],
            place: place(x, y, jump < 1.0),
        });
    }
}

/// Derivatives of the loss with respect to the pixels of an image, each of which is the mean of its samples.
pub(crate) struct PixelGradients {
    /// The derivatives of all pixels, or of those in `which`.
    values: Vec<Seen>,
    which: Option<HashMap<u32, u32>>,
    width: u32,
    height: u32,
    /// For each cell, a weighted sum of how much the loss depends on the pixels of the cell and of its neighbors.
    cells: Vec<f32>,
}

/// Returns the index of the cell around a film point. Cells are numbered row by row.
fn cell_of([x, y]: [f32; 2], width: u32, height: u32) -> u32 {
    let x = x.clamp(0.0, width as f32 - 1.0) as u32 / CELL;
    let y = y.clamp(0.0, height as f32 - 1.0) as u32 / CELL;
    y * width.div_ceil(CELL) + x
}

impl Piece {
    /// Returns the index of the cell in which its middle lies.
    #[cfg(feature = "gpu")]
    pub fn cell(&self, width: u32, height: u32) -> u32 {
        cell_of(self.middle, width, height)
    }
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

    /// Returns how much the loss depends on the pixels around a point.
    pub(super) fn near(&self, x: f32, y: f32) -> f32 {
        self.cells[cell_of([x, y], self.width, self.height) as usize]
    }
}
