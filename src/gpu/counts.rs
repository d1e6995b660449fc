//! The rays of an image, counted on request: its paths are traced once more, so that an image costs nothing more where
//! nobody asks.

use burn::backend::tensor::{FloatTensor, IntTensor};
use burn::backend::{Backend, Cube, Dispatch, backend_extension};
use burn::cubecl::{self, prelude::*};
use burn::tensor::{DType, Device, Int, Tensor};

use super::camera::begin;
use super::device::{floats, int_zeros};
use super::job::{GROUP, Job, PATHS, groups};
use super::path::path_light;
use super::pieces::{Piece, pixel_at};
use super::places::from_camera;
use super::records::Room;
use crate::device::count_read_back;
use crate::error::{Error, Result};
use crate::kernel::RayCounts;
use crate::model::integers::total;
use crate::trace::{BOUNCES, Features, Scene};

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
fn count_rays(
    floats: &[f32],
    words: &[u32],
    pixels: &[u32],
    counts: &[Atomic<u32>],
    piece: Piece,
    of_view: u32,
    #[comptime] listed: bool,
    #[comptime] features: Features,
) {
    if ABSOLUTE_POS < piece.paths() as usize {
        let thread = ABSOLUTE_POS as u32;
        let which = pixel_at(pixels, piece, thread % piece.count, listed);
        let scene = Scene::of_view(floats, words, which.view, features);
        let mut room = Array::<u32>::new(scene.features.stack);
        let stack = room.as_mut_slice();
        let sample = piece.from + thread / piece.count;
        let path = begin(&scene, which.pixel, sample);
        // Nothing is kept.
        let mut records = Array::<u32>::new(1usize);
        let room = Room {
            thread: 0u32,
            threads: 1u32,
        };
        let mut choice_room = Array::<u32>::new(scene.features.of_emitters.room);
        let choice = choice_room.as_mut_slice();
        let none = records.as_mut_slice();
        let seen = path_light(
            &scene,
            stack,
            choice,
            none,
            room,
            path,
            from_camera(),
            false,
            false,
        );
        let first = which.view * of_view;
        count(counts, first, seen.rays);
        count(counts, first + seen.looked, 1u32);
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
        let of_view = job.views.words[BOUNCES] + 2;
        let length = 2 * job.views.views * of_view as usize;
        let (tensor, counts) = int_zeros(&like, length);
        let (client, _) = floats(like);
        let [floats, words, pixels] = job.lists(&client);
        for piece in job.pieces(PATHS) {
            count_rays::launch(
                &client,
                groups(piece.paths()),
                CubeDim::new_1d(GROUP),
                floats.argument(),
                words.argument(),
                pixels.argument(),
                counts.argument(),
                piece.argument(&job),
                of_view,
                job.pixels.is_some(),
                job.views.features,
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
    count_read_back(device);
    let data = Tensor::<1, Int>::from_dispatch(counts).try_into_data();
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
