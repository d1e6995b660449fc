//! The rays of an image, counted on request: its paths are traced once more, so that an image costs nothing more where
//! nobody asks.

use burn::backend::tensor::{FloatTensor, IntTensor};
use burn::backend::{Backend, Cube, Dispatch, backend_extension};
use burn::tensor::{DType, Device, Int, Tensor};

use crate::cube::*;

use super::device::{floats, int_zeros, launch};
use super::hit::Memory;
use super::job::{Job, PATHS, Paths};
use super::path::light_of_pixel;
use crate::device::count_read_back;
use crate::error::{Error, Result};
use crate::kernel::RayCounts;
use crate::model::integers::total;
use crate::trace::BOUNCES;

/// Adds to a count, which has 64 bits in two words.
#[cube]
fn count(counts: &[Atomic<u32>], at: u32, more: u32) {
    let i = 2 * at as usize;
    let before = counts[i].fetch_add(more);
    if total(before, more) < more {
        counts[i + 1].fetch_add(1u32);
    }
}

/// Counts the rays of a piece, and how many of its paths looked for a next surface once, twice and so on: `of_view`
/// counts for each view.
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
    /// The number of rays, and of paths that looked for their next surface once, twice and so on, each in two words,
    /// on the device of a tensor.
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
                count_rays(job.paths(&lists, piece), &counts, of_view)
            );
        }
        tensor
    }
}

/// The counts of each view's image, read back from a device.
///
/// # Errors
/// If they can't be read.
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

/// From pairs of words: rays, then paths that looked for their next surface so many times.
fn counts_from(words: &[i32]) -> RayCounts {
    let whole = |pair: &[i32]| u64::from(pair[0] as u32) | (u64::from(pair[1] as u32) << 32);
    let mut counts = words.chunks_exact(2).map(whole);
    let rays = counts.next().unwrap_or(0);
    // Who looked three times looked a first and a second time too.
    let mut bounces: Vec<u64> = counts.collect();
    let mut so_far = 0;
    for count in bounces.iter_mut().rev() {
        so_far += *count;
        *count = so_far;
    }
    bounces.retain(|&count| count > 0);
    RayCounts { rays, bounces }
}
