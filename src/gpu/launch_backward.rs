//! The backward pass on burn's devices: derivatives are measured, then added up, without the host in between.

use std::sync::Arc;

use burn::backend::Cube;
use burn::backend::tensor::FloatTensor;
use burn::cubecl::prelude::*;

use super::device::floats;
use super::film::film_jumps;
use super::job::{GROUP, Job, PATHS, Samples, groups};
use super::list::List;
use super::passes::{add_jumps, go_back, keep_paths};
use super::records::{JUMPED, RECORD};
use super::sums::{FIRST_SUM, MEASURE, PARTS, add_replicas, choose_scales, clear};
use crate::kernel::FilmEdges;

/// Edges on the films of views.
#[derive(Clone, Default)]
pub(crate) struct Films {
    /// Pieces of edges ([`FilmEdges::flat`]), one view after another.
    pieces: Vec<f32>,
    /// What [`film_jumps`] calls `films`.
    table: Vec<u32>,
    /// Samples of all views.
    samples: u32,
    listed: bool,
}

impl Films {
    /// From the radius of each view's pixel filter, the edges on its film and the number of their samples, if jumps
    /// are added there; and the row of each pixel, if there is a list.
    pub fn new<'a>(
        views: impl ExactSizeIterator<Item = Option<(f32, &'a FilmEdges, u32)>>,
        places: Option<Vec<u32>>,
    ) -> Self {
        let mut films = Self {
            listed: places.is_some(),
            ..Self::default()
        };
        // So many that their numbers have room.
        let most = u32::MAX / 2 / views.len().max(1) as u32;
        for film in views {
            let Some((radius, edges, samples)) = film.filter(|f| !f.1.is_empty()) else {
                films.table.extend([films.samples, 0, 0, 0, 0, 0]);
                continue;
            };
            let (pieces, total) = edges.flat();
            let samples = samples.min(most);
            films.samples += samples;
            let first = (films.pieces.len() / 4) as u32;
            let past = first + (pieces.len() / 4) as u32;
            films.pieces.extend(pieces);
            let bits = [total.to_bits(), radius.to_bits()];
            films.table.extend([films.samples, samples, first, past]);
            films.table.extend(bits);
        }
        films.table.extend(places.unwrap_or_default());
        films
    }
}

/// What a backward pass adds up, and how.
#[derive(Clone)]
pub(crate) struct Sought {
    films: Arc<Films>,
    /// How much the loss depends on the radiance of a pixel of each view, on average.
    typical: Vec<f32>,
    /// Looks at all derivatives for their sizes, not at some.
    pub measures_all: bool,
}

impl Sought {
    /// Jumps on the films, and of each view [`View::typical`].
    pub fn new(films: Films, typical: Vec<f32>) -> Self {
        Self {
            films: Arc::new(films),
            typical,
            measures_all: false,
        }
    }
}

/// Words of a launch's records at most.
const RECORDS: usize = 1 << 24;
/// Pixels, and samples of films, that are looked at for the sizes of derivatives, at least.
const MEASURED: usize = 4096;

/// The launches of a backward pass.
pub(super) struct Pass<'a> {
    client: Client,
    job: &'a Job,
    sought: &'a Sought,
    scene: [List; 3],
    gradient: List,
    records: List,
    films: [List; 2],
    scales: List,
    /// Paths of a launch.
    at_once: usize,
    replicas: u32,
}

impl<'a> Pass<'a> {
    pub fn new(upstream: FloatTensor<Cube>, job: &'a Job, sought: &'a Sought) -> Self {
        let (client, gradient) = floats(upstream);
        let of_path = of_path(job);
        let at_once = (RECORDS / of_path).clamp(1, job.count() * job.samples as usize);
        let films = &sought.films;
        let mut scales = vec![MEASURE; PARTS];
        scales.extend(&sought.typical);
        Self {
            scene: job.lists(&client),
            gradient,
            records: List::room(&client, of_path * at_once),
            films: [
                List::new(
                    &client,
                    if films.pieces.is_empty() {
                        &[0.0]
                    } else {
                        &films.pieces
                    },
                ),
                List::new(&client, &films.table),
            ],
            scales: List::new(&client, &scales),
            at_once,
            replicas: job.views.sums.replicas() as u32,
            client,
            job,
            sought,
        }
    }

    /// Measures derivatives, then adds them up to sums.
    pub fn run(self, sums: &List) {
        let numbers = self.job.views.sums.count;
        let all = self.sought.measures_all;
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
        let all_pieces = self.job.pieces(self.at_once);
        let measured = if all { all_pieces.clone() } else { vec![some] };
        let samples = self.sought.films.samples as usize;
        let film_stride = if all { 1 } else { (samples / MEASURED).max(1) };
        let sizes = self.totals(0);
        self.add(&measured, film_stride, &sizes);
        choose_scales::launch(
            &self.client,
            groups(PARTS),
            CubeDim::new_1d(GROUP),
            sizes.argument(),
            self.scales.argument(),
            self.replicas,
            FIRST_SUM as u32,
            if all { 30 } else { 40 },
        );
        let totals = self.totals(numbers);
        self.add(&all_pieces, 1, &totals);
        add_replicas::launch(
            &self.client,
            groups(numbers.max(FIRST_SUM)),
            CubeDim::new_1d(GROUP),
            totals.argument(),
            self.scales.argument(),
            sums.argument(),
            self.replicas,
            region(numbers),
            numbers as u32,
        );
    }

    /// Room for sums, all 0.
    fn totals(&self, numbers: usize) -> List {
        let length = self.replicas as usize * region(numbers) as usize;
        let totals = List::room(&self.client, length);
        clear::launch(
            &self.client,
            groups(length),
            CubeDim::new_1d(GROUP),
            totals.argument(),
        );
        totals
    }

    /// Adds all derivatives of some samples.
    fn add(&self, pieces: &[Samples], film_stride: usize, totals: &List) {
        let region = (totals.length / self.replicas as usize) as u32;
        for piece in pieces {
            self.add_paths(piece, totals, region);
        }
        let samples = self.sought.films.samples as usize;
        for first in (0..samples).step_by(PATHS * film_stride) {
            let left = (samples - first).div_ceil(film_stride);
            self.add_film(first, film_stride, left.min(PATHS), totals, region);
        }
    }

    fn add_paths(&self, piece: &Samples, totals: &List, region: u32) {
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
            self.gradient.argument(),
            self.records.argument(),
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
                self.gradient.argument(),
                self.records.argument(),
                totals.argument(),
                self.scales.argument(),
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
            self.gradient.argument(),
            self.records.argument(),
            totals.argument(),
            self.scales.argument(),
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

    fn add_film(&self, first: usize, stride: usize, count: usize, totals: &List, region: u32) {
        let [floats, words, _] = &self.scene;
        let [pieces, films] = &self.films;
        let job = self.job;
        film_jumps::launch(
            &self.client,
            groups(count),
            CubeDim::new_1d(GROUP),
            floats.argument(),
            words.argument(),
            pieces.argument(),
            films.argument(),
            self.gradient.argument(),
            totals.argument(),
            self.scales.argument(),
            self.replicas,
            region,
            first as u32,
            stride as u32,
            count as u32,
            job.views.views as u32,
            job.of_view as u32,
            self.sought.films.listed,
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
