//! The backward pass on burn's devices: derivatives are measured, then added up and turned into gradients, without the
//! host in between.

use burn::backend::Cube;
use burn::backend::tensor::FloatTensor;
use burn::cubecl::prelude::*;

use super::device::floats;
use super::film::film_jumps;
use super::film_table::Films;
use super::gradient::{Table, ViewPlaces, write_gradient};
use super::job::{GROUP, Job, PATHS, Samples, groups};
use super::list::List;
use super::passes::{add_jumps, go_back, keep_paths};
use super::records::{JUMPED, RECORD};
use super::sums::{
    TYPICAL, add_replicas, bits_of_each, choose_scales, clear, kept, look_again, take_scales,
};
use crate::trace::{FIRST_SUM, MEASURE, PARTS};

/// Words of a launch's records at most.
const RECORDS: usize = 1 << 24;
/// Pixels, and samples of films, that are looked at for the sizes of derivatives, at least.
const MEASURED: usize = 4096;

/// The launches of a backward pass.
pub(crate) struct Pass<'a> {
    pub(super) client: Client,
    pub(super) job: &'a Job,
    pub(super) films: &'a Films,
    pub(super) scene: [List; 3],
    pub(super) upstream: List,
    records: List,
    pub(super) pieces: List,
    pub(super) table: List,
    /// Of the first pass, and of a second one where that has lost any.
    pub(super) scales: [List; 2],
    /// Paths of a launch.
    at_once: usize,
    /// Bits of derivatives, times their scale.
    bits: i32,
    replicas: u32,
}

impl<'a> Pass<'a> {
    /// From the derivatives by the rows of a job's views, in the order of their axes.
    pub fn new(upstream: FloatTensor<Cube>, job: &'a Job, films: &'a Films) -> Self {
        let (client, upstream) = floats(upstream);
        let of_path = of_path(job);
        let at_once = (RECORDS / of_path).clamp(1, job.count() * job.samples as usize);
        let bits = bits_of_each(at_once as u64 * 16 * points(job) as u64);
        let mut scales = vec![MEASURE; PARTS];
        scales.push(2.0f32.powi(bits));
        scales.resize(TYPICAL + 2 * job.views.views, 0.0);
        let pass = Self {
            scene: job.lists(&client),
            upstream,
            records: List::room(&client, of_path * at_once),
            pieces: List::new(&client, &films.pieces),
            table: List::new(&client, &films.table),
            scales: [0, 1].map(|_| List::new(&client, &scales)),
            at_once,
            bits,
            replicas: job.views.sums.replicas() as u32,
            client,
            job,
            films,
        };
        pass.look_at_pixels();
        pass
    }

    /// Measures derivatives, adds them up, and adds the gradients of tensors to those of all.
    pub fn run(self, views: &[ViewPlaces], gradient: &List) {
        let numbers = self.job.views.sums.count;
        let [first, again] = &self.scales;
        // One sample of some pixels tells how large derivatives are.
        let paths = self.job.count().saturating_mul(self.job.samples as usize);
        let stride = self.job.count().div_ceil((paths / 16).max(MEASURED));
        // Odd, so that it is not that of columns.
        let stride = stride.max(1) | 1;
        let some = Samples {
            first: 0,
            stride,
            count: self.job.count().div_ceil(stride).min(self.at_once),
            from: 0,
            past: 1,
        };
        let all = self.job.pieces(self.at_once);
        let spread = (MEASURED / self.job.views.views).max(64);
        let sizes = self.totals(0);
        let totals = self.totals(numbers);
        let sums = List::room(&self.client, 3 * numbers);
        self.clear(&sizes, first);
        self.add(&[some], spread, (&sizes, None), first);
        self.choose(&sizes, first, kept(self.bits, false));
        self.clear(&totals, first);
        self.clear(&sums, first);
        self.add(&all, 0, (&totals, Some(&sums)), first);
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
        self.clear(&sizes, again);
        self.add(&all, 0, (&sizes, None), again);
        self.choose(&sizes, again, kept(self.bits, true));
        self.clear(&totals, again);
        self.clear(&sums, again);
        self.add(&all, 0, (&totals, Some(&sums)), again);
        take_scales::launch(
            &self.client,
            groups(PARTS),
            CubeDim::new_1d(GROUP),
            again.argument(),
            first.argument(),
        );
        self.write(&sums, views, gradient);
    }

    /// Adds what a launch left in replicas to sums.
    fn fold(&self, totals: &List, sums: &List, scales: &List) {
        let numbers = sums.length / 3;
        add_replicas::launch(
            &self.client,
            groups(numbers),
            CubeDim::new_1d(GROUP),
            totals.argument(),
            scales.argument(),
            sums.argument(),
            self.replicas,
            region(numbers),
            numbers as u32,
        );
    }

    /// Turns sums into gradients.
    fn write(&self, sums: &List, views: &[ViewPlaces], to: &List) {
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

    /// Adds all derivatives of some samples to totals, and these to sums, if there are any, before they have no room;
    /// `spread` is how many of a film are looked at, if not all.
    fn add(
        &self,
        pieces: &[Samples],
        spread: usize,
        (totals, sums): (&List, Option<&List>),
        scales: &List,
    ) {
        let region = (totals.length / self.replicas as usize) as u32;
        let fold = || sums.iter().for_each(|sums| self.fold(totals, sums, scales));
        for piece in pieces {
            self.add_paths(piece, totals, scales, region);
            fold();
        }
        if self.films.count == 0 {
            return;
        }
        let samples = match spread {
            0 => self.films.samples as usize,
            spread => spread * self.job.views.views,
        };
        for first in (0..samples).step_by(PATHS) {
            let threads = [first, spread, (samples - first).min(PATHS)];
            self.add_film(threads, totals, scales, region);
            fold();
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
        [first, spread, threads]: [usize; 3],
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
            spread as u32,
            threads as u32,
            self.films.count,
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
    job.views.words[crate::trace::BOUNCES] as usize + 1
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
