//! Jumps of the image that the camera sees, one thread a sample.

use burn::cubecl::{self, prelude::*};

use super::Outputs;
use super::camera::{
    Beginning, Exposure, SEED_OF_CONES, SEED_OF_EDGES, SEED_OF_FILM, camera, exposure, sampler,
};
use super::film_table::{ALL, DrawnPiece, MOST, OF_FILM, OWN, RADIUS, TOTAL, draw_piece, view_of};
use super::hit::{Ray, trace};
use super::passes::{is_asked, upstream_of};
use super::side_light::{Approach, light_beside};
use super::sums::{is_skipped, replica_of, sums_at};
use crate::model::camera::CameraRay;
use crate::model::jumps::Sides;
use crate::model::numbers::{is_finite, is_nonzero};
use crate::sampling::Dimensions;
use crate::trace::{Behind, Derivatives, Features, FilmPoint, NONE, Scene, film_point, hides};

/// The pixel of random numbers that are of no pixel.
const NO_PIXEL: u32 = u32::MAX;

/// The place of a pixel of the film in the rows of a view's image, or [`NONE`].
#[cube]
fn row_of(scene: &Scene, places: &[u32], x: f32, y: f32, #[comptime] listed: bool) -> u32 {
    let mut row = NONE.runtime();
    if x >= 0.0 && y >= 0.0 && x < scene.width as f32 && y < scene.height as f32 {
        row = y as u32 * scene.width + x as u32;
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
        let scene = Scene::of_view(floats, words, which, features);
        let sums = sums_at(
            &scene,
            &totals[replica_of(thread, replicas, region)..],
            scales,
            of,
        );
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
            let lambda = pieces[piece] + length * film.y;
            let per_density = length * (total / share.max(1e-37)) / all as f32;
            let c = camera(&scene);
            let edge = pieces[piece + 3] as u32;
            let mut f: FilmPoint = film_point(&scene, &c, edge, lambda, per_density, lens, time);
            let mut row = NONE.runtime();
            if share > 0.0 && f.is_seen {
                // The pixel whose ray would come here.
                let kernel = sampler(&scene, SEED_OF_EDGES).stream(NO_PIXEL, sample);
                let drawn = kernel.draw(scene.points, Dimensions::of_set(0u32));
                f.project(&c, drawn.x, drawn.y, radius);
                row = row_of(&scene, places, f.film.x, f.film.y, listed);
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
                    let mut choice_room = Array::<u32>::new(scene.features.of_emitters.room);
                    let choice = choice_room.as_mut_slice();
                    let p = f.point;
                    let view = p.to.normalize();
                    let sides: Sides = f.sides(&scene, &c, view, time);
                    let ray = Ray {
                        origin: f.origin,
                        direction: sides.past,
                        time,
                        from: 0.0f32,
                        limit: f32::MAX,
                    };
                    let hit = trace(&scene, stack, ray, p.faces, false, true);
                    if !hides(&scene, hit.triangle, hit.t, &p, time) {
                        let approach = Approach {
                            point: p,
                            origin: f.origin,
                            view,
                            sides,
                            behind: Behind {
                                triangle: hit.triangle,
                                distance: hit.t,
                            },
                        };
                        let beginning = Beginning {
                            numbers,
                            cones: sampler(&scene, SEED_OF_CONES).stream(NO_PIXEL, sample),
                            film,
                            time,
                            ray: CameraRay {
                                origin: f.origin,
                                direction: view,
                                length: 1.0f32,
                                x: 0.0f32,
                                y: 0.0f32,
                                lens_x: lens.x,
                                lens_y: lens.y,
                            },
                        };
                        let light = light_beside(
                            &scene, stack, choice, beginning, 0u32, true, &approach, true,
                        );
                        let jump = g.jump(&light);
                        let scale = jump * p.per_density;
                        if is_nonzero(scale) && is_finite(scale) {
                            f.backward(&scene, &sums, &c, jump, time);
                        }
                    }
                }
            }
        }
    }
}
