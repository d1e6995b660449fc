//! The kernels of a backward pass. First, paths are traced again and store records. Then jumps are added at the
//! points that make searches for edges. Last, the backward pass runs along each path. Separate kernels are small, and
//! the points of one path are computed by separate threads.

use softray_kernels::cube::*;

use super::backward::path_backward;
use super::camera::{begin, camera};
use super::hit::Memory;
use super::job::{Outputs, PathAt, Paths};
use super::jumps::{jumps_seen_from, searches_of};
use super::loss::Loss;
use super::path::path_light;
use super::records::{OF_TRIANGLE, Room};
use super::searches::{Order, count_searches};
use super::sums::{Adding, of_channel};
use super::walk::Start;
use softray_kernels::model::numbers::is_nonzero;
use softray_kernels::model::v2;
use softray_kernels::trace::{
    Derivatives, FilmSlopes, NONE, Observer, Scene, Seen, middle_of, pixels_around,
};

/// Returns the room for a path's records.
#[cube]
fn room_of(thread: u32, threads: u32, bounces: u32, #[comptime] forward: bool) -> Room {
    let channels = comptime!(Outputs::channels_of_radiance(forward));
    Room::new(thread, threads, bounces, channels)
}

/// Traces the paths of a piece and stores their records. All paths of one sample come before the paths of the next
/// sample. With `jumps`, it also counts the searches of their points.
#[cube(launch)]
pub(super) fn keep_paths(paths: Paths, loss: Loss, records: &mut [u32], #[comptime] jumps: bool) {
    let threads = paths.piece.threads();
    // The threads of a workgroup meet in `count_searches`, also those without a path.
    let thread = (ABSOLUTE_POS as u32).min(threads - 1);
    let which = paths.of_thread(thread);
    let scene = paths.views.scene(which.view);
    let room = room_of(thread, threads, scene.bounces, loss.forward);
    let mut points = 0u32;
    if ABSOLUTE_POS < threads as usize && is_nonzero(loss.of_row(&scene, which.row).size()) {
        let mut memory = Memory::new(&scene);
        let path = begin(&scene, which.pixel, which.sample);
        let light = path_light(
            &scene,
            &mut memory,
            records,
            room,
            path,
            Start::default(),
            false,
            true,
        );
        points = light.points;
        room.keep_path(records, points, light.seen.radiance);
    }
    if comptime!(jumps) {
        count_searches(&scene, &loss, records, &room, which, points);
    }
}

/// Returns whether a point of a path moves with a tracked tensor, or the directions sampled there turn with one.
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
        moves = scene.is_wanted(scene.object_of(records[room.at(k, OF_TRIANGLE)]));
        k += 1;
    }
    moves
}

/// Adds the derivatives from jumps seen from points of paths, with one thread per point that makes searches: at
/// shadow edges of emitters, or at edges in reflected light.
#[cube(launch)]
pub(super) fn add_jumps(
    paths: Paths,
    loss: Loss,
    records: &mut [u32],
    adding: Adding,
    #[comptime] of_light: bool,
) {
    let threads = paths.piece.threads();
    let bounces = paths.views.scene(0u32).bounces;
    let all = room_of(0u32, threads, bounces, loss.forward);
    let order = Order::new(&all, bounces + 1);
    let index = ABSOLUTE_POS as u32;
    let which_point = order.point(records, index, of_light);
    if which_point != NONE {
        let (thread, k) = order.path(which_point);
        let which = paths.of_thread(thread);
        let scene = paths.views.scene(which.view);
        let sums = loss.sums(&scene, &adding, index, which.row);
        let room = room_of(thread, threads, scene.bounces, loss.forward);
        let g = loss.of_row(&scene, which.row);
        let arrival = room.arrival(records, k);
        let carried = g.radiance.times(arrival.throughput);
        let path = begin(&scene, which.pixel, which.sample);
        let at = Observer {
            point: arrival.point(&scene, path.time, k),
            bounce: k,
            moves: moves_at(&scene, records, room, k, sums.of),
            carried,
            searches: searches_of(&scene, loss.counts_of(which.view, carried), of_light),
        };
        let mut memory = Memory::new(&scene);
        jumps_seen_from(
            &scene,
            &mut memory,
            records,
            room,
            &loss,
            &sums,
            &path,
            &at,
            of_light,
        );
    }
}

/// Returns the slope of the derivative of the loss at the film point of a path, whose pixel has the derivatives `g`. Without
/// those of all pixels, it is that of the pixel's own filter.
#[cube]
fn film_slopes(paths: &Paths, loss: &Loss, scene: &Scene, which: PathAt, g: &Seen) -> FilmSlopes {
    let mut slopes = FilmSlopes::default();
    if scene.follows_on_film() {
        let path = begin(scene, which.pixel, which.sample);
        let at = camera(scene).film_point(&path.ray);
        if comptime!(loss.forward || paths.listed) {
            let middle = middle_of(scene, which.pixel);
            slopes.add(scene, g, v2(at.x - middle.x, at.y - middle.y));
        } else {
            let first = which.row - which.pixel;
            let rows = pixels_around(scene, at.y, scene.height);
            let columns = pixels_around(scene, at.x, scene.width);
            let mut y = rows.first;
            while y < rows.past {
                let mut x = columns.first;
                while x < columns.past {
                    let own = loss.of_row(scene, first + y * scene.width + x);
                    // Pixels on which the loss doesn't depend have no samples.
                    if is_nonzero(own.size()) {
                        let offset = v2(at.x - x as f32 - 0.5, at.y - y as f32 - 0.5);
                        slopes.add(scene, &own, offset);
                    }
                    x += 1;
                }
                y += 1;
            }
        }
    }
    slopes
}

/// Adds the derivatives along recorded paths, times the derivatives of the loss with respect to the pixels' rows, to
/// the sums. Forward mode has a thread for each path and channel.
#[cube(launch)]
pub(super) fn go_back(paths: Paths, loss: Loss, records: &mut [u32], adding: Adding) {
    let threads = paths.piece.threads();
    let channels = comptime!(loss.outputs.channels(loss.forward));
    if ABSOLUTE_POS < (threads * channels) as usize {
        let thread = ABSOLUTE_POS as u32 % threads;
        let channel = ABSOLUTE_POS as u32 / threads;
        let which = paths.of_thread(thread);
        let scene = paths.views.scene(which.view);
        let sums = of_channel(&loss.sums(&scene, &adding, thread, which.row), channel);
        let g = loss.of_channel(&loss.of_row(&scene, which.row), channel);
        if is_nonzero(g.size()) {
            let room = room_of(thread, threads, scene.bounces, loss.forward);
            let slopes = film_slopes(&paths, &loss, &scene, which, &g);
            path_backward(&scene, records, &sums, room, which, g, &slopes, channel);
        }
    }
}
