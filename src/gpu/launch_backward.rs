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
use super::records::{JUMPED, RECORD};
use super::sums::{
    AddingLaunch, TYPICAL, add_replicas, bits_of_each, choose_scales, clear, kept, look_again,
    take_scales,
};
use crate::device::label;
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
        let films = Films::new(views, job);
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
pub(super) struct Pass<'a> {
    pub client: Client,
    pub job: &'a Job,
    pub films: &'a Films,
    pub scene: [List; 3],
    upstream: List,
    records: List,
    pub pieces: List,
    pub table: List,
    /// The largest derivatives, sums in replicas, and those of all replicas and launches.
    sizes: List,
    totals: List,
    sums: List,
    /// Of the first pass, and of a second one where that has lost any.
    pub scales: [List; 2],
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
        let (replicas, numbers) = (job.views.sums.replicas(), job.views.sums.count);
        let pass = Self {
            scene: job.lists(&client),
            upstream,
            records: List::room(&client, of_path * at_once),
            pieces: List::new(&client, &films.pieces),
            table: List::new(&client, &films.table),
            sizes: List::room(&client, replicas * FIRST_SUM),
            totals: List::room(&client, replicas * (FIRST_SUM + 2 * numbers)),
            sums: List::room(&client, 3 * numbers),
            scales: [0, 1].map(|_| List::new(&client, &scales)),
            at_once,
            bits,
            replicas: replicas as u32,
            client,
            job,
            films,
        };
        pass.look_at_pixels();
        pass
    }

    /// Measures derivatives, adds them up, and adds the gradients of tensors to those of all.
    fn run(self, views: &[ViewPlaces], gradient: &List) {
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
        self.measure(&[some], spread, first, false);
        self.add_up(&all, first);
        // Where some were much larger than those that were measured, all are.
        launch!(
            &self.client,
            first.length,
            look_again(&self.totals, first, again, self.replicas)
        );
        self.measure(&all, 0, again, true);
        self.add_up(&all, again);
        launch!(&self.client, PARTS, take_scales(again, first));
        self.write(views, gradient);
    }

    /// Turns sums into gradients.
    fn write(&self, views: &[ViewPlaces], to: &List) {
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
                    &self.sums,
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

    fn clear(&self, words: &List, scales: &List) {
        launch!(&self.client, words.length, clear(words, scales));
    }

    /// Chooses scales by the sizes of the derivatives of some samples, or of all.
    fn measure(&self, pieces: &[Piece], spread: usize, scales: &List, all: bool) {
        let sizes = &self.sizes;
        self.clear(sizes, scales);
        self.add(pieces, spread, sizes, scales, || {});
        let keep = kept(self.bits, all);
        launch!(
            &self.client,
            PARTS,
            choose_scales(sizes, scales, self.replicas, keep)
        );
    }

    /// Adds all derivatives up: those of a launch in replicas, and these to sums before they have no room.
    fn add_up(&self, pieces: &[Piece], scales: &List) {
        let (totals, sums) = (&self.totals, &self.sums);
        self.clear(totals, scales);
        self.clear(sums, scales);
        self.add(pieces, 0, totals, scales, || {
            launch!(
                &self.client,
                sums.length / 3,
                add_replicas(totals, scales, sums, self.replicas)
            );
        });
    }

    /// Adds all derivatives of some samples to totals, and does something `after` each launch; `spread` is how many of a
    /// film are looked at, if not all.
    fn add(&self, pieces: &[Piece], spread: usize, totals: &List, scales: &List, after: impl Fn()) {
        for &piece in pieces {
            self.add_paths(piece, totals, scales);
            after();
        }
        if self.films.count == 0 {
            return;
        }
        let samples = match spread {
            0 => self.films.samples as usize,
            spread => spread * self.job.views.views,
        };
        for first in (0..samples).step_by(PATHS) {
            let threads = (samples - first).min(PATHS);
            self.add_film([first, threads, spread], totals, scales);
            after();
        }
    }

    /// The derivatives of the loss, times a factor, and scales of sums.
    pub fn loss(&self, scales: &List, scale: f32) -> LossLaunch {
        let upstream = self.upstream.argument();
        LossLaunch::new(upstream, scales.argument(), scale, self.job.outputs)
    }

    fn adding(&self, totals: &List) -> AddingLaunch {
        let region = totals.length as u32 / self.replicas;
        let of = self.job.views.derivatives;
        AddingLaunch::new(totals.argument(), self.replicas, region, of)
    }

    fn add_paths(&self, piece: Piece, totals: &List, scales: &List) {
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
                add_jumps(paths(), loss(), &self.records, self.adding(totals))
            );
        }
        launch!(
            &self.client,
            threads,
            go_back(paths(), loss(), &self.records, self.adding(totals))
        );
    }

    fn add_film(&self, samples: [usize; 3], totals: &List, scales: &List) {
        let job = self.job;
        let [first, threads, spread] = samples.map(|n| n as u32);
        let (views, of_view) = (job.views.views as u32, job.of_view as u32);
        let count = self.films.count;
        launch!(
            &self.client,
            threads as usize,
            film_jumps(
                job.views(&self.scene, job.views.features),
                FilmSamplesLaunch::new(first, threads, spread, views, of_view, count),
                &self.pieces,
                &self.table,
                self.loss(scales, 1.0),
                self.adding(totals),
                job.pixels.is_some()
            )
        );
    }
}

/// Points of a path at most.
fn points(job: &Job) -> usize {
    job.views.words[BOUNCES] as usize + 1
}

/// Words of a path's records.
fn of_path(job: &Job) -> usize {
    let jumped = JUMPED * u32::from(job.views.derivatives.jumps);
    (RECORD + jumped) as usize * points(job) + 1
}
