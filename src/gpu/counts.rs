//! The rays of an image, counted on request: its paths are traced once more, so that an image costs nothing more where
//! nobody asks.

use burn::backend::tensor::{FloatTensor, IntTensor};
use burn::backend::wgpu::CubeBackend;
use burn::backend::{Backend, Dispatch, backend_extension};
use burn::cubecl::{self, prelude::*};
use burn::tensor::{DType, Device, Int, Tensor};

use super::Features;
use super::camera::begin;
use super::integers::total;
use super::launch::{GROUP, Job, PATHS};
use super::layout::BOUNCES;
use super::list::List;
use super::path::{from_camera, path_light};
use super::records::Room;
use crate::error::{Error, Result};
use crate::kernel::RayCounts;

/// Adds to a count, which has 64 bits in two words.
#[cube]
fn count(counts: &[Atomic<u32>], at: u32, more: u32) {
    let i = 2 * at as usize;
    let before = counts[i].fetch_add(more);
    if total(before, more) < more {
        counts[i + 1].fetch_add(1u32);
    }
}

/// Counts the rays of some samples of pixels, and how many of their paths looked for a next surface once, twice and so
/// on.
#[cube(launch)]
fn count_rays(
    floats: &[f32],
    words: &[u32],
    pixels: &[u32],
    counts: &[Atomic<u32>],
    first: u32,
    of_pixels: u32,
    from: u32,
    past: u32,
    #[comptime] listed: bool,
    #[comptime] features: Features,
) {
    if ABSOLUTE_POS < of_pixels as usize {
        let i = first + ABSOLUTE_POS as u32;
        let mut pixel = i;
        if listed {
            pixel = pixels[i as usize];
        }
        let mut room = Array::<u32>::new(features.stack);
        let stack = room.as_mut_slice();
        let mut rays = 0u32;
        let mut sample = from;
        while sample < past {
            let path = begin(floats, words, pixel, sample, features);
            // Nothing is kept.
            let mut records = Array::<u32>::new(1usize);
            let room = Room {
                thread: 0u32,
                threads: 1u32,
            };
            let none = records.as_mut_slice();
            let seen = path_light(
                floats,
                words,
                stack,
                none,
                room,
                path,
                from_camera(),
                false,
                false,
                features,
            );
            rays += seen.rays;
            count(counts, seen.looked, 1u32);
            sample += 1;
        }
        count(counts, 0u32, rays);
    }
}

#[backend_extension(Cube)]
pub(crate) trait CountBackend: Backend {
    /// The number of rays, and of paths that looked for their next surface once, twice and so on, each in two words,
    /// on the device of a tensor.
    fn count(like: FloatTensor<Self>, job: Job) -> IntTensor<Self>;
}

impl CountBackend for CubeBackend {
    fn count(like: FloatTensor<Self>, job: Job) -> IntTensor<Self> {
        let client = like.client.clone();
        let [floats, words, pixels] = job.lists(&client);
        let length = 2 * (job.view.words[BOUNCES] as usize + 2);
        let counts = List::new(&client, &vec![0u32; length]);
        for [first, count, from, past] in job.pieces(PATHS) {
            count_rays::launch(
                &client,
                CubeCount::Static(count.div_ceil(GROUP), 1, 1),
                CubeDim::new_1d(GROUP),
                floats.argument(),
                words.argument(),
                pixels.argument(),
                counts.argument(),
                first,
                count,
                from,
                past,
                job.pixels.is_some(),
                job.view.features,
            );
        }
        counts.into_tensor(like, vec![length], DType::I32)
    }
}

/// The counts of a view's image, read back from a device.
///
/// # Errors
/// If they can't be read.
pub(crate) fn counts_of(device: &Device, job: &Job) -> Result<RayCounts> {
    let like = Tensor::<1>::zeros([1], (device, DType::F32));
    let counts = <Dispatch as CountBackend>::count(like.into_dispatch(), job.clone());
    let data = Tensor::<1, Int>::from_dispatch(counts).try_into_data();
    let words: Vec<i32> = data.map_err(Error::read)?.iter().collect();
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
    Ok(RayCounts { rays, bounces })
}
