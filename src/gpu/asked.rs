//! How much a loss depends on the pixels of views, and so where edges are drawn on their films, without the host in
//! between: `PixelGradients` and `FilmEdges` of `kernel/boundary/pieces` in kernels of a GPU.

use burn::cubecl::{self, prelude::*};

use super::Outputs;
use super::film_table::{
    BLOCK, BLOCKS, FIRST_PIECE, MOST, OF_FILM, OF_PIECE, OWN, PAST_PIECE, RADIUS, TOTAL, view_of,
};
use super::layout::{FLOAT_HEADER, HEIGHT, NONE, WIDTH};
use super::passes::upstream_of;
use super::sums::PARTS;
use crate::kernel::CELL;

/// Numbers of a cell: how much the loss depends on it, and how many of its pixels it asks for; the sum of how much it
/// depends on their radiance, and how many pixels that is of. The first becomes that of the cell and those around.
const OF_CELL: u32 = 4;

/// Columns and rows of cells.
#[derive(CubeType, CubeTypeMut, Clone, Copy, Debug)]
#[expand(derive(Clone, Copy))]
struct Grid {
    columns: u32,
    rows: u32,
}

#[cube]
fn grid(words: &[u32]) -> Grid {
    Grid {
        columns: words[WIDTH].div_ceil(CELL),
        rows: words[HEIGHT].div_ceil(CELL),
    }
}

/// The place of a cell's numbers.
#[cube]
fn cell_at(grid: &Grid, view: u32, x: u32, y: u32) -> usize {
    (OF_CELL * ((view * grid.rows + y) * grid.columns + x)) as usize
}

/// Looks at the pixels of each cell, one thread a cell.
#[cube(launch)]
pub(super) fn look_at_cells(
    floats: &[f32],
    words: &[u32],
    films: &[u32],
    upstream: &[f32],
    cells: &mut [f32],
    views: u32,
    of_view: u32,
    #[comptime] listed: bool,
    #[comptime] outputs: Outputs,
) {
    let grid = grid(words);
    if ABSOLUTE_POS < (views * grid.columns * grid.rows) as usize {
        let thread = ABSOLUTE_POS as u32;
        let column = thread % grid.columns;
        let row = thread / grid.columns % grid.rows;
        let view = thread / (grid.columns * grid.rows);
        let floats = &floats[view as usize * FLOAT_HEADER..];
        let places = &films[(OF_FILM * views) as usize..];
        let mut weight = 0.0f32;
        let mut asked = 0.0f32;
        let mut radiance = 0.0f32;
        let mut lit = 0.0f32;
        let mut y = row * CELL;
        let last_x = (column * CELL + CELL).min(words[WIDTH]);
        let last_y = (row * CELL + CELL).min(words[HEIGHT]);
        while y < last_y {
            let mut x = column * CELL;
            while x < last_x {
                let mut i = y * words[WIDTH] + x;
                if listed {
                    i = places[i as usize];
                }
                if i != NONE {
                    let one = 1.0f32.runtime();
                    let g = upstream_of(floats, upstream, view * of_view + i, one, outputs);
                    let own = g.radiance.abs().element_sum();
                    let all = own + g.opacity.abs() + g.depth.abs() + g.normal.abs().element_sum();
                    weight += all;
                    radiance += own;
                    if all != 0.0 {
                        asked += 1.0;
                    }
                    if own > 0.0 {
                        lit += 1.0;
                    }
                }
                x += 1;
            }
            y += 1;
        }
        let at = cell_at(&grid, view, column, row);
        cells[at] = weight;
        cells[at + 1] = asked;
        cells[at + 2] = radiance;
        cells[at + 3] = lit;
    }
}

/// How much the loss depends on the pixels that see a point of a cell, one thread a cell; those of the first column
/// add up what the cells of their rows count as well.
#[cube(launch)]
pub(super) fn look_around(
    words: &[u32],
    films: &[u32],
    cells: &[f32],
    near: &mut [f32],
    rows: &mut [f32],
    views: u32,
) {
    let grid = grid(words);
    if ABSOLUTE_POS < (views * grid.columns * grid.rows) as usize {
        let thread = ABSOLUTE_POS as u32;
        let column = thread % grid.columns;
        let row = thread / grid.columns % grid.rows;
        let view = thread / (grid.columns * grid.rows);
        let radius = f32::from_bits(films[(OF_FILM * view) as usize + RADIUS]);
        let around = 1 + (radius * (1.0f32 / CELL as f32)).ceil() as u32;
        let mut sum = 0.0f32;
        let mut y = row - around.min(row);
        while y <= (row + around).min(grid.rows - 1) {
            let mut of_row = 0.0f32;
            let mut x = column - around.min(column);
            while x <= (column + around).min(grid.columns - 1) {
                of_row += cells[cell_at(&grid, view, x, y)];
                x += 1;
            }
            sum += of_row;
            y += 1;
        }
        // Its own counts most.
        near[ABSOLUTE_POS] = 0.1 * sum + cells[cell_at(&grid, view, column, row)];
        if column == 0 {
            let to = (3 * (view * grid.rows + row)) as usize;
            let mut asked = 0.0f32;
            let mut radiance = 0.0f32;
            let mut lit = 0.0f32;
            let mut x = 0u32;
            while x < grid.columns {
                let at = cell_at(&grid, view, x, row);
                asked += cells[at + 1];
                radiance += cells[at + 2];
                lit += cells[at + 3];
                x += 1;
            }
            rows[to] = asked;
            rows[to + 1] = radiance;
            rows[to + 2] = lit;
        }
    }
}

/// Turns the weights of pieces into sums within blocks, one thread a block.
#[cube(launch)]
pub(super) fn sum_blocks(
    words: &[u32],
    films: &[u32],
    near: &[f32],
    pieces: &mut [f32],
    views: u32,
    blocks: u32,
    count: u32,
) {
    if ABSOLUTE_POS < blocks as usize {
        let block = ABSOLUTE_POS as u32;
        let view = view_of(films, views, block, BLOCKS);
        let film = (OF_FILM * view) as usize;
        let mut before = 0u32;
        if view > 0 {
            before = films[film - OF_FILM as usize + BLOCKS];
        }
        let first = films[film + FIRST_PIECE] + BLOCK * (block - before);
        let past = (first + BLOCK).min(films[film + PAST_PIECE]);
        let grid = grid(words);
        let cells = view * grid.columns * grid.rows;
        let mut sum = 0.0f32;
        let mut i = first;
        while i < past {
            let at = (OF_PIECE * i) as usize;
            let weight = pieces[at + 2] * near[(cells + pieces[at + 4] as u32) as usize];
            if weight > 0.0 {
                sum += weight;
            }
            pieces[at + 2] = sum;
            i += 1;
        }
        pieces[(OF_PIECE * count + block) as usize] = sum;
    }
}

/// Adds up what rows of cells and blocks of pieces have, one thread a view: how much the loss depends on the radiance of
/// a pixel, the samples of edges on the film, and the sums of all blocks so far.
#[cube(launch)]
pub(super) fn sum_views(
    words: &[u32],
    films: &mut [u32],
    rows: &[f32],
    pieces: &mut [f32],
    scales: &mut [f32],
    views: u32,
    samples: u32,
    count: u32,
) {
    if ABSOLUTE_POS < views as usize {
        let view = ABSOLUTE_POS as u32;
        let film = (OF_FILM * view) as usize;
        let grid = grid(words);
        let mut asked = 0u32;
        let mut radiance = 0.0f32;
        let mut lit = 0.0f32;
        let mut row = view * grid.rows;
        while row < (view + 1) * grid.rows {
            let at = (3 * row) as usize;
            asked += rows[at] as u32;
            radiance += rows[at + 1];
            lit += rows[at + 2];
            row += 1;
        }
        scales[PARTS + ABSOLUTE_POS] = radiance / lit.max(1.0);
        films[film + OWN] = samples_of(asked, samples, films[film + MOST]);
        let mut block = 0u32;
        if view > 0 {
            block = films[film - OF_FILM as usize + BLOCKS];
        }
        let mut total = 0.0f32;
        while block < films[film + BLOCKS] {
            let at = (OF_PIECE * count + block) as usize;
            total += pieces[at];
            pieces[at] = total;
            block += 1;
        }
        films[film + TOTAL] = total.to_bits();
    }
}

/// Samples of edges on a film for so many pixels and samples of each: one for eight paths, and a thousand where these
/// are few (`samples_of_film`).
#[cube]
fn samples_of(pixels: u32, samples: u32, most: u32) -> u32 {
    let mut count = most;
    // No more than there is room for.
    if pixels as f32 * samples as f32 <= 3.0e9 {
        let paths = pixels * samples;
        let few = 8 * paths.min(1 << 20);
        count = (paths / 8 + (paths % 8).min(1)).max(few.min(1024)).max(1);
    }
    count.min(most)
}
