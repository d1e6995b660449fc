//! Counts the rays of an image on request. The paths are traced once more, so an image without counts costs nothing
//! extra.

use burn::backend::tensor::{FloatTensor, IntTensor};
use burn::backend::{Backend, Cube, Dispatch, backend_extension};
use burn::tensor::{DType, Device, Int, Tensor};

use softray_kernels::cube::*;

use super::device::{floats, int_zeros, launch};
use super::hit::Memory;
use super::job::{Job, PATHS, Paths};
use super::path::light_of_pixel;
use crate::device::count_read_back;
use crate::error::{Error, Result};
use softray_kernels::kernel::RayCounts;
use softray_kernels::model::integers::total;
use softray_kernels::trace::BOUNCES;

/// Adds to a 64-bit count, which is stored in two words.
#[cube]
fn count(counts: &[Atomic<u32>], at: u32, more: u32) {
    let i = 2 * at as usize;
    let before = counts[i].fetch_add(more);
    if total(before, more) < more {
        counts[i + 1].fetch_add(1u32);
    }
}

/// Counts the rays of a piece, and its paths by how many rays they traced to a next surface. Each view has `of_view`
/// counts.
#[cube(launch)]
fn count_rays(paths: Paths, counts: &[Atomic<u32>], of_view: u32) {
    if ABSOLUTE_POS < paths.piece.threads() as usize {
        let which = paths.of_thread(ABSOLUTE_POS as u32);
        let scene = paths.views.scene(which.view);
        let mut memory = Memory::new(&scene);
        let light = light_of_pixel(&scene, &mut memory, which.pixel, which.sample);
        let first = which.view * of_view;
        count(counts, first, light.rays);
        count(counts, first + light.looked, 1u32);
    }
}

#[backend_extension(Cube)]
pub(crate) trait CountBackend: Backend {
    /// Returns the number of rays, and the numbers of paths that traced one, two, … rays to a next surface. Each
    /// count has two words, and they are on the device of `like`.
    fn count(like: FloatTensor<Self>, job: Job) -> IntTensor<Self>;
}

impl CountBackend for Cube {
    fn count(like: FloatTensor<Self>, job: Job) -> IntTensor<Self> {
        let of_view = job.views.buffers.header()[BOUNCES] + 2;
        let length = 2 * job.views.views * of_view as usize;
        let (tensor, counts) = int_zeros(&like, length);
        let (client, _) = floats(like);
        let lists = job.lists(&client);
        for piece in job.pieces(PATHS) {
            launch!(
                &client,
                piece.threads() as usize,
                count_rays(job.paths(&client, &lists, piece), &counts, of_view)
            );
        }
        tensor
    }
}

/// Returns the counts of each view's image, read back from a device.
///
/// # Errors
/// Returns an error if the counts cannot be read back.
pub(crate) fn counts_of(device: &Device, job: &Job) -> Result<Vec<RayCounts>> {
    let like = Tensor::<1>::zeros([1], (device, DType::F32));
    let counts = <Dispatch as CountBackend>::count(like.into_dispatch(), job.clone());
    let counts = Tensor::<1, Int>::from_dispatch(counts);
    count_read_back(device, counts.shape().num_elements());
    let data = counts.try_into_data();
    let words: Vec<i32> = data.map_err(Error::read)?.iter().collect();
    let of_view = words.chunks_exact(words.len() / job.views.views);
    Ok(of_view.map(counts_from).collect())
}

/// Converts pairs of words: the number of rays, then the numbers of paths by how many rays they traced to a next
/// surface.
fn counts_from(words: &[i32]) -> RayCounts {
    let whole = |pair: &[i32]| u64::from(pair[0] as u32) | (u64::from(pair[1] as u32) << 32);
    let mut counts = words.chunks_exact(2).map(whole);
    let rays = counts.next().unwrap_or(0);
    // A path with three rays to a next surface also counts for the first and the second.
    let mut bounces: Vec<u64> = counts.collect();
    let mut so_far = 0;
    for count in bounces.iter_mut().rev() {
        so_far += *count;
        *count = so_far;
    }
    bounces.retain(|&count| count > 0);
    RayCounts { rays, bounces }
}
