//! Determines how much the loss depends on the pixels of views, and so where edges are sampled on their films,
//! without read-backs.

use softray_kernels::cube::*;

use super::device::{List, launch};
use super::film::{
    BLOCKS, FIRST_PIECE, MAX_SAMPLES, OF_FILM, OF_PIECE, PAST_PIECE, RADIUS, SAMPLES, TOTAL,
    blocks_before, make_piece, view_of,
};
use super::job::Views;
use super::launch_backward::Pass;
use super::loss::Loss;
use super::sums::typical;
use softray_kernels::model::choice::is_positive;
use softray_kernels::model::film::{BLOCK, CELL, NEIGHBORS, samples_of_film};
use softray_kernels::model::numbers::{is_finite, is_nonzero};
use softray_kernels::trace::{Features, HeaderWord, NONE};

impl Pass<'_> {
    /// Determines how much the loss depends on pixels. It makes the pieces of edges on films, completes the table of
    /// films, and sets the scales of views.
    pub fn look_at_pixels(&self) {
        let (client, job, films) = (&self.client, self.job, self.films);
        let (table, pieces) = (&self.table, &self.pieces);
        let (scales, count) = (&self.scales, films.count);
        let views = job.views.views;
        let header = job.views.buffers.header();
        let [columns, rows] =
            [HeaderWord::width, HeaderWord::height].map(|n| header[n as usize].div_ceil(CELL));
        let grid = || GridLaunch::new(views as u32, columns, rows);
        let all = views * (columns * rows) as usize;
        let cells = List::room(client, OF_CELL as usize * all);
        let near = List::room(client, all);
        let of_rows = List::room(client, OF_CELL as usize * views * rows as usize);
        launch!(
            client,
            all,
            look_at_cells(
                job.views(&self.client, &self.scene, Features::default()),
                grid(),
                table,
                self.loss(1.0),
                &cells,
                job.of_view as u32,
                job.pixels.is_some()
            )
        );
        let of_scene = job.views.features;
        let shape = Features {
            moves: of_scene.moves,
            parallel: of_scene.parallel,
            ..Features::default()
        };
        launch!(
            client,
            all + count as usize,
            look_around(
                job.views(&self.client, &self.scene, shape),
                grid(),
                table,
                &cells,
                &near,
                &of_rows,
                pieces,
                count
            )
        );
        if films.blocks > 0 {
            launch!(
                client,
                films.blocks as usize,
                sum_blocks(grid(), table, &near, pieces, count)
            );
        }
        launch!(
            client,
            views,
            sum_views(
                grid(),
                table,
                &of_rows,
                pieces,
                scales,
                self.form.parts as u32,
                job.samples,
                count
            )
        );
    }
}

/// Number of values of a cell, and of a row of cells: how much the loss depends on its pixels, the number of pixels
/// with nonzero derivatives, how much the loss depends on their radiance, and the number of pixels with nonzero
/// derivatives with respect to radiance.
const OF_CELL: u32 = 4;

/// The cells of some views, in columns and rows per view.
#[apply(argument!)]
pub(super) struct Grid {
    views: u32,
    columns: u32,
    rows: u32,
}

/// A cell of a view.
#[apply(record!)]
struct Cell {
    view: u32,
    row: u32,
    column: u32,
}

#[cube]
impl Grid {
    fn cells(&self) -> u32 {
        self.views * self.columns * self.rows
    }

    fn cell(&self, number: u32) -> Cell {
        Cell {
            view: number / (self.columns * self.rows),
            row: number / self.columns % self.rows,
            column: number % self.columns,
        }
    }

    /// Returns the index of a cell's values.
    fn at(&self, view: u32, x: u32, y: u32) -> usize {
        (OF_CELL * ((view * self.rows + y) * self.columns + x)) as usize
    }
}

/// Sums the derivatives over the pixels of each cell, one thread per cell.
#[cube(launch)]
fn look_at_cells(
    views: Views,
    grid: Grid,
    films: &[u32],
    loss: Loss,
    cells: &mut [f32],
    of_view: u32,
    #[comptime] listed: bool,
) {
    if ABSOLUTE_POS < grid.cells() as usize {
        let cell = grid.cell(ABSOLUTE_POS as u32);
        let first_x = cell.column * CELL;
        let first_y = cell.row * CELL;
        let scene = views.scene(cell.view);
        let places = &films[(OF_FILM * grid.views) as usize..];
        let mut weight = 0.0f32;
        let mut nonzero = 0.0f32;
        let mut radiance = 0.0f32;
        let mut lit = 0.0f32;
        for y in first_y..(first_y + CELL).min(scene.height) {
            for x in first_x..(first_x + CELL).min(scene.width) {
                let mut i = y * scene.width + x;
                if listed {
                    i = places[i as usize];
                }
                if i != NONE {
                    let g = loss.of_row(&scene, cell.view * of_view + i);
                    let own = g.radiance.abs().element_sum();
                    let all = g.size();
                    if is_nonzero(all) {
                        nonzero += 1.0;
                    }
                    // Values that are not finite do not count.
                    if is_finite(all) {
                        weight += all;
                    }
                    if is_positive(own) {
                        radiance += own;
                        lit += 1.0;
                    }
                }
            }
        }
        let at = grid.at(cell.view, cell.column, cell.row);
        cells[at] = weight;
        cells[at + 1] = nonzero;
        cells[at + 2] = radiance;
        cells[at + 3] = lit;
    }
}

/// Computes how much the loss depends on the pixels that see a point of a cell, one thread per cell. The threads of
/// the first column also sum the values of their rows of cells. Further threads make the pieces in `slots` slots.
#[cube(launch)]
fn look_around(
    views: Views,
    grid: Grid,
    films: &[u32],
    cells: &[f32],
    near: &mut [f32],
    rows: &mut [f32],
    pieces: &mut [f32],
    slots: u32,
) {
    let others = grid.cells() as usize;
    if ABSOLUTE_POS >= others && ABSOLUTE_POS < others + slots as usize {
        let slot = (ABSOLUTE_POS - others) as u32;
        make_piece(&views, films, pieces, grid.views, slot);
    }
    if ABSOLUTE_POS < others {
        let cell = grid.cell(ABSOLUTE_POS as u32);
        let column = cell.column;
        let row = cell.row;
        let view = cell.view;
        let radius = f32::from_bits(films[(OF_FILM * view) as usize + RADIUS]);
        let around = 1 + (radius * (1.0f32 / CELL as f32)).ceil() as u32;
        let mut sum = 0.0f32;
        for y in row - around.min(row)..(row + around + 1).min(grid.rows) {
            let mut of_row = 0.0f32;
            for x in column - around.min(column)..(column + around + 1).min(grid.columns) {
                of_row += cells[grid.at(view, x, y)];
            }
            sum += of_row;
        }
        // The cell's own pixels have the largest weight.
        near[ABSOLUTE_POS] = NEIGHBORS * sum + cells[grid.at(view, column, row)];
        if column == 0 {
            for k in 0..OF_CELL {
                let mut of_row = 0.0f32;
                for x in 0..grid.columns {
                    of_row += cells[grid.at(view, x, row) + k as usize];
                }
                rows[(OF_CELL * (view * grid.rows + row) + k) as usize] = of_row;
            }
        }
    }
}

/// Replaces the weights of pieces by running sums within blocks, one thread per block.
#[cube(launch)]
fn sum_blocks(grid: Grid, films: &[u32], near: &[f32], pieces: &mut [f32], count: u32) {
    if ABSOLUTE_POS < blocks_before(films, grid.views) as usize {
        let block = ABSOLUTE_POS as u32;
        let view = view_of(films, grid.views, block, BLOCKS);
        let film = (OF_FILM * view) as usize;
        let before = blocks_before(films, view);
        let first = films[film + FIRST_PIECE] + BLOCK * (block - before);
        let past = (first + BLOCK).min(films[film + PAST_PIECE]);
        let cells = view * grid.columns * grid.rows;
        let mut sum = 0.0f32;
        for i in first..past {
            let at = (OF_PIECE * i) as usize;
            let weight = pieces[at + 2] * near[(cells + pieces[at + 3] as u32) as usize];
            if weight > 0.0 {
                sum += weight;
            }
            pieces[at + 2] = sum;
        }
        pieces[(OF_PIECE * count + block) as usize] = sum;
    }
}

/// Sums the values of rows of cells and of blocks of pieces, one thread per view. It computes how much the loss
/// depends on average on the radiance of a pixel and on a whole pixel, the number of edge samples on the film, and
/// running sums over blocks.
#[cube(launch)]
fn sum_views(
    grid: Grid,
    films: &mut [u32],
    rows: &[f32],
    pieces: &mut [f32],
    scales: &mut [f32],
    parts: u32,
    samples: u32,
    count: u32,
) {
    if ABSOLUTE_POS < grid.views as usize {
        let view = ABSOLUTE_POS as u32;
        let film = (OF_FILM * view) as usize;
        let mut weight = 0.0f32;
        let mut nonzero = 0u32;
        let mut radiance = 0.0f32;
        let mut lit = 0.0f32;
        for row in view * grid.rows..(view + 1) * grid.rows {
            let at = (OF_CELL * row) as usize;
            weight += rows[at];
            nonzero += rows[at + 1] as u32;
            radiance += rows[at + 2];
            lit += rows[at + 3];
        }
        let first = typical(parts);
        scales[(first + view) as usize] = radiance / lit.max(1.0);
        scales[(first + grid.views + view) as usize] = weight / (nonzero as f32).max(1.0);
        films[film + SAMPLES] = samples_of_film(nonzero, samples).min(films[film + MAX_SAMPLES]);
        let mut first = 0u32;
        if view > 0 {
            first = films[film - OF_FILM as usize + BLOCKS];
        }
        let mut total = 0.0f32;
        for block in first..films[film + BLOCKS] {
            let at = (OF_PIECE * count + block) as usize;
            total += pieces[at];
            pieces[at] = total;
        }
        films[film + TOTAL] = total.to_bits();
    }
}
