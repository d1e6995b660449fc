//! The gradient of a batch on its device, from that of its image.

use std::ops::Range;

use burn::backend::Cube;
use burn::backend::tensor::FloatTensor;
use burn::tensor::Shape;

use super::adds_jumps;
use super::device::{rows_of, zeros};
use super::film_table::Films;
use super::gradient::TensorPlaces;
use super::job::Job;
use super::launch_backward::Pass;
use crate::kernel::{View, samples_of_film};

/// A view, and the places of its scene's and camera's tensors.
pub(crate) type ViewPlaces<'a> = (&'a View, TensorPlaces<'a>, TensorPlaces<'a>);

/// The gradient `[N]` of all tensors, from that of the rows of all views `[B·P, C]`, each group of views by a job; but
/// for jumps that kernels of GPUs don't add.
pub(crate) fn go_back(
    upstream: &FloatTensor<Cube>,
    jobs: &[(Range<usize>, Job)],
    views: &[ViewPlaces],
    numbers: usize,
) -> FloatTensor<Cube> {
    let (gradient, list) = zeros(upstream, Shape::from([numbers]));
    for (range, job) in jobs {
        let rows = range.start * job.of_view..range.end * job.of_view;
        let views = &views[range.clone()];
        let samples = samples_of_film(job.of_view, job.samples);
        let of_film = views
            .iter()
            .map(|&(view, ..)| (view, adds_jumps(view).then_some(samples)));
        let films = Films::new(of_film, job.pixels.as_deref().map(Vec::as_slice));
        Pass::new(rows_of(upstream, rows), job, &films).run(views, &list);
    }
    gradient
}
