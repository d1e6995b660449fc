//! Launches that look at the gradient of an image, before the others of a backward pass.

use burn::cubecl::prelude::*;

use super::job::{GROUP, groups};
use super::launch_backward::Pass;
use super::list::List;
use super::pixel_gradients::{OF_CELL, look_around, look_at_cells, sum_blocks, sum_views};
use crate::model::film::CELL;
use crate::trace::{HEIGHT, WIDTH};

impl Pass<'_> {
    /// Looks at how much the loss depends on pixels, and so where edges are drawn on films.
    pub(super) fn look_at_pixels(&self) {
        let (job, views) = (self.job, self.job.views.views);
        let [floats, words, _] = &self.scene;
        let header = &job.views.words;
        let [columns, rows] = [header[WIDTH], header[HEIGHT]].map(|n| n.div_ceil(CELL) as usize);
        let cells = List::room(&self.client, OF_CELL as usize * views * columns * rows);
        let near = List::room(&self.client, views * columns * rows);
        let of_rows = List::room(&self.client, OF_CELL as usize * views * rows);
        let cube = CubeDim::new_1d(GROUP);
        look_at_cells::launch(
            &self.client,
            groups(views * columns * rows),
            cube,
            floats.argument(),
            words.argument(),
            self.table.argument(),
            self.upstream.argument(),
            cells.argument(),
            views as u32,
            job.of_view as u32,
            job.pixels.is_some(),
            job.outputs,
        );
        look_around::launch(
            &self.client,
            groups(views * columns * rows),
            cube,
            words.argument(),
            self.table.argument(),
            cells.argument(),
            near.argument(),
            of_rows.argument(),
            views as u32,
        );
        if self.films.blocks > 0 {
            sum_blocks::launch(
                &self.client,
                groups(self.films.blocks as usize),
                cube,
                words.argument(),
                self.table.argument(),
                near.argument(),
                self.pieces.argument(),
                views as u32,
                self.films.blocks,
                self.films.count,
            );
        }
        sum_views::launch(
            &self.client,
            groups(views),
            cube,
            words.argument(),
            self.table.argument(),
            of_rows.argument(),
            self.pieces.argument(),
            self.scales[0].argument(),
            views as u32,
            job.samples,
            self.films.count,
        );
    }
}
