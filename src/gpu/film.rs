//! Jumps of the image that the camera sees, one thread a sample: `kernel/boundary/film` in a kernel of a GPU.

use burn::cubecl::{self, prelude::*};

use super::backward::{add_camera, no_camera_gradient};
use super::camera::{Beginning, Exposure, camera, exposure, sampler};
use super::edge_layout::{SEED_OF_EDGES, SEED_OF_FILM};
use super::edge_point::{add_to_edge, edge_of, shift_of, sides};
use super::film_table::{ALL, DrawnPiece, MOST, OF_FILM, OWN, RADIUS, TOTAL, draw_piece, view_of};
use super::finite::{is_finite, is_nonzero};
use super::hit::{Ray, trace};
use super::jumps::hides;
use super::layout::{HEIGHT, NONE, SEED_OF_CONES, WIDTH};
use super::passes::{is_asked, upstream_of};
use super::reading::Scene;
use super::side_light::{Behind, light_beside};
use super::sums::{Totals, is_skipped, replica_of};
use super::{Derivatives, Features, Outputs};
use crate::model::camera::CameraRay;
use crate::model::filter::film_kernel;
use crate::model::v2;
use crate::sampling::Dimensions;

/// The pixel of random numbers that are of no pixel.
const NO_PIXEL: u32 = u32::MAX;

/// The place of a pixel of the film in the rows of a view's image, or [`NONE`].
#[cube]
fn row_of(scene: &Scene, places: &[u32], x: f32, y: f32, #[comptime] listed: bool) -> u32 {
    let mut row = NONE.runtime();
    if x >= 0.0 && y >= 0.0 && x < scene.header[WIDTH] as f32 && y < scene.header[HEIGHT] as f32 {
        row = y as u32 * scene.header[WIDTH] + x as u32;
        if listed {
            row = places[row as usize];
        }
    }
    row
}

/// Adds the derivatives by jumps on the film, one thread a sample of all views, from a first one on; or with `spread`,
/// of so many samples of each view, spread over its own. There are `count` pieces ([`film_table`](super::film_table)).
#[cube(launch)]
pub(super) fn film_jumps(
    floats: &[f32],
    words: &[u32],
    pieces: &[f32],
    films: &[u32],
    upstream: &[f32],
    totals: &[Atomic<u32>],
    scales: &[f32],
    replicas: u32,
    region: u32,
    first: u32,
    spread: u32,
    threads: u32,
    count: u32,
    views: u32,
    of_view: u32,
    #[comptime] listed: bool,
    #[comptime] outputs: Outputs,
    #[comptime] features: Features,
    #[comptime] of: Derivatives,
) {
    if ABSOLUTE_POS < threads as usize && !is_skipped(scales) {
        let thread = first + ABSOLUTE_POS as u32;
        let mut which = view_of(films, views, thread, ALL);
        if spread > 0 {
            which = thread / spread.max(1);
        }
        let scene = Scene::new(floats, words, which, features);
        let sums = Totals::new(&totals[replica_of(thread, replicas, region)..], scales, of);
        let places = &films[(OF_FILM * views) as usize..];
        let film_of = (OF_FILM * which) as usize;
        let all = films[film_of + OWN];
        let mut sample = thread;
        if spread > 0 {
            sample = ((thread % spread) as f32 * (all as f32 / spread as f32)) as u32;
        } else {
            sample = thread - (films[film_of + ALL] - films[film_of + MOST]);
        }
        let total = f32::from_bits(films[film_of + TOTAL]);
        let radius = f32::from_bits(films[film_of + RADIUS]);
        if sample < all && films[film_of + MOST] > 0 {
            let numbers = sampler(&scene, SEED_OF_FILM)
                .of_one_pixel()
                .stream(0u32, sample);
            let film = numbers.draw(scene.points, Dimensions::film());
            let Exposure { lens, time } = exposure(&scene, &numbers);
            let drawn: DrawnPiece = draw_piece(pieces, films, which, film.x * total, count);
            let piece = drawn.at;
            let share = drawn.share;
            let length = pieces[piece + 1] - pieces[piece];
            let mut p = edge_of(&scene, pieces[piece + 3] as u32, time);
            p.lambda = pieces[piece] + length * film.y;
            p.per_density = length * (total / share.max(1e-37)) / all as f32;
            p.position = p.a + p.along * p.lambda + shift_of(&scene, p.faces.a, time);
            let c = camera(&scene);
            let origin = c.origin_towards(p.position, lens.x, lens.y);
            p.to = p.position - origin;
            let mut row = NONE.runtime();
            let mut kernel_x = 0.0f32;
            let mut kernel_y = 0.0f32;
            if share > 0.0 && p.exists && p.to.dot(c.dual.z) > 0.0 {
                // The pixel whose ray would come here.
                let at = c.project(p.position, lens.x, lens.y);
                let kernel = sampler(&scene, SEED_OF_EDGES).stream(NO_PIXEL, sample);
                let drawn = kernel.draw(scene.points, Dimensions::of_set(0u32));
                kernel_x = film_kernel(drawn.x);
                kernel_y = film_kernel(drawn.y);
                let x = at.x - radius * kernel_x;
                let y = at.y - radius * kernel_y;
                row = row_of(&scene, places, x, y, listed);
            }
            if row != NONE {
                let g = upstream_of(
                    scene.settings,
                    upstream,
                    which * of_view + row,
                    1.0f32.runtime(),
                    outputs,
                );
                if is_asked(&g) {
                    let mut stack_room = Array::<u32>::new(scene.features.stack);
                    let stack = stack_room.as_mut_slice();
                    let view = p.to.normalize();
                    let along = c.project_along(p.position, p.along, lens.x, lens.y);
                    // To the right of the edge's image, on a film whose y points down.
                    let side = c.across * along.y + c.upward * along.x;
                    let beside = sides(&scene, &p, view, side, time);
                    let ray = Ray {
                        origin,
                        direction: beside.past,
                        time,
                        from: 0.0f32,
                        limit: f32::MAX,
                    };
                    let hit = trace(&scene, stack, ray, p.faces, false, true);
                    if !hides(&scene, hit, &p, time) {
                        let behind = Behind {
                            hit,
                            start: origin,
                            view,
                            sides: beside,
                        };
                        let beginning = Beginning {
                            numbers,
                            cones: sampler(&scene, SEED_OF_CONES).stream(NO_PIXEL, sample),
                            film,
                            time,
                            ray: CameraRay {
                                origin,
                                direction: view,
                                length: 1.0f32,
                                x: 0.0f32,
                                y: 0.0f32,
                                lens_x: lens.x,
                                lens_y: lens.y,
                            },
                        };
                        let light =
                            light_beside(&scene, stack, beginning, 0u32, true, &p, &behind, true);
                        let jump = g.radiance.dot(light.radiance) - g.opacity * light.sky
                            + g.depth * light.depth
                            + g.normal.dot(light.normal);
                        let scale = jump * p.per_density;
                        if is_nonzero(scale) && is_finite(scale) {
                            let mut by_camera = no_camera_gradient();
                            let by_film = v2(along.y * scale, -along.x * scale);
                            let by_point = c.project_backward(
                                p.position,
                                lens.x,
                                lens.y,
                                by_film,
                                &mut by_camera,
                            );
                            if comptime!(sums.of.camera) {
                                // A wider filter moves its points away from the middle, past the edge.
                                by_camera.filter -= by_film.x * kernel_x + by_film.y * kernel_y;
                                add_camera(&scene, &sums, &by_camera);
                            }
                            add_to_edge(&scene, &sums, &p, by_point, time);
                        }
                    }
                }
            }
        }
    }
}
