//! The backward pass on burn's devices: derivatives are measured, then summed and converted into gradients. Nothing
//! is read back in between, except for statistics, and it waits for the device once, where launches are timed. Forward
//! mode makes the same pass ([`super::directions`]).

use burn::backend::Cube;
use burn::backend::tensor::FloatTensor;
use burn::cubecl::prelude::*;
use burn::tensor::{Device, Shape};

use super::device::{GROUP, List, floats, has_room, launch, rows_of, without_backtrace, zeros};
use super::film::{FilmSamplesLaunch, Films, WHOLE, film_jumps};
use super::form::Form;
use super::gradient::{Table, write_gradient};
use super::job::{Job, Outputs, Piece, joined};
use super::loss::LossLaunch;
use super::pace::Pace;
use super::passes::{add_jumps, go_back, keep_paths};
use super::placed::ViewPlaces;
use super::records::{JUMPED, OF_PATH, RECORD};
use super::searches::{add_before, blocks_of, in_order, words_of_order};
use super::sums::{AddingLaunch, MORE, OF_THREAD, add_replicas, bits_of_each, choose_scales};
use crate::device::{self, label};
use softray_kernels::model::film::CELL;
use softray_kernels::trace::{BOUNCES, Features};

/// Approximate minimum number of pixels, and of film samples, in the measurement of derivatives.
const MEASURED: usize = 1024;

/// Returns the gradient `[N]` of all tensors, from the gradient of the rows of all views `[B·P, C]`. Each group of
/// views has its own job.
///
/// # Panics
/// Panics if buffers cannot be allocated, if kernels cannot be compiled, if the device has no room for the edges on
/// films or the table of pixels, or if an image has [`WHOLE`] cells.
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
        let films = films_of(device, &views, job, &[]);
        let films =
            films.unwrap_or_else(|why| fail(format!("{why}, or several batches of fewer views")));
        let table = Table::new(&job.views.sums, &views);
        if table.threads > 0 {
            let (client, rows) = floats(rows_of(upstream, group, job.of_view));
            let form = Form::new(job, 0);
            let lists = [u32::as_bytes(&table.words), f32::as_bytes(&table.factors)];
            let pass = Pass::new(client, Some(rows), lists, form, job, &films);
            pass.write_gradient(table.threads, &list);
        }
    }
    // This check reports buffers that could not be allocated and kernels that could not be compiled.
    let (client, _) = floats(gradient.clone());
    if let Err(why) = client.check([&list.handle]) {
        fail(without_backtrace(why));
    }
    gradient
}

/// Returns the films of a job's views. Otherwise returns a message about what the device lacks for the edges on them or
/// for `more` lists.
pub(super) fn films_of(
    device: &Device,
    views: &[ViewPlaces],
    job: &Job,
    more: &[(&str, usize)],
) -> Result<Films, String> {
    let films = Films::new(views, job);
    let lists = [
        ("the list of edges on films", films.of_pieces()),
        ("the table of pixels", films.table.len()),
    ];
    has_room(device, &[&lists, more].concat())?;
    let of_image = |v: &ViewPlaces| {
        let [columns, rows] = [v.0.settings.width, v.0.settings.height].map(|n| n.div_ceil(CELL));
        u64::from(columns) * u64::from(rows)
    };
    match views.iter().any(|v| of_image(v) >= u64::from(WHOLE)) {
        true => Err(format!("{WHOLE} or more cells of 8 × 8 pixels")),
        false => Ok(films),
    }
}

/// The launches of a backward pass for one job.
pub(super) struct Pass<'a> {
    pub client: Client,
    pub job: &'a Job,
    pub films: &'a Films,
    pub scene: [List; 3],
    /// The upstream gradient, or in forward mode the tangents.
    numbers: List,
    records: List,
    pub pieces: List,
    pub table: List,
    pub scales: List,
    pub form: Form,
    /// The largest derivatives of parts, and space for all sums.
    sizes: List,
    pub sums: List,
    /// The lists that were sent along.
    lists: [List; 2],
    pace: Pace,
    /// Number of bits of each scaled derivative.
    bits: i32,
}

impl<'a> Pass<'a> {
    /// Makes all sums of a job. `upstream` has the derivatives of the loss with respect to the rows of its views. In
    /// forward mode there is none, and the first of the `lists` has the tangents. All lists are sent in one transfer.
    pub fn new(
        client: Client,
        upstream: Option<List>,
        lists: [&[u8]; 2],
        form: Form,
        job: &'a Job,
        films: &'a Films,
    ) -> Self {
        let of_path = of_path(job, form);
        let pace = Pace::new(&client, job, form, of_path);
        // Scales must not depend on time, so that gradients repeat.
        let most = pace.most().min(job.count() * job.samples as usize);
        let bits = bits_of_each(most_derivatives(job, form, films, most) as u64);
        let [table, scales, sizes, first, second] = List::send(
            &client,
            [
                u32::as_bytes(&films.table),
                f32::as_bytes(&form.scales(bits, job.views.views)),
                u32::as_bytes(&vec![0; form.parts]),
                lists[0],
                lists[1],
            ],
        );
        let measured = measured(job, &pace).count as usize;
        let mut pass = Self {
            scene: job.lists(&client),
            numbers: upstream.unwrap_or_else(|| first.clone()),
            records: records_of(&client, job, form, most.min(pace.paths()).max(measured)),
            pieces: List::room(&client, films.of_pieces()),
            table,
            scales,
            form,
            sizes,
            sums: List::room(&client, form.words()),
            lists: [first, second],
            pace,
            bits,
            client,
            job,
            films,
        };
        pass.look_at_pixels();
        pass.measure();
        pass.add_all();
        pass
    }

    /// Sums all derivatives.
    fn add_all(&mut self) {
        let samples = self.films.samples as usize;
        let mut pieces = self.job.pieces(self.pace.paths());
        if pieces.len() > 1 && self.pace.is_unknown() {
            // The middle of an image has more to see than its top.
            let timed = pieces.remove(pieces.len() / 2);
            let paths = timed.threads() as usize;
            let add = || self.add_paths(timed, &self.sums);
            self.pace = self.pace.measured(&self.client, paths, add);
            self.count_searches(timed);
            self.fold();
            pieces = joined(pieces, self.pace.paths());
            let most = pieces.iter().map(Piece::threads).max().unwrap_or(0) as usize;
            if most > paths {
                self.records = records_of(&self.client, self.job, self.form, most);
            }
        }
        let mut pieces = pieces.into_iter().peekable();
        while let Some(piece) = pieces.next() {
            self.add_paths(piece, &self.sums);
            self.count_searches(piece);
            if pieces.peek().is_some() {
                self.fold();
            }
        }
        // The last piece and the first film samples add to the same replicas. Those of the last launch are added where sums
        // become numbers.
        let at_once = self.pace.samples();
        for first in (0..samples).step_by(at_once) {
            if first > 0 {
                self.fold();
            }
            self.add_film([first, (samples - first).min(at_once), 0], &self.sums);
        }
    }

    /// Adds the gradients of tensors, made from sums by the table that was sent along, to `gradient`.
    fn write_gradient(&self, threads: usize, gradient: &List) {
        let (client, [words, factors]) = (&self.client, &self.lists);
        launch!(
            client,
            threads,
            write_gradient(
                self.job.views(client, &self.scene, Features::default()),
                &self.sums,
                self.form.as_argument(),
                &self.scales,
                words,
                factors,
                gradient,
                threads as u32
            )
        );
    }

    /// Chooses scales from the sizes of the derivatives of some paths and film samples.
    fn measure(&self) {
        let some = measured(self.job, &self.pace);
        self.add_paths(some, &self.sizes);
        let views = self.job.views.views;
        let spread = (MEASURED / views).max(64);
        if self.films.samples > 0 {
            self.add_film([0, spread * views, spread], &self.sizes);
        }
        launch!(
            &self.client,
            self.sums.length.div_ceil(OF_THREAD).max(self.form.parts),
            choose_scales(
                &self.sizes,
                &self.scales,
                self.form.parts as u32,
                self.bits - MORE,
                &self.sums
            )
        );
    }

    /// Adds the replicas of a launch to the sums of all launches.
    fn fold(&self) {
        let form = self.form;
        launch!(
            &self.client,
            form.count,
            add_replicas(&self.sums, form.as_argument())
        );
    }

    /// Returns the derivatives of the loss, times a factor, and the scales of sums as a kernel argument.
    pub fn loss(&self, scale: f32) -> LossLaunch {
        LossLaunch::new(
            self.numbers.argument(),
            self.scales.argument(),
            self.form.parts as u32,
            scale,
            self.job.outputs,
            self.form.is_forward(),
        )
    }

    fn adding(&self, to: &List) -> AddingLaunch {
        let of = self.job.views.derivatives;
        self.form.adding(&self.client, to, of)
    }

    fn add_paths(&self, piece: Piece, to: &List) {
        let threads = piece.threads() as usize;
        let paths = || self.job.paths(&self.client, &self.scene, piece);
        let loss = || self.loss(1.0 / self.job.samples as f32);
        let jumps = self.job.views.derivatives.jumps;
        launch!(
            &self.client,
            threads,
            keep_paths(paths(), loss(), &self.records, jumps)
        );
        if jumps {
            let points = points_of(self.job, threads);
            let first = (of_path(self.job, self.form) * threads) as u32;
            launch!(
                &self.client,
                blocks_of(points) * GROUP as usize,
                add_before(&self.records, first, points as u32)
            );
            // Each kernel is small, and threads of a warp do similar work.
            let emitters = self.job.views.features.emitters;
            let kinds: &[bool] = if emitters { &[true, false] } else { &[false] };
            for &of_light in kinds {
                let adding = self.adding(to);
                launch!(
                    &self.client,
                    points,
                    add_jumps(paths(), loss(), &self.records, adding, of_light)
                );
            }
        }
        let channels = self.job.outputs.channels(self.form.is_forward());
        launch!(
            &self.client,
            threads * channels as usize,
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
        let (records, points) = (of_path(job, self.form) * threads, points_of(job, threads));
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

/// Returns the paths by which scales are chosen: one of each of some pixels.
fn measured(job: &Job, pace: &Pace) -> Piece {
    let paths = job.count().saturating_mul(job.samples as usize);
    let wanted = (paths / 16).max(MEASURED).min(pace.first());
    // Odd, so that the pixels are not all in a few columns of the image.
    let stride = job.count().div_ceil(wanted).max(1) | 1;
    Piece {
        first: 0,
        stride: stride as u32,
        count: job.count().div_ceil(stride) as u32,
        from: 0,
        past: 1,
        each: 1,
    }
}

/// Returns a list for the records of so many paths, and for the order of their points.
fn records_of(client: &Client, job: &Job, form: Form, paths: usize) -> List {
    let order = words_of_order(points_of(job, paths));
    List::room(client, of_path(job, form) * paths + order)
}

/// Returns the maximum number of points of a path.
fn points(job: &Job) -> usize {
    job.views.buffers.header()[BOUNCES] as usize + 1
}

/// Returns the number of points of so many paths in the order of points.
fn points_of(job: &Job, paths: usize) -> usize {
    paths.next_multiple_of(GROUP as usize) * points(job)
}

/// Returns the number of words of a path's records.
fn of_path(job: &Job, form: Form) -> usize {
    let channels = Outputs::channels_of_radiance(form.is_forward());
    let jumped = channels * JUMPED * u32::from(job.views.derivatives.jumps);
    (RECORD + jumped) as usize * points(job) + OF_PATH as usize
}

/// Returns approximately the maximum number of derivatives that a launch adds to a sum.
fn most_derivatives(job: &Job, form: Form, films: &Films, at_once: usize) -> usize {
    let films = Pace::MOST_SAMPLES.min(films.samples as usize);
    if form.is_forward() {
        // All those of a pixel's points.
        let samples = at_once.div_ceil(job.count());
        16 * (4 * samples * points(job) + films)
    } else {
        16 * (at_once * points(job) + films)
    }
}
