//! The backward pass on burn's devices: derivatives are measured, then added up and turned into gradients, without the
//! host in between.

use std::ops::Range;

use burn::backend::Cube;
use burn::backend::tensor::FloatTensor;
use burn::cubecl::prelude::*;
use burn::tensor::{Device, Shape};

use super::device::{List, floats, has_room, rows_of, without_backtrace, zeros};
use super::film::{FilmSamplesLaunch, Films, OF_PIECE, WHOLE, film_jumps};
use super::gradient::{Table, ViewPlaces, write_gradient};
use super::job::{Job, PATHS, Piece, launch};
use super::passes::{LossLaunch, add_jumps, go_back, keep_paths};
use super::pixel_gradients::look_at_pixels;
use super::records::{JUMPED, RECORD};
use super::sums::{
    AddingLaunch, TYPICAL, add_replicas, bits_of_each, choose_scales, clear, kept, look_again,
    take_scales,
};
use crate::device::label;
use crate::model::film::samples_of_film;
use crate::trace::{BOUNCES, FIRST_SUM, Features, MEASURE, PARTS};

/// Words of a launch's records at most.
const RECORDS: usize = 1 << 24;
/// Pixels, and samples of films, that are looked at for the sizes of derivatives, at least.
const MEASURED: usize = 4096;

/// The gradient `[N]` of all tensors, from that of the rows of all views `[B·P, C]`, each group of views by a job.
///
/// # Panics
/// If buffers can't be had, or kernels can't be compiled.
pub(crate) fn gradient_of(
    device: &Device,
    upstream: &FloatTensor<Cube>,
    jobs: &[(Range<usize>, Job)],
    views: &[ViewPlaces],
    numbers: usize,
) -> FloatTensor<Cube> {
    let fail = |why: String| -> ! { panic!("device {}: {why}", label(device)) };
    let (gradient, list) = zeros(upstream, Shape::from([numbers]));
    for (range, job) in jobs {
        let rows = range.start * job.of_view..range.end * job.of_view;
        let views = &views[range.clone()];
        let samples = samples_of_film(job.of_view as u32, job.samples);
        let of_film = views
            .iter()
            .map(|v| (v.0, v.0.has_edges.then_some(samples)));
        let of_film: Vec<_> = of_film.collect();
        let films = Films::new(&of_film, job.pixels.as_deref().map(Vec::as_slice));
        let lists = [
            ("the list of edges on films", films.pieces.len()),
            ("the table of pixels", films.table.len()),
        ];
        if let Err(why) = has_room(device, &lists) {
            fail(format!("{why}, or several batches of fewer views"));
        }
        let numbers = films.pieces.chunks_exact(OF_PIECE as usize);
        if numbers
            .take(films.count as usize)
            .any(|p| p[3].max(p[4]) >= WHOLE)
        {
            fail(format!("more than {WHOLE} edges or cells of 8 × 8 pixels"));
        }
        Pass::new(rows_of(upstream, rows), job, &films).run(views, &list);
    }
    // Buffers that could not be had and kernels that could not be compiled are known now.
    let (client, _) = floats(gradient.clone());
    if let Err(why) = client.check([&list.handle]) {
        fail(without_backtrace(why));
    }
    gradient
}

/// The launches of a backward pass.
struct Pass<'a> {
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
    /// Bits of derivatives, times their scale.
    bits: i32,
    replicas: u32,
}

impl<'a> Pass<'a> {
    /// From the derivatives by the rows of a job's views, in the order of their axes.
    fn new(upstream: FloatTensor<Cube>, job: &'a Job, films: &'a Films) -> Self {
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
        let completed = [&pass.pieces, &pass.table, &pass.scales[0]];
        let loss = pass.loss(&pass.scales[1], 1.0);
        look_at_pixels(&pass.client, (job, films), &pass.scene, loss, completed);
        pass
    }

    /// Measures derivatives, adds them up, and adds the gradients of tensors to those of all.
    fn run(self, views: &[ViewPlaces], gradient: &List) {
        let numbers = self.job.views.sums.count;
        let [first, again] = &self.scales;
        // One sample of some pixels tells how large derivatives are.
        let paths = self.job.count().saturating_mul(self.job.samples as usize);
        let stride = self.job.count().div_ceil((paths / 16).max(MEASURED));
        // Odd, so that it is not that of columns.
        let stride = stride.max(1) | 1;
        let some = Piece {
            first: 0,
            stride: stride as u32,
            count: self.job.count().div_ceil(stride).min(self.at_once) as u32,
            from: 0,
            past: 1,
            each: 1,
        };
        let all = self.job.pieces(self.at_once);
        let spread = (MEASURED / self.job.views.views).max(64);
        let sizes = self.totals(0);
        let totals = self.totals(numbers);
        let sums = List::room(&self.client, 3 * numbers);
        self.measure(&[some], spread, &sizes, first, false);
        self.add_up(&all, (&totals, &sums), first);
        // Where some were much larger than those that were measured, all are.
        launch!(
            &self.client,
            first.length,
            look_again(&totals, first, again, self.replicas, region(numbers))
        );
        self.measure(&all, 0, &sizes, again, true);
        self.add_up(&all, (&totals, &sums), again);
        launch!(&self.client, PARTS, take_scales(again, first));
        self.write(&sums, views, gradient);
    }

    /// Adds what a launch left in replicas to sums.
    fn fold(&self, totals: &List, sums: &List, scales: &List) {
        let numbers = sums.length / 3;
        launch!(
            &self.client,
            numbers,
            add_replicas(
                totals,
                scales,
                sums,
                self.replicas,
                region(numbers),
                numbers as u32
            )
        );
    }

    /// Turns sums into gradients.
    fn write(&self, sums: &List, views: &[ViewPlaces], to: &List) {
        for (v, &(view, scene, camera)) in views.iter().enumerate() {
            let table = Table::new(&self.job.views.sums, v, view, scene, camera);
            if table.numbers == 0 {
                continue;
            }
            launch!(
                &self.client,
                table.numbers,
                write_gradient(
                    self.job.views(&self.scene, Features::default()),
                    sums,
                    &self.scales[0],
                    &List::new(&self.client, &table.words),
                    &List::new(&self.client, &table.factors),
                    to,
                    v as u32,
                    table.numbers as u32
                )
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
        launch!(&self.client, totals.length, clear(totals, scales));
    }

    /// Chooses scales by the sizes of the derivatives of some samples, or of all.
    fn measure(&self, pieces: &[Piece], spread: usize, sizes: &List, scales: &List, all: bool) {
        self.clear(sizes, scales);
        self.add(pieces, spread, (sizes, None), scales);
        launch!(
            &self.client,
            PARTS,
            choose_scales(
                sizes,
                scales,
                self.replicas,
                region(0),
                kept(self.bits, all),
                self.job.views.views as u32
            )
        );
    }

    /// Adds all derivatives up.
    fn add_up(&self, pieces: &[Piece], (totals, sums): (&List, &List), scales: &List) {
        self.clear(totals, scales);
        self.clear(sums, scales);
        self.add(pieces, 0, (totals, Some(sums)), scales);
    }

    /// Adds all derivatives of some samples to totals, and these to sums, if there are any, before they have no room;
    /// `spread` is how many of a film are looked at, if not all.
    fn add(
        &self,
        pieces: &[Piece],
        spread: usize,
        (totals, sums): (&List, Option<&List>),
        scales: &List,
    ) {
        let region = (totals.length / self.replicas as usize) as u32;
        let fold = || sums.iter().for_each(|sums| self.fold(totals, sums, scales));
        for &piece in pieces {
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

    /// The derivatives of the loss, times a factor, and scales of sums.
    fn loss(&self, scales: &List, scale: f32) -> LossLaunch {
        let upstream = self.upstream.argument();
        LossLaunch::new(upstream, scales.argument(), scale, self.job.outputs)
    }

    fn adding(&self, totals: &List, region: u32) -> AddingLaunch {
        let of = self.job.views.derivatives;
        AddingLaunch::new(totals.argument(), self.replicas, region, of)
    }

    fn add_paths(&self, piece: Piece, totals: &List, scales: &List, region: u32) {
        let threads = piece.threads() as usize;
        let paths = || self.job.paths(&self.scene, piece);
        let loss = || self.loss(scales, 1.0 / self.job.samples as f32);
        launch!(
            &self.client,
            threads,
            keep_paths(paths(), loss(), &self.records)
        );
        if self.job.views.derivatives.jumps {
            launch!(
                &self.client,
                threads * points(self.job),
                add_jumps(
                    paths(),
                    loss(),
                    &self.records,
                    self.adding(totals, region),
                    self.job.views.words[BOUNCES]
                )
            );
        }
        launch!(
            &self.client,
            threads,
            go_back(paths(), loss(), &self.records, self.adding(totals, region))
        );
    }

    fn add_film(
        &self,
        [first, spread, threads]: [usize; 3],
        totals: &List,
        scales: &List,
        region: u32,
    ) {
        let job = self.job;
        let samples = FilmSamplesLaunch::new(
            first as u32,
            threads as u32,
            spread as u32,
            job.views.views as u32,
            job.of_view as u32,
            self.films.count,
        );
        launch!(
            &self.client,
            threads,
            film_jumps(
                job.views(&self.scene, job.views.features),
                samples,
                &self.pieces,
                &self.table,
                self.loss(scales, 1.0),
                self.adding(totals, region),
                job.pixels.is_some()
            )
        );
    }
}

/// Words of a replica of sums.
fn region(numbers: usize) -> u32 {
    (FIRST_SUM + 2 * numbers) as u32
}

/// Points of a path at most.
fn points(job: &Job) -> usize {
    job.views.words[BOUNCES] as usize + 1
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
