//! The gradient of a batch on its device, from that of its image.

use std::ops::Range;

use burn::backend::Cube;
use burn::backend::tensor::FloatTensor;
use burn::tensor::{Device, Shape};

use super::device::{floats, has_room, rows_of, without_backtrace, zeros};
use super::film_table::{Films, OF_PIECE, WHOLE};
use super::gradient::ViewPlaces;
use super::job::Job;
use super::launch_backward::Pass;
use crate::device::label;
use crate::model::film::samples_of_film;

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
