//! Kernels on GPUs: whole paths, one thread a pixel, in the language of CubeCL. The stages of a path are those of
//! `trace`, which the host runs too; what is here calls them, traces rays and keeps records.

#![allow(unused_assignments)] // Variables of a kernel need a first value.
#![allow(clippy::too_many_arguments)] // Kernels have no globals.
#![allow(
    clippy::collapsible_if,
    clippy::collapsible_else_if,
    clippy::manual_clamp,
    clippy::implicit_saturating_sub,
    clippy::assign_op_pattern,
    reason = "the language of kernels has no other form, or conditions of compilation are nested so"
)]
#![allow(
    clippy::too_many_lines,
    reason = "calls are inlined, so a loop has one place for each"
)]

mod backward;
mod batch;
mod camera;
mod counts;
mod device;
mod emitters_along;
mod film;
mod film_table;
mod gradient;
mod hit;
mod job;
mod jumps;
mod launch;
mod launch_backward;
mod launch_pixels;
mod list;
mod of_scene;
mod packed;
mod passes;
mod path;
mod pieces;
mod pixel_gradients;
mod places;
mod records;
mod side_light;
mod sum_places;
mod sums;

use burn::cubecl::{self, prelude::*};

use crate::trace::{Features, NONE, Scene, UNIT};
pub(crate) use batch::gradient_of;
use camera::begin;
pub(crate) use counts::counts_of;
pub(crate) use device::check;
pub(crate) use job::Job;
pub(crate) use launch::trace;
pub(crate) use packed::{Packed, pack};
use path::path_light;
use pieces::{Piece, pixel_at};
use places::from_camera;
use records::Room;

/// The rows of an image that are asked for beside radiance.
#[derive(Clone, Copy, Debug, Hash, PartialEq, Eq)]
pub(crate) struct Outputs {
    pub opacity: bool,
    pub depth: bool,
    pub normals: bool,
    /// Rows of shares of objects, the background's with them; 0 if they are not asked for.
    pub objects: usize,
}

impl Outputs {
    fn rows(self) -> usize {
        3 + usize::from(self.opacity)
            + usize::from(self.depth)
            + if self.normals { 3 } else { 0 }
            + self.objects
    }
}

/// Adds the means over some samples of pixels to rows, from a first row on; or sets rows to them, where they are
/// `fresh`. Threads of a pixel have `each` of its samples, in rows of their own.
#[cube(launch)]
fn render_pixels(
    floats: &[f32],
    words: &[u32],
    pixels: &[u32],
    image: &mut [f32],
    piece: Piece,
    row: u32,
    each: u32,
    fresh: u32,
    scale: f32,
    #[comptime] listed: bool,
    #[comptime] outputs: Outputs,
    #[comptime] features: Features,
) {
    let chunks = (piece.past - piece.from).div_ceil(each);
    if ABSOLUTE_POS < (piece.count * chunks) as usize {
        let thread = ABSOLUTE_POS as u32;
        let which = pixel_at(pixels, piece, thread % piece.count, listed);
        let scene = Scene::of_view(floats, words, which.view, features);
        let mut room = Array::<u32>::new(scene.features.stack);
        let stack = room.as_mut_slice();
        let rows = comptime!(outputs.rows());
        let own = (row + thread) as usize * rows;
        if fresh == 1 {
            let mut k = 0usize;
            while k < rows {
                image[own + k] = 0.0;
                k += 1;
            }
        }
        let mut sample = piece.from + thread / piece.count * each;
        let past = (sample + each).min(piece.past);
        while sample < past {
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
            image[own] += seen.radiance.x * scale;
            image[own + 1] += seen.radiance.y * scale;
            image[own + 2] += seen.radiance.z * scale;
            let mut at = own + 3;
            if comptime!(outputs.opacity) {
                image[at] += seen.opacity * scale;
                at += 1;
            }
            if comptime!(outputs.depth) {
                image[at] += seen.depth * scale * scene.settings[UNIT];
                at += 1;
            }
            if comptime!(outputs.normals) {
                image[at] += seen.normal.x * scale;
                image[at + 1] += seen.normal.y * scale;
                image[at + 2] += seen.normal.z * scale;
                at += 3;
            }
            if comptime!(outputs.objects > 0) {
                let mut object = comptime!(outputs.objects as u32 - 1).runtime();
                if seen.object != NONE {
                    object = scene.counted[seen.object as usize];
                }
                image[at + object as usize] += scale;
            }
            sample += 1;
        }
    }
}

/// Adds rows of chunks of samples to those of an image, in order, or sets these to them.
#[cube(launch)]
fn add_chunks(
    partial: &[f32],
    image: &mut [f32],
    first: u32,
    length: u32,
    chunks: u32,
    fresh: u32,
) {
    if ABSOLUTE_POS < length as usize {
        let thread = ABSOLUTE_POS as u32;
        let own = (first + thread) as usize;
        let mut sum = 0.0f32;
        if fresh == 0 {
            sum = image[own];
        }
        let mut chunk = 0u32;
        while chunk < chunks {
            sum += partial[(chunk * length + thread) as usize];
            chunk += 1;
        }
        image[own] = sum;
    }
}
