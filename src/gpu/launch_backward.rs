//! The backward pass on burn's devices: derivatives are measured, then added up and turned into gradients, without the
//! host in between.

use burn::backend::Cube;
use burn::backend::tensor::FloatTensor;
use burn::cubecl::prelude::*;

use super::asked::{look_around, look_at_cells, sum_blocks, sum_views};
use super::device::floats;
use super::film::film_jumps;
use super::film_table::Films;
use super::gradient::{Table, TensorPlaces, write_gradient};
use super::job::{GROUP, Job, PATHS, Samples, groups};
use super::layout::{HEIGHT, WIDTH};
use super::list::List;
use super::passes::{add_jumps, go_back, keep_paths};
use super::records::{JUMPED, RECORD};
use super::sums::{
    FIRST_SUM, MEASURE, PARTS, add_replicas, choose_scales, clear, look_again, take_scales,
};
use crate::kernel::{CELL, View};

/// Words of a launch's records at most.
const RECORDS: usize = 1 << 24;
/// Pixels, and samples of films, that are looked at for the sizes of derivatives, at least.
const MEASURED: usize = 4096;

/// The launches of a backward pass.
pub(crate) struct Pass<'a> {
    client: Client,
    job: &'a Job,
    films: &'a Films,
    scene: [List; 3],
    upstream: List,
    records: List,
    pieces: List,
    table: List,
    /// Of the first pass, and of a second one where that has lost any.
    scales: [List; 2],
    /// Paths of a launch.
    at_once: usize,
    replicas: u32,
}

impl<'a> Pass<'a> {
    /// From the derivatives by the rows of a job's views, in the order of their axes.
    pub fn new(upstream: FloatTensor<Cube>, job: &'a Job, films: &'a Films) -> Self {
        let (client, upstream) = floats(upstream);
        let of_path = of_path(job);
        let at_once = (RECORDS / of_path).clamp(1, job.count() * job.samples as usize);
        let mut scales = vec![MEASURE; PARTS];
        scales.resize(PARTS + job.views.views, 0.0);
        let mut pieces = films.pieces.clone();
        pieces.resize(pieces.len() + films.blocks.max(1) as usize, 0.0);
        let pass = Self {
            scene: job.lists(&client),
            upstream,
            records: List::room(&client, of_path * at_once),
            pieces: List::new(&client, &pieces),
            table: List::new(&client, &films.table),
            scales: [0, 1].map(|_| List::new(&client, &scales)),
            at_once,
            replicas: job.views.sums.replicas() as u32,
            client,
            job,
            films,
        };
        pass.look_at_pixels();
        pass
    }

    /// Looks at how much the loss depends on pixels, and so where edges are drawn on films.
    fn look_at_pixels(&self) {
        let (job, views) = (self.job, self.job.views.views);
        let [floats, words, _] = &self.scene;
        let header = &job.views.words;
        let [columns, rows] = [header[WIDTH], header[HEIGHT]].map(|n| n.div_ceil(CELL) as usize);
        let cells = List::room(&self.client, 4 * views * columns * rows);
        let near = List::room(&self.client, views * columns * rows);
        let of_rows = List::room(&self.client, 3 * views * rows);
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
                self.films.count(),
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
            self.films.count(),
        );
    }

    /// Measures derivatives, adds them up, and adds the gradients of tensors to those of all; `places` are those of each
    /// view's scene and camera.
    pub fn run(self, views: &[(&View, TensorPlaces, TensorPlaces)], gradient: &List) {
        let numbers = self.job.views.sums.count;
        let [first, again] = &self.scales;
        // One sample of some pixels tells how large derivatives are.
        let paths = self.job.count().saturating_mul(self.job.samples as usize);
        let stride = self.job.count().div_ceil((paths / 16).max(MEASURED)).max(1);
        let some = Samples {
            first: 0,
            stride,
            count: self.job.count().div_ceil(stride).min(self.at_once),
            from: 0,
            past: 1,
        };
        let all = self.job.pieces(self.at_once);
        let film_stride = (self.films.samples as usize / MEASURED).max(1);
        let sizes = self.totals(0);
        self.clear(&sizes, first);
        self.add(&[some], film_stride, &sizes, first);
        self.choose(&sizes, first, 40);
        let totals = self.totals(numbers);
        self.clear(&totals, first);
        self.add(&all, 1, &totals, first);
        // Where some were much larger than those that were measured, all are.
        look_again::launch(
            &self.client,
            groups(first.length),
            CubeDim::new_1d(GROUP),
            totals.argument(),
            first.argument(),
            again.argument(),
            self.replicas,
            region(numbers),
        );
        let sizes = self.totals(0);
        self.clear(&sizes, again);
        self.add(&all, 1, &sizes, again);
        self.choose(&sizes, again, 30);
        self.clear(&totals, again);
        self.add(&all, 1, &totals, again);
        take_scales::launch(
            &self.client,
            groups(PARTS),
            CubeDim::new_1d(GROUP),
            again.argument(),
            first.argument(),
        );
        self.write(&totals, views, gradient);
    }

    /// Turns sums into gradients.
    fn write(&self, totals: &List, views: &[(&View, TensorPlaces, TensorPlaces)], to: &List) {
        let numbers = self.job.views.sums.count;
        let sums = List::room(&self.client, 2 * numbers);
        add_replicas::launch(
            &self.client,
            groups(numbers),
            CubeDim::new_1d(GROUP),
            totals.argument(),
            sums.argument(),
            self.replicas,
            region(numbers),
            numbers as u32,
        );
        let [floats, words, _] = &self.scene;
        for (v, &(view, scene, camera)) in views.iter().enumerate() {
            let table = Table::new(&self.job.views.sums, v, view, scene, camera);
            if table.numbers == 0 {
                continue;
            }
            write_gradient::launch(
                &self.client,
                groups(table.numbers),
                CubeDim::new_1d(GROUP),
                floats.argument(),
                words.argument(),
                sums.argument(),
                self.scales[0].argument(),
                List::new(&self.client, &table.words).argument(),
                List::new(&self.client, &table.factors).argument(),
                to.argument(),
                v as u32,
                table.numbers as u32,
            );
        }
    }

    /// Room for sums.
    fn totals(&self, numbers: usize) -> List {
        List::room(
            &self.client,
            self.replicas as usize * region(numbers) as usize,
        )
    }

    fn clear(&self, totals: &List, scales: &List) {
        clear::launch(
            &self.client,
            groups(totals.length),
            CubeDim::new_1d(GROUP),
            totals.argument(),
            scales.argument(),
        );
    }

    fn choose(&self, sizes: &List, scales: &List, keep: i32) {
        choose_scales::launch(
            &self.client,
            groups(PARTS),
            CubeDim::new_1d(GROUP),
            sizes.argument(),
            scales.argument(),
            self.replicas,
            region(0),
            keep,
            self.job.views.views as u32,
        );
    }

    /// Adds all derivatives of some samples.
    fn add(&self, pieces: &[Samples], film_stride: usize, totals: &List, scales: &List) {
        let region = (totals.length / self.replicas as usize) as u32;
        for piece in pieces {
            self.add_paths(piece, totals, scales, region);
        }
        let samples = self.films.samples as usize;
        for first in (0..samples).step_by(PATHS * film_stride) {
            let left = (samples - first).div_ceil(film_stride);
            let threads = [first, film_stride, left.min(PATHS)];
            self.add_film(threads, totals, scales, region);
        }
    }

    fn add_paths(&self, piece: &Samples, totals: &List, scales: &List, region: u32) {
        let [floats, words, pixels] = &self.scene;
        let job = self.job;
        let (listed, outputs) = (job.pixels.is_some(), job.outputs);
        let (features, of) = (job.views.features, job.views.derivatives);
        let scale = 1.0 / job.samples as f32;
        keep_paths::launch(
            &self.client,
            groups(piece.paths()),
            CubeDim::new_1d(GROUP),
            floats.argument(),
            words.argument(),
            pixels.argument(),
            self.upstream.argument(),
            self.records.argument(),
            scales.argument(),
            piece.argument(job),
            scale,
            listed,
            outputs,
            features,
        );
        if of.jumps {
            add_jumps::launch(
                &self.client,
                groups(piece.paths() * points(job)),
                CubeDim::new_1d(GROUP),
                floats.argument(),
                words.argument(),
                pixels.argument(),
                self.upstream.argument(),
                self.records.argument(),
                totals.argument(),
                scales.argument(),
                self.replicas,
                region,
                piece.argument(job),
                scale,
                listed,
                outputs,
                features,
                of,
            );
        }
        go_back::launch(
            &self.client,
            groups(piece.paths()),
            CubeDim::new_1d(GROUP),
            floats.argument(),
            words.argument(),
            pixels.argument(),
            self.upstream.argument(),
            self.records.argument(),
            totals.argument(),
            scales.argument(),
            self.replicas,
            region,
            piece.argument(job),
            scale,
            listed,
            outputs,
            features,
            of,
        );
    }

    fn add_film(
        &self,
        [first, stride, threads]: [usize; 3],
        totals: &List,
        scales: &List,
        region: u32,
    ) {
        let [floats, words, _] = &self.scene;
        let job = self.job;
        film_jumps::launch(
            &self.client,
            groups(threads),
            CubeDim::new_1d(GROUP),
            floats.argument(),
            words.argument(),
            self.pieces.argument(),
            self.table.argument(),
            self.upstream.argument(),
            totals.argument(),
            scales.argument(),
            self.replicas,
            region,
            first as u32,
            stride as u32,
            threads as u32,
            self.films.count(),
            job.views.views as u32,
            job.of_view as u32,
            job.pixels.is_some(),
            job.outputs,
            job.views.features,
            job.views.derivatives,
        );
    }
}

/// Words of a replica of sums.
fn region(numbers: usize) -> u32 {
    (FIRST_SUM + 2 * numbers) as u32
}

/// Points of a path at most.
fn points(job: &Job) -> usize {
    job.views.words[super::layout::BOUNCES] as usize + 1
}

/// Words of a path's records.
fn of_path(job: &Job) -> usize {
    let jumped = if job.views.derivatives.jumps {
        JUMPED
    } else {
        0
    };
    (RECORD + jumped) as usize * points(job) + 1
}
