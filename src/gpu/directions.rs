//! Forward mode: the derivatives of a view's pixels along directions, by the kernels of the backward pass.

use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Cube, Dispatch, backend_extension};
use burn::tensor::{DType, Device, Shape, Tensor};

use softray_kernels::cube::*;

use super::device::{floats, launch, without_backtrace, zeros};
use super::film::Films;
use super::form::Form;
use super::job::Job;
use super::launch_backward::{Pass, films_of};
use super::placed::ViewPlaces;
use super::sums::Replicas;
use crate::device::label;
use crate::error::{Error, Result};
use softray_kernels::trace::SumTangents;

/// Writes the derivatives `[K, P, C]` of pixels from their sums, one thread per derivative.
#[cube(launch)]
fn write_derivatives(
    sums: &mut [u32],
    replicas: Replicas,
    scales: &[f32],
    derivatives: &mut [f32],
    parts: u32,
    directions: u32,
    pixels: u32,
) {
    if ABSOLUTE_POS < derivatives.len() {
        let channels = parts / directions;
        let row = ABSOLUTE_POS as u32 / channels;
        let part = ABSOLUTE_POS as u32 % channels * directions + row / pixels;
        let at = part * pixels + row % pixels;
        derivatives[ABSOLUTE_POS] = replicas.number(sums, scales, at, part);
    }
}

/// The edges on a view's film, and the tangents `[S, K]` of its sums along K directions.
pub(crate) struct Along {
    films: Films,
    tangents: Vec<f32>,
    directions: usize,
}

#[backend_extension(Cube)]
pub(crate) trait DirectionsBackend: Backend {
    /// Returns the derivatives `[K, P, C]` of the pixels of a job's only view, on the device of `like`. If they cannot be
    /// computed, `failed` is set to the reason.
    fn derivatives(
        like: FloatTensor<Self>,
        job: Job,
        along: Along,
        failed: &mut Option<String>,
    ) -> FloatTensor<Self>;
}

impl DirectionsBackend for Cube {
    fn derivatives(
        like: FloatTensor<Self>,
        job: Job,
        along: Along,
        failed: &mut Option<String>,
    ) -> FloatTensor<Self> {
        let form = Form::new(&job, along.directions);
        let shape = [along.directions, form.pixels, form.parts / along.directions];
        let (tensor, derivatives) = zeros(&like, Shape::from(shape));
        let (client, _) = floats(like);
        let lists = [f32::as_bytes(&along.tangents), &[]];
        let pass = Pass::new(client, None, lists, form, &job, &along.films);
        launch!(
            &pass.client,
            derivatives.length,
            write_derivatives(
                &pass.sums,
                form.as_argument(),
                &pass.scales,
                &derivatives,
                form.parts as u32,
                form.directions as u32,
                form.pixels as u32
            )
        );
        // This check reports buffers that could not be allocated and kernels that could not be compiled.
        let checked = pass.client.check([&derivatives.handle]);
        *failed = checked.err().map(without_backtrace);
        tensor
    }
}

/// Returns the derivatives `[K, P, C]` of the pixels of a job's only view along directions. The job must have been checked
/// for their sums.
///
/// # Errors
/// Returns an error if a list is longer than the device allows, if buffers cannot be allocated or kernels cannot be
/// compiled, or if the index of an edge or of a cell of the film is too large.
pub(crate) fn derivatives_of(
    device: &Device,
    job: &Job,
    view: ViewPlaces,
    tangents: &SumTangents,
) -> Result<Tensor<3>> {
    let fail = |why: String| Error::device(label(device), why);
    let lists = [("the list of tangents", tangents.values.len())];
    let films = films_of(device, &[view], job, &lists);
    let along = Along {
        films: films.map_err(|why| fail(format!("{why}, or fewer directions at once")))?,
        tangents: tangents.values.iter().map(|&t| t as f32).collect(),
        directions: tangents.directions,
    };
    let like = Tensor::<1>::zeros([1], (device, DType::F32));
    let (like, mut failed) = (like.into_dispatch(), None);
    let all = <Dispatch as DirectionsBackend>::derivatives(like, job.clone(), along, &mut failed);
    match failed {
        None => Ok(Tensor::from_dispatch(all)),
        Some(why) => {
            job.views.buffers.forget();
            Err(fail(why))
        }
    }
}
