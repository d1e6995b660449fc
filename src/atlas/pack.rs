//! Places charts side by side in a square.

use std::collections::HashMap;

use glam::{DVec2, Vec2Swizzles};
use rayon::prelude::*;

use super::cells::{Cells, align, bounds};
use super::flatten::Flat;
use crate::error::{Error, Result};

/// The largest number of cells along a side of the square.
const MOST_CELLS: usize = 1024;
/// The search for the density ends when it is known up to this part.
const PRECISE: f64 = 0.005;
/// How often the density is lowered until the charts fit.
const LOWERED: usize = 40;
/// The side of a face without area, in texels.
const TOKEN: f64 = 1.0;
/// Charts are small if their sides are at most this part of the square's.
const SMALL: usize = 16;

/// The position of a chart: quarter turns, and the cell of its lower left corner.
#[derive(Clone, Copy)]
struct Position {
    turns: usize,
    x: usize,
    y: usize,
}

/// Places charts in a square of `size` texels, with at least `gutter` texels between two of them, and half as many at
/// the sides of the square. Turns and moves their points, and scales them by the largest density at which they were
/// found to fit; returns that density in texels per unit of length.
///
/// Charts are placed one after the other, the highest first, where their top is lowest (bottom-left heuristic), with
/// the true shapes of their cells, in four orientations.
///
/// # Errors
/// If the charts don't fit at any density.
pub(super) fn pack(charts: &mut [Flat], size: usize, gutter: usize) -> Result<f64> {
    charts.par_iter_mut().for_each(|c| align(&mut c.points));
    let cell = size.div_ceil(MOST_CELLS).max(1);
    let side = size / cell;
    let area = |c: &Flat| match c.is_token {
        true => 0.0,
        false => bounds(c.points.iter().copied())[1].element_product(),
    };
    let total: f64 = charts.iter().map(area).sum();
    let longest = charts.iter().filter(|c| !c.is_token);
    let longest = longest.flat_map(|c| &c.points);
    let longest = longest.fold(0.0f64, |m, p| m.max(p.max_element()));
    let board = Scaled {
        charts,
        cell: cell as f64,
        margin: 0.5 * gutter as f64 / cell as f64,
        side,
    };
    let texels = size as f64;
    let most = (1.5f64.sqrt() * texels / total.sqrt()).min(texels / longest);
    // Without area any density is right.
    let most = if most.is_finite() { most } else { 1.0 };
    let (mut low, mut found) = (most * 0.75, None);
    let mut high = most;
    for _ in 0..LOWERED {
        found = board.place(low);
        if found.is_some() {
            break;
        }
        (low, high) = (low * if high > 0.1 * most { 0.88 } else { 0.5 }, low);
    }
    let Some(mut found) = found else {
        let value = format!("{size} for {} charts", charts.len());
        let expected = "more texels, or a smaller gutter";
        return Err(Error::invalid("atlas", "size", value, expected));
    };
    while high > low * (1.0 + PRECISE) {
        let middle = (low * high).sqrt();
        match board.place(middle) {
            Some(better) => (low, found) = (middle, better),
            None => high = middle,
        }
    }
    let (margin, cell) = (board.margin, board.cell);
    for (chart, at) in charts.iter_mut().zip(found) {
        let points = scaled(chart, low, cell, margin);
        let width = room(&points, margin);
        let corner = DVec2::new(at.x as f64, at.y as f64);
        let place = |p: DVec2| (turn(p, at.turns, width) + corner) * cell;
        chart.points = points.into_iter().map(place).collect();
    }
    Ok(low)
}

/// The points of a chart in cells of `cell` texels, at least `margin`.
fn scaled(chart: &Flat, density: f64, cell: f64, margin: f64) -> Vec<DVec2> {
    let scale = if chart.is_token { TOKEN } else { density } / cell;
    let place = |p: &DVec2| *p * scale + margin;
    chart.points.iter().map(place).collect()
}

/// The numbers of columns and rows of a chart's cells.
fn room(points: &[DVec2], margin: f64) -> DVec2 {
    let [_, max] = bounds(points.iter().copied());
    (max + margin).ceil()
}

/// Turns a point in a rectangle of cells by quarter turns; the lower left corner of the turned rectangle is the
/// origin.
fn turn(p: DVec2, turns: usize, size: DVec2) -> DVec2 {
    match turns {
        0 => p,
        1 => DVec2::new(size.y - p.y, p.x),
        2 => size - p,
        _ => DVec2::new(p.y, size.x - p.x),
    }
}

/// Charts that are to be placed at some density.
struct Scaled<'a> {
    charts: &'a [Flat],
    /// The side of a cell, texels.
    cell: f64,
    /// Half the gutter, cells.
    margin: f64,
    /// The cells along a side of the square.
    side: usize,
}

impl Scaled<'_> {
    /// The cells of a chart in four orientations.
    fn cells(&self, chart: &Flat, density: f64) -> [Cells; 4] {
        let points = scaled(chart, density, self.cell, self.margin);
        let size = room(&points, self.margin);
        let turned: Vec<DVec2> = points.iter().map(|p| turn(*p, 1, size)).collect();
        let upright = Cells::new(&chart.corners, &points, self.margin, size);
        let lying = Cells::new(&chart.corners, &turned, self.margin, size.yx());
        let opposite = [upright.turned(), lying.turned()];
        let [down, right] = opposite;
        [upright, lying, down, right]
    }

    /// Places all charts, or returns `None` if they don't fit.
    fn place(&self, density: f64) -> Option<Vec<Position>> {
        let cells: Vec<[Cells; 4]> = self
            .charts
            .par_iter()
            .map(|c| self.cells(c, density))
            .collect();
        let counts: Vec<usize> = cells.iter().map(|c| c[0].count()).collect();
        if counts.iter().sum::<usize>() > self.side * self.side {
            return None;
        }
        let longest = |c: &Cells| c.width.max(c.rows.len());
        let mut order: Vec<usize> = (0..cells.len()).collect();
        order.sort_by_key(|&c| std::cmp::Reverse((longest(&cells[c][0]), counts[c], c)));
        let mut board = Board::new(self.side);
        let mut positions = vec![
            Position {
                turns: 0,
                x: 0,
                y: 0
            };
            cells.len()
        ];
        for c in order {
            let at = board.find(&cells[c])?;
            board.fill(&cells[c][at.turns], at);
            positions[c] = at;
        }
        Some(positions)
    }
}

/// A square of cells that are free or taken.
struct Board {
    side: usize,
    /// For each cell the number of free cells from there to the right, or minus the number of taken cells.
    runs: Vec<i32>,
    /// The longest run of free cells in each row.
    longest: Vec<i32>,
    /// The row at which the search begins for small charts, by quarter turns and half their width and height: the
    /// last one of about the same size was placed there.
    starts: HashMap<(usize, usize, usize), usize>,
}

impl Board {
    fn new(side: usize) -> Self {
        let row = (0..side).map(|x| (side - x) as i32);
        Self {
            side,
            runs: std::iter::repeat_n(row, side).flatten().collect(),
            longest: vec![side as i32; side],
            starts: HashMap::new(),
        }
    }

    /// The orientation and position with the lowest top.
    fn find(&mut self, orientations: &[Cells; 4]) -> Option<Position> {
        let mut best: Option<(usize, Position)> = None;
        for (turns, cells) in orientations.iter().enumerate() {
            let (width, height) = (cells.width, cells.rows.len());
            if width > self.side || height > self.side {
                continue;
            }
            // The longest ranges first, which are the most likely not to fit.
            let mut ranges: Vec<(usize, [u32; 2])> = Vec::new();
            for (y, row) in cells.rows.iter().enumerate() {
                ranges.extend(row.iter().map(|&r| (y, r)));
            }
            ranges.sort_by_key(|(_, r)| std::cmp::Reverse(r[1] - r[0]));
            let last = match best {
                Some((top, _)) if top < height + 1 => continue,
                Some((top, _)) => (top - 1 - height).min(self.side - height),
                None => self.side - height,
            };
            let small = height.max(width) <= self.side / SMALL;
            let kind = (turns, width / 2, height / 2);
            let start = match self.starts.get(&kind) {
                Some(&start) if small => start,
                _ => 0,
            };
            let found = (start..=last).find_map(|y| Some((y, self.first(&mut ranges, width, y)?)));
            if small {
                let next = found.map_or(last + 1, |(y, _)| y);
                self.starts.insert(kind, next.saturating_sub(2).max(start));
            }
            if let Some((y, x)) = found {
                best = Some((y + height, Position { turns, x, y }));
            }
        }
        best.map(|(_, position)| position)
    }

    /// The first column at which the ranges are free, with the first row of cells in row `y`. The range that was in
    /// the way last is looked at first.
    fn first(&self, ranges: &mut [(usize, [u32; 2])], width: usize, y: usize) -> Option<usize> {
        let &(row, first) = ranges.first()?;
        if self.longest[y + row] < (first[1] - first[0]) as i32 {
            return None;
        }
        let mut x = 0;
        'columns: while x + width <= self.side {
            for k in 0..ranges.len() {
                let (row, [from, to]) = ranges[k];
                let run = self.runs[(y + row) * self.side + x + from as usize];
                if run < (to - from) as i32 {
                    // Beyond the taken cells that are in the way.
                    let next = x + from as usize + run.max(0) as usize;
                    let taken = -self.runs[(y + row) * self.side + next];
                    x = next + taken.max(1) as usize - from as usize;
                    ranges.swap(0, k);
                    continue 'columns;
                }
            }
            return Some(x);
        }
        None
    }

    /// Takes the cells of a chart.
    fn fill(&mut self, cells: &Cells, at: Position) {
        for (row, ranges) in cells.rows.iter().enumerate() {
            let start = (at.y + row) * self.side;
            let runs = &mut self.runs[start..start + self.side];
            for &[from, to] in ranges {
                runs[at.x + from as usize..at.x + to as usize].fill(-1);
            }
            let (mut next, mut longest) = (0i32, 0);
            for run in runs.iter_mut().rev() {
                next = if *run < 0 {
                    next.min(0) - 1
                } else {
                    next.max(0) + 1
                };
                longest = longest.max(next);
                *run = next;
            }
            self.longest[at.y + row] = longest;
        }
    }
}
