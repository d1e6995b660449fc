//! The kernels of a backward pass: paths are traced again and leave records, then jumps are added at each of their
//! points, then each path is gone back along. In three kernels each is small, and points of a path are apart.

use burn::cubecl::{self, prelude::*};

use super::Outputs;
use super::backward::path_backward;
use super::camera::begin;
use super::jumps::jumps_seen_from;
use super::path::path_light;
use super::pieces::{Piece, pixel_at};
use super::places::from_camera;
use super::records::{Room, kept, kept_vector, record_at};
use super::records::{jumped_at, points_at, put};
use super::sums::{TYPICAL, is_skipped, replica_of, sums_at};
use crate::model::camera::CameraGradient;
use crate::model::numbers::is_nonzero;
use crate::model::{splat, v3};
use crate::trace::{
    BOUNCES, Derivatives, Features, Observer, Scene, Seen, UNIT, add_to_camera, no_point_gradient,
    point_at,
};

/// Derivatives by the rows of a pixel, of one of its samples.
#[cube]
pub(super) fn upstream_of(
    floats: &[f32],
    upstream: &[f32],
    i: u32,
    scale: f32,
    #[comptime] outputs: Outputs,
) -> Seen {
    let own = i as usize * comptime!(outputs.rows());
    let mut g = Seen {
        radiance: v3(upstream[own], upstream[own + 1], upstream[own + 2]) * scale,
        opacity: 0.0f32,
        depth: 0.0f32,
        normal: splat(0.0),
    };
    if comptime!(outputs.opacity) {
        g.opacity = upstream[own + 3] * scale;
    }
    let depth = comptime!(3 + usize::from(outputs.opacity));
    if comptime!(outputs.depth) {
        g.depth = upstream[own + depth] * scale * floats[UNIT];
    }
    if comptime!(outputs.normals) {
        let at = own + comptime!(depth + usize::from(outputs.depth));
        g.normal = v3(upstream[at], upstream[at + 1], upstream[at + 2]) * scale;
    }
    g
}

#[cube]
pub(super) fn is_asked(g: &Seen) -> bool {
    let more = g.opacity.abs() + g.depth.abs() + g.normal.abs().element_sum();
    is_nonzero(g.radiance.abs().element_sum() + more)
}

/// Traces the paths of a piece, those of the first sample before those of the next, and leaves records.
#[cube(launch)]
pub(super) fn keep_paths(
    floats: &[f32],
    words: &[u32],
    pixels: &[u32],
    upstream: &[f32],
    records: &mut [u32],
    scales: &[f32],
    piece: Piece,
    scale: f32,
    #[comptime] listed: bool,
    #[comptime] outputs: Outputs,
    #[comptime] features: Features,
) {
    let threads = piece.paths();
    if ABSOLUTE_POS < threads as usize && !is_skipped(scales) {
        let thread = ABSOLUTE_POS as u32;
        let which = pixel_at(pixels, piece, thread % piece.count, listed);
        let scene = Scene::of_view(floats, words, which.view, features);
        let g = upstream_of(scene.settings, upstream, which.row, scale, outputs);
        if is_asked(&g) {
            let mut room = Array::<u32>::new(scene.features.stack);
            let stack = room.as_mut_slice();
            let room = Room { thread, threads };
            let sample = piece.from + thread / piece.count;
            let path = begin(&scene, which.pixel, sample);
            let mut choice_room = Array::<u32>::new(scene.features.of_emitters.room);
            let choice = choice_room.as_mut_slice();
            let seen = path_light(
                &scene,
                stack,
                choice,
                records,
                room,
                path,
                from_camera(),
                false,
                true,
            );
            records[points_at(scene.bounces, room)] = seen.points;
        }
    }
}

/// Whether a point of a path moves, or the directions that it looks in turn.
#[cube]
fn moves_at(
    scene: &Scene,
    records: &mut [u32],
    room: Room,
    point: u32,
    #[comptime] of: Derivatives,
) -> bool {
    let mut moves = comptime!(of.camera).runtime();
    if comptime!(of.turns) {
        if point > 0 {
            moves = true;
        }
    }
    let mut k = 0u32;
    while k <= point && !moves {
        let triangle = records[record_at(room, k, 0u32)];
        moves = scene.is_wanted(scene.object_of(triangle));
        k += 1;
    }
    moves
}

/// Adds the derivatives by jumps at edges that points of paths see, one thread a point.
#[cube(launch)]
pub(super) fn add_jumps(
    floats: &[f32],
    words: &[u32],
    pixels: &[u32],
    upstream: &[f32],
    records: &mut [u32],
    totals: &[Atomic<u32>],
    scales: &[f32],
    replicas: u32,
    region: u32,
    piece: Piece,
    scale: f32,
    #[comptime] listed: bool,
    #[comptime] outputs: Outputs,
    #[comptime] features: Features,
    #[comptime] of: Derivatives,
) {
    let threads = piece.paths();
    if ABSOLUTE_POS < (threads * (words[BOUNCES] + 1)) as usize && !is_skipped(scales) {
        let thread = ABSOLUTE_POS as u32 % threads;
        let k = ABSOLUTE_POS as u32 / threads;
        let which = pixel_at(pixels, piece, thread % piece.count, listed);
        let scene = Scene::of_view(floats, words, which.view, features);
        let sums = sums_at(
            &scene,
            &totals[replica_of(thread, replicas, region)..],
            scales,
            of,
        );
        let typical = scales[TYPICAL + which.view as usize];
        let room = Room { thread, threads };
        let g = upstream_of(scene.settings, upstream, which.row, scale, outputs);
        let mut points = 0u32;
        if is_asked(&g) {
            points = records[points_at(scene.bounces, room)];
        }
        if k < points {
            let mut by = no_point_gradient();
            let triangle = records[record_at(room, k, 0u32)];
            let distance = kept(records, room, k, 1u32);
            let origin = kept_vector(records, room, k, 2u32);
            let incoming = kept_vector(records, room, k, 5u32);
            let carried = g.radiance.times(kept_vector(records, room, k, 8u32));
            let counts = carried.abs().element_sum() / (typical * scale).max(1e-37);
            let sample = piece.from + thread / piece.count;
            let path = begin(&scene, which.pixel, sample);
            let near = origin + incoming * distance;
            let point = point_at(&scene, triangle, near, distance, incoming, path.time);
            if counts > 0.0 && point.reflects {
                let at = Observer {
                    point,
                    bounce: k,
                    moves: moves_at(&scene, records, room, k, of),
                    carried,
                    counts,
                };
                let mut stack_room = Array::<u32>::new(scene.features.stack);
                let stack = stack_room.as_mut_slice();
                let mut edge_room = Array::<u32>::new(sums.of.edge_room);
                let edges = edge_room.as_mut_slice();
                let mut choice_room = Array::<u32>::new(scene.features.of_emitters.room);
                let choice = choice_room.as_mut_slice();
                jumps_seen_from(&scene, stack, edges, choice, &sums, &path, &at, &mut by);
            }
            put(scene.bounces, records, room, k, 0u32, by.position);
            put(scene.bounces, records, room, k, 3u32, by.geometric);
            put(scene.bounces, records, room, k, 6u32, by.shading.normal);
            put(scene.bounces, records, room, k, 9u32, by.shading.incoming);
            records[jumped_at(scene.bounces, room, k, 12u32)] = by.shading.exponent.to_bits();
            records[jumped_at(scene.bounces, room, k, 13u32)] = by.shading.specular.x.to_bits();
        }
    }
}

/// Adds the derivatives along paths that left records, times those of a loss by the pixels' rows, to sums.
#[cube(launch)]
pub(super) fn go_back(
    floats: &[f32],
    words: &[u32],
    pixels: &[u32],
    upstream: &[f32],
    records: &mut [u32],
    totals: &[Atomic<u32>],
    scales: &[f32],
    replicas: u32,
    region: u32,
    piece: Piece,
    scale: f32,
    #[comptime] listed: bool,
    #[comptime] outputs: Outputs,
    #[comptime] features: Features,
    #[comptime] of: Derivatives,
) {
    let threads = piece.paths();
    if ABSOLUTE_POS < threads as usize && !is_skipped(scales) {
        let thread = ABSOLUTE_POS as u32;
        let which = pixel_at(pixels, piece, thread % piece.count, listed);
        let scene = Scene::of_view(floats, words, which.view, features);
        let sums = sums_at(
            &scene,
            &totals[replica_of(thread, replicas, region)..],
            scales,
            of,
        );
        let g = upstream_of(scene.settings, upstream, which.row, scale, outputs);
        if is_asked(&g) {
            let mut by_camera = CameraGradient::none();
            let room = Room { thread, threads };
            let sample = piece.from + thread / piece.count;
            let path = begin(&scene, which.pixel, sample);
            let points = records[points_at(scene.bounces, room)];
            let mut choice_room = Array::<u32>::new(scene.features.of_emitters.room);
            let choice = choice_room.as_mut_slice();
            path_backward(
                &scene,
                records,
                choice,
                &sums,
                room,
                path,
                which.pixel,
                points,
                g,
                &mut by_camera,
            );
            if comptime!(sums.of.camera) {
                add_to_camera(&sums, &by_camera);
            }
        }
    }
}
