//! The backward pass on burn's devices: derivatives are measured, then summed and converted into gradients. Nothing
//! is read back in between, except for statistics.

use burn::backend::Cube;
use burn::backend::tensor::FloatTensor;
use burn::cubecl::prelude::*;
use burn::tensor::{Device, Shape};

use super::device::{GROUP, List, floats, has_room, launch, rows_of, without_backtrace, zeros};
use super::film::{FilmSamplesLaunch, Films, OF_PIECE, WHOLE, film_jumps};
use super::gradient::{Table, ViewPlaces, write_gradient};
use super::job::{Job, PATHS, Piece};
use super::loss::LossLaunch;
use super::passes::{add_jumps, go_back, keep_paths};
use super::records::{JUMPED, RECORD};
use super::searches::{add_before, blocks_of, count_searches, in_order, words_of_order};
use super::sums::{
    AddingLaunch, MORE, TYPICAL, add_replicas, bits_of_each, choose_scales, words_of_sums,
};
use crate::device::{self, label, stage};
use crate::trace::{BOUNCES, FIRST_SUM, Features, MEASURE, PARTS};

/// Maximum number of words of the paths' records in a launch, unless one path needs more.
const RECORDS: usize = 1 << 25;
/// Approximate minimum number of pixels, and of film samples, in the measurement of derivatives.
const MEASURED: usize = 4096;

/// Returns the gradient `[N]` of all tensors, from the gradient of the rows of all views `[B·P, C]`. Each group of
/// views has its own job.
///
/// # Panics
/// Panics if buffers cannot be allocated, if kernels cannot be compiled, if the device has no room for the edges on
/// films or the table of pixels, or if the index of an edge or of a cell reaches [`WHOLE`].
pub(crate) fn gradient_of(
    device: &Device,
    upstream: &FloatTensor<Cube>,
    jobs: &[(Vec<usize>, Job)],
    views: &[ViewPlaces],
    numbers: usize,
) -> FloatTensor<Cube> {
    let fail = |why: String| -> ! {
        jobs.iter().for_each(|(_, job)| job.views.buffers.forget());
        panic!("device {}: {why}", label(device))
    };
    let (gradient, list) = zeros(upstream, Shape::from([numbers]));
    for (group, job) in jobs {
        let views: Vec<ViewPlaces> = group.iter().map(|&view| views[view]).collect();
        let films = stage("edges on films", || Films::new(&views, job));
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
        let rows = rows_of(upstream, group, job.of_view);
        Pass::new(rows, job, &films, &views).run(&list);
    }
    // This check reports buffers that could not be allocated and kernels that could not be compiled.
    let (client, _) = floats(gradient.clone());
    if let Err(why) = client.check([&list.handle]) {
        fail(without_backtrace(why));
    }
    gradient
}

/// The launches of a backward pass for one job.
pub(super) struct Pass<'a> {
    pub client: Client,
    pub job: &'a Job,
    pub films: &'a Films,
    pub scene: [List; 3],
    upstream: List,
    records: List,
    pub pieces: List,
    pub table: List,
    pub scales: List,
    /// The largest derivatives of parts, and space for all sums.
    sizes: List,
    sums: List,
    /// How gradients are computed from sums.
    tensors: Table,
    of_tensors: [List; 2],
    /// Maximum number of paths in a launch.
    at_once: usize,
    /// Number of bits of each scaled derivative.
    bits: i32,
}

impl<'a> Pass<'a> {
    /// Prepares a pass from the derivatives of the loss with respect to the rows of a job's views, in a contiguous
    /// tensor.
    fn new(
        upstream: FloatTensor<Cube>,
        job: &'a Job,
        films: &'a Films,
        views: &[ViewPlaces],
    ) -> Self {
        let (client, upstream) = floats(upstream);
        let of_path = of_path(job);
        let at_once = (RECORDS / of_path).clamp(1, job.count() * job.samples as usize);
        let order = words_of_order(at_once * points(job));
        let most = at_once * points(job) + PATHS.min(films.samples as usize);
        let bits = bits_of_each(16 * most as u64);
        let mut scales = vec![MEASURE; PARTS];
        scales.push(2.0f32.powi(bits));
        scales.resize(TYPICAL + 2 * job.views.views, 0.0);
        let tensors = Table::new(&job.views.sums, views);
        let [pieces, table, scales, sizes, words, factors] = List::send(
            &client,
            [
                f32::as_bytes(&films.pieces),
                u32::as_bytes(&films.table),
                f32::as_bytes(&scales),
                u32::as_bytes(&[0; FIRST_SUM]),
                u32::as_bytes(&tensors.words),
                f32::as_bytes(&tensors.factors),
            ],
        );
        let sums = &job.views.sums;
        let pass = Self {
            scene: job.lists(&client),
            upstream,
            records: List::room(&client, of_path * at_once + order),
            pieces,
            table,
            scales,
            sizes,
            sums: List::room(&client, words_of_sums(sums.replicas(), sums.count)),
            tensors,
            of_tensors: [words, factors],
            at_once,
            bits,
            client,
            job,
            films,
        };
        pass.look_at_pixels();
        pass
    }

    /// Measures derivatives, sums them, and adds the gradients of the tensors to `gradient`.
    fn run(self, gradient: &List) {
        if self.tensors.numbers == 0 {
            return;
        }
        self.measure();
        let samples = self.films.samples as usize;
        let mut pieces = self.job.pieces(self.at_once).into_iter().peekable();
        while let Some(piece) = pieces.next() {
            self.add_paths(piece, &self.sums);
            self.count_searches(piece);
            // The replicas of the last piece are added together with the first film samples.
            if pieces.peek().is_some() || samples == 0 {
                self.fold();
            }
        }
        for first in (0..samples).step_by(PATHS) {
            self.add_film([first, (samples - first).min(PATHS), 0], &self.sums);
            self.fold();
        }
        let [words, factors] = &self.of_tensors;
        launch!(
            &self.client,
            self.tensors.numbers,
            write_gradient(
                self.job
                    .views(&self.client, &self.scene, Features::default()),
                &self.sums,
                &self.scales,
                words,
                factors,
                gradient,
                self.tensors.numbers as u32
            )
        );
    }

    /// Chooses scales from the sizes of the derivatives of some paths and film samples.
    fn measure(&self) {
        let paths = self.job.count().saturating_mul(self.job.samples as usize);
        let stride = self.job.count().div_ceil((paths / 16).max(MEASURED));
        // Odd, so that the measured pixels are not all in a few columns of the image.
        let stride = stride.max(1) | 1;
        let some = Piece {
            first: 0,
            stride: stride as u32,
            count: self.job.count().div_ceil(stride).min(self.at_once) as u32,
            from: 0,
            past: 1,
            each: 1,
        };
        self.add_paths(some, &self.sizes);
        let views = self.job.views.views;
        let spread = (MEASURED / views).max(64);
        if self.films.samples > 0 {
            self.add_film([0, spread * views, spread], &self.sizes);
        }
        launch!(
            &self.client,
            self.sums.length.max(PARTS),
            choose_scales(&self.sizes, &self.scales, self.bits - MORE, &self.sums)
        );
    }

    /// Adds the replicas of a launch to the sums of all launches.
    fn fold(&self) {
        let sums = &self.job.views.sums;
        let numbers = sums.count as u32;
        launch!(
            &self.client,
            sums.count,
            add_replicas(&self.sums, sums.replicas() as u32, numbers)
        );
    }

    /// Returns the derivatives of the loss, times a factor, and the scales of sums as a kernel argument.
    pub fn loss(&self, scale: f32) -> LossLaunch {
        let upstream = self.upstream.argument();
        LossLaunch::new(upstream, self.scales.argument(), scale, self.job.outputs)
    }

    fn adding(&self, to: &List) -> AddingLaunch {
        let sums = &self.job.views.sums;
        let (replicas, numbers) = (sums.replicas() as u32, sums.count as u32);
        AddingLaunch::new(to.argument(), replicas, numbers, self.job.views.derivatives)
    }

    fn add_paths(&self, piece: Piece, to: &List) {
        let threads = piece.threads() as usize;
        let paths = || self.job.paths(&self.client, &self.scene, piece);
        let loss = || self.loss(1.0 / self.job.samples as f32);
        launch!(
            &self.client,
            threads,
            keep_paths(paths(), loss(), &self.records)
        );
        if self.job.views.derivatives.jumps {
            let points = threads * points(self.job);
            let first = (of_path(self.job) * threads) as u32;
            launch!(
                &self.client,
                points,
                count_searches(paths(), loss(), &self.records, points as u32)
            );
            launch!(
                &self.client,
                blocks_of(points) * GROUP as usize,
                add_before(&self.records, first, points as u32)
            );
            // Each kernel is small, and threads of a warp do similar work.
            let emitters = self.job.views.features.emitters;
            for of_light in [true, false]
                .into_iter()
                .filter(|&of_light| emitters || !of_light)
            {
                let adding = self.adding(to);
                launch!(
                    &self.client,
                    points,
                    add_jumps(
                        paths(),
                        loss(),
                        &self.records,
                        adding,
                        points as u32,
                        of_light
                    )
                );
            }
        }
        launch!(
            &self.client,
            threads,
            go_back(paths(), loss(), &self.records, self.adding(to))
        );
    }

    /// Reads back the numbers of searches for edges of points, if statistics are requested.
    fn count_searches(&self, piece: Piece) {
        let job = self.job;
        if !(job.statistics && job.views.derivatives.jumps) {
            return;
        }
        let threads = piece.threads() as usize;
        let (records, points) = (of_path(job) * threads, threads * points(job));
        let past = records + words_of_order(points);
        let handle = self.records.handle.clone().offset_start(4 * records as u64);
        let handle = handle.offset_end(4 * (self.records.length - past) as u64);
        // A lost device is reported where the gradient is checked.
        if let Ok(bytes) = self.client.read_one(handle) {
            let searches = in_order(u32::from_bytes(&bytes), points);
            searches.iter().for_each(|n| device::count_searches(n));
        }
    }

    /// Adds film samples: `threads` samples of all views from `first` on, or `spread` samples of each view if that is
    /// not 0.
    fn add_film(&self, samples: [usize; 3], to: &List) {
        let job = self.job;
        let [first, threads, spread] = samples.map(|n| n as u32);
        let (views, of_view) = (job.views.views as u32, job.of_view as u32);
        let count = self.films.count;
        launch!(
            &self.client,
            threads as usize,
            film_jumps(
                job.views(&self.client, &self.scene, job.views.features),
                FilmSamplesLaunch::new(first, threads, spread, views, of_view, count),
                &self.pieces,
                &self.table,
                self.loss(1.0),
                self.adding(to),
                job.pixels.is_some()
            )
        );
    }
}

/// Returns the maximum number of points of a path.
fn points(job: &Job) -> usize {
    job.views.buffers.header()[BOUNCES] as usize + 1
}

/// Returns the number of words of a path's records.
fn of_path(job: &Job) -> usize {
    let jumped = JUMPED * u32::from(job.views.derivatives.jumps);
    (RECORD + jumped) as usize * points(job) + 1
}
