//! A path from the camera to its end: `kernel/path` and `kernel/direct` in a kernel of a GPU.
//!
//! Calls are inlined in a kernel, so there is one place that traces a ray, in a loop over the rays of a path:
//! the camera's, those to lights, and those with which the path goes on.

use burn::cubecl::{self, prelude::*};

use super::Features;
use super::hit::{Hit, Ray, see_all, trace, vector};
use super::layout::{BOUNCES, CAMERA, CONE, DUAL, FILTER, NONE, ROULETTE_AFTER, WIDTH};
use super::light::{
    Choice, Emitter, all_seen_from, chance, choose, choose_direction, density_of_direction,
    emitter, next_emitter_hit, sky,
};
use super::numbers::{Four, Stream, numbers_of, numbers_of_cones, on_disk};
use super::surface::{Point, point_at};
use crate::model::bsdf::Scatter;
use crate::model::camera::{Camera, CameraRay, Dual};
use crate::model::cone::{bend, lifted, up_to_plane};
use crate::model::emitter::power_heuristic;
use crate::model::filter::sample_filter;
use crate::model::{Pair, V3, splat, v2, v3};

/// The surface that a camera ray sees, and the light that its path brings back.
#[derive(CubeType, CubeTypeMut, Clone, Copy, Debug)]
#[expand(derive(Clone, Copy))]
pub(super) struct PathLight {
    pub radiance: V3,
    /// 1 where there is a surface.
    pub opacity: f32,
    pub depth: f32,
    pub normal: V3,
    /// The object that is seen, or [`NONE`].
    pub object: u32,
    pub rays: u32,
    /// Points of surfaces that it came to.
    pub points: u32,
}

#[cube]
pub(super) fn camera(floats: &[f32], #[comptime] parallel: bool) -> Camera {
    Camera {
        eye: vector(floats, CAMERA as u32),
        across: vector(floats, CAMERA as u32 + 3),
        upward: vector(floats, CAMERA as u32 + 6),
        forward: vector(floats, CAMERA as u32 + 9),
        dual: Dual {
            x: vector(floats, DUAL as u32),
            y: vector(floats, DUAL as u32 + 3),
            z: vector(floats, DUAL as u32 + 6),
        },
        lens: Pair {
            first: vector(floats, CAMERA as u32 + 12),
            second: vector(floats, CAMERA as u32 + 15),
        },
        aperture: 0.0f32.runtime(),
        per_focus: floats[CAMERA + 18],
        parallel: parallel.runtime(),
        width: floats[CAMERA + 19],
        height: floats[CAMERA + 20],
    }
}

/// What the next ray of a path is for.
const OF_CAMERA: u32 = 0;
const TO_EMITTER: u32 = 1;
const TO_EMITTERS_ALONG: u32 = 2;
const TO_MAP: u32 = 3;
const TO_MAP_ALONG: u32 = 4;
const ONWARDS: u32 = 5;
const ENDED: u32 = 6;

/// A ray to a light, and the light that it brings if nothing is in between. Its limit is less than 0 if there
/// is none.
#[derive(CubeType, CubeTypeMut, Clone, Copy, Debug)]
#[expand(derive(Clone, Copy))]
struct ShadowRay {
    direction: V3,
    limit: f32,
    light: V3,
}

/// A surface point of a path, and its random numbers there.
#[derive(CubeType, CubeTypeMut, Clone, Copy, Debug)]
#[expand(derive(Clone, Copy))]
struct Receiver {
    point: Point,
    start: V3,
    cone_u: f32,
    cone_v: f32,
    /// What the probabilities of emitters there are divided by.
    sum: f32,
}

/// A ray to a point of an emitter. `by_scattering` says by which of two strategies the point was found, if
/// `combined`.
#[cube]
fn towards_emitter(
    floats: &[f32],
    from: &Receiver,
    e: Emitter,
    b: f32,
    c: f32,
    chance: f32,
    combined: bool,
    by_scattering: bool,
) -> ShadowRay {
    let light = e.a * (1.0 - b - c) + e.b * b + e.c * c;
    let to = light - from.point.position;
    let squared = to.length_squared().max(1e-37);
    let direction = to * (1.0 / squared.sqrt());
    let facing = -e.normal.dot(direction);
    let reflected = from.point.shading.evaluate(direction);
    let mut ray = ShadowRay {
        direction,
        limit: (-1.0f32).runtime(),
        light: splat(0.0),
    };
    if facing > 0.0 && !reflected.is_zero() {
        let bent = bend(
            direction,
            from.point.shading.geometric,
            floats[CONE],
            from.cone_u,
            from.cone_v,
        );
        ray.direction = bent.direction;
        ray.limit = up_to_plane(from.start, bent.direction, e.normal, light);
        let per_area = facing / squared * e.area;
        let mut density = chance;
        if combined {
            let other = from.point.shading.density(direction) * per_area;
            density = power_heuristic(chance, other, by_scattering);
        }
        ray.light = reflected.times(e.emission) * (per_area / density);
    }
    ray
}

/// A ray to the map along a direction, which was found by one of two strategies.
#[cube]
fn towards_map(
    floats: &[f32],
    words: &[u32],
    from: &Receiver,
    direction: V3,
    by_scattering: bool,
    #[comptime] features: Features,
) -> ShadowRay {
    let shading = from.point.shading;
    let reflected = shading.evaluate(direction);
    let mut ray = ShadowRay {
        direction,
        limit: (-1.0f32).runtime(),
        light: splat(0.0),
    };
    if !reflected.is_zero() {
        let bent = bend(
            direction,
            shading.geometric,
            floats[CONE],
            from.cone_u,
            from.cone_v,
        );
        let chance = density_of_direction(floats, words, direction);
        let density = power_heuristic(chance, shading.density(direction), by_scattering);
        ray.direction = bent.direction;
        ray.limit = f32::MAX.runtime();
        ray.light = reflected.times(sky(floats, words, direction, features)) * (1.0 / density);
    }
    ray
}

/// A surface point that is not there yet.
#[cube]
fn no_point() -> Point {
    let zero = splat(0.0f32.runtime());
    Point {
        position: zero,
        shading: crate::model::bsdf::Shading {
            geometric: zero,
            normal: zero,
            incoming: zero,
            diffuse: zero,
            specular: zero,
            exponent: 0.0f32.runtime(),
            glossy: false.runtime(),
            smooth: false.runtime(),
            pair: Pair {
                first: zero,
                second: zero,
            },
            paired: false.runtime(),
        },
        emission: zero,
        reflects: false.runtime(),
        triangle: NONE.runtime(),
        material: 0u32.runtime(),
        object: 0u32.runtime(),
        side: 1.0f32.runtime(),
        weights: zero,
        uv: v2(0.0, 0.0),
    }
}

#[cube]
fn camera_ray(
    floats: &[f32],
    words: &[u32],
    film: Four,
    more: Four,
    pixel: u32,
    #[comptime] features: Features,
) -> CameraRay {
    let table = words[FILTER] as usize;
    let width = words[WIDTH];
    let x = (pixel % width) as f32 + 0.5 + sample_filter(floats, table, film.x);
    let y = (pixel / width) as f32 + 0.5 + sample_filter(floats, table, film.y);
    let mut on_lens = v2(0.0, 0.0);
    if comptime!(features.lens) {
        on_lens = on_disk(more.x, more.y);
    }
    camera(floats, features.parallel).ray(x, y, on_lens.x, on_lens.y)
}

/// A path's random numbers, and its camera ray.
#[derive(CubeType, CubeTypeMut, Clone, Copy, Debug)]
#[expand(derive(Clone, Copy))]
pub(super) struct Beginning {
    pub numbers: Stream,
    pub cones: Stream,
    pub film: Four,
    pub time: f32,
    pub ray: CameraRay,
}

/// The beginning of a path of a pixel.
#[cube]
pub(super) fn begin(
    floats: &[f32],
    words: &[u32],
    pixel: u32,
    sample: u32,
    #[comptime] features: Features,
) -> Beginning {
    let numbers = numbers_of(words, pixel, sample, features.sobol);
    let cones = numbers_of_cones(words, pixel, sample, features.sobol);
    let film = numbers.film(words, features.sobol);
    let mut more = film;
    if comptime!(features.lens || features.moves) {
        more = numbers.lens_and_time(words, features.sobol);
    }
    let mut time = 0.0f32;
    if comptime!(features.moves) {
        time = more.z;
    }
    Beginning {
        numbers,
        cones,
        film,
        time,
        ray: camera_ray(floats, words, film, more, pixel, features),
    }
}

/// Words of a record of a path's point: its triangle, what it was hit by (distance, origin, direction), the
/// throughput that arrives, what was seen from it, and the probability with which the path went on.
pub(super) const RECORD: u32 = 13;
/// What was seen from a point, bit by bit: the emitter that was drawn, those along the way on (one bit each, as
/// many as there is room for), the map in the direction that was drawn and in that of the way on; whether the
/// path went on, and whether it ended in the environment.
pub(super) const SAW_EMITTER: u32 = 1;
pub(super) const SAW_ALONG: u32 = 2;
pub(super) const MOST_ALONG: u32 = 26;
pub(super) const SAW_MAP: u32 = 1 << 28;
pub(super) const SAW_MAP_ALONG: u32 = 1 << 29;
pub(super) const WENT_ON: u32 = 1 << 30;
pub(super) const ESCAPED: u32 = 1 << 31;

/// Words that a path keeps for its way back, one word of all threads after another.
#[derive(CubeType, CubeTypeMut, Clone, Copy, Debug)]
#[expand(derive(Clone, Copy))]
pub(super) struct Room {
    pub thread: u32,
    pub threads: u32,
}

/// The place of a word of a point's record.
#[cube]
pub(super) fn record_at(room: Room, point: u32, word: u32) -> usize {
    ((point * RECORD + word) * room.threads + room.thread) as usize
}

#[cube]
fn keep_vector(records: &mut [u32], room: Room, point: u32, word: u32, v: V3) {
    records[record_at(room, point, word)] = v.x.to_bits();
    records[record_at(room, point, word + 1)] = v.y.to_bits();
    records[record_at(room, point, word + 2)] = v.z.to_bits();
}

#[cube]
pub(super) fn kept(records: &mut [u32], room: Room, point: u32, word: u32) -> f32 {
    f32::from_bits(records[record_at(room, point, word)])
}

#[cube]
pub(super) fn kept_vector(records: &mut [u32], room: Room, point: u32, word: u32) -> V3 {
    v3(
        kept(records, room, point, word),
        kept(records, room, point, word + 1),
        kept(records, room, point, word + 2),
    )
}

/// A surface point that a path starts from in place of the camera.
#[derive(CubeType, CubeTypeMut, Clone, Copy, Debug)]
#[expand(derive(Clone, Copy))]
pub(super) struct Start {
    pub triangle: u32,
    /// A place about there, and the direction in which it is seen.
    pub near: V3,
    pub direction: V3,
    pub distance: f32,
    pub bounce: u32,
    /// Normals about which directions are drawn, if it is paired ([`Shading`](crate::model::bsdf::Shading)).
    pub pair: Pair,
    pub paired: bool,
    /// Whether what it emits counts.
    pub emits: bool,
}

/// The camera.
#[cube]
pub(super) fn from_camera() -> Start {
    let zero = splat(0.0f32.runtime());
    Start {
        triangle: NONE,
        near: zero,
        direction: zero,
        distance: 0.0f32,
        bounce: 0u32,
        pair: Pair {
            first: zero,
            second: zero,
        },
        paired: false,
        emits: true,
    }
}

/// Traces a path from its beginning, or with `beside` from a point. `stack` is room for nodes of the tree; with
/// `keep` the path's points are left in `records`.
#[cube]
pub(super) fn path_light(
    floats: &[f32],
    words: &[u32],
    stack: &mut [u32],
    records: &mut [u32],
    room: Room,
    path: Beginning,
    start: Start,
    #[comptime] beside: bool,
    #[comptime] keep: bool,
    #[comptime] features: Features,
) -> PathLight {
    let numbers = path.numbers;
    let cones = path.cones;
    let time = path.time;
    let first = path.ray;
    let mut seen = PathLight {
        radiance: splat(0.0),
        opacity: 0.0f32,
        depth: 0.0f32,
        normal: splat(0.0),
        object: NONE,
        rays: 0u32,
        points: 0u32,
    };
    let mut from = Receiver {
        point: no_point(),
        start: splat(0.0),
        cone_u: 0.0f32,
        cone_v: 0.0f32,
        sum: 0.0f32,
    };
    let mut throughput = splat(1.0);
    let mut scatter = Scatter {
        direction: splat(0.0),
        weight: splat(0.0),
        local: splat(0.0),
        of_gloss: false,
        u: 0.0f32,
        v: 0.0f32,
    };
    // Random numbers for the emitter that the path's point is connected to, and for that of the next point.
    let mut emitter_u = 0.0f32;
    let mut emitter_v = 0.0f32;
    let mut next_u = path.film.z;
    let mut next_v = path.film.w;
    let mut bounce = 0u32;
    // Where the list of emitters along a direction goes on.
    let mut next = 0u32;
    // What was seen from the path's point, and the bit of the next emitter along a direction.
    let mut bits = 0u32.runtime();
    let mut bit = SAW_ALONG.runtime();
    let mut purpose = OF_CAMERA.runtime();
    let mut origin = first.origin;
    let mut direction = first.direction;
    let mut limit = f32::MAX.runtime();
    let mut light = splat(0.0);
    let bounces = words[BOUNCES];
    let mut begins = true;
    if beside {
        bounce = start.bounce;
        origin = start.near;
        direction = start.direction;
        limit = -1.0f32;
    }
    while purpose != ENDED {
        let mut hit = Hit {
            t: 0.0f32,
            triangle: NONE,
        };
        if beside {
            if begins {
                hit.triangle = start.triangle;
                begins = false;
            }
        }
        if limit > 0.0 {
            let last = bounce >= bounces;
            let any = purpose != OF_CAMERA && (purpose != ONWARDS || last);
            let ray = Ray {
                origin,
                direction,
                time,
                from: 0.0f32,
                limit,
            };
            hit = trace(floats, words, stack, ray, see_all(), any, false, features);
            seen.rays += 1;
        }
        let missed = hit.triangle == NONE;
        let arrives = purpose == OF_CAMERA || purpose == ONWARDS;
        if arrives {
            if missed {
                // With a map that is gathered at surfaces, rays that go on bring nothing.
                if purpose == OF_CAMERA || comptime!(features.sees_sky) {
                    bits |= ESCAPED;
                    seen.radiance += throughput.times(sky(floats, words, direction, features));
                }
                purpose = ENDED;
            } else if purpose == ONWARDS && bounce >= bounces {
                purpose = ENDED;
            } else {
                let near = origin + direction * hit.t;
                let mut point =
                    point_at(floats, words, hit.triangle, near, direction, time, features);
                if purpose == OF_CAMERA {
                    if beside {
                        hit.t = start.distance;
                        point.shading.pair = start.pair;
                        point.shading.paired = start.paired;
                        if !start.emits {
                            point.emission = splat(0.0);
                        }
                    }
                    seen.radiance += point.emission;
                    seen.opacity = 1.0;
                    seen.depth = hit.t;
                    seen.normal = point.shading.geometric;
                    seen.object = point.object;
                } else {
                    bounce += 1;
                }
                emitter_u = next_u;
                emitter_v = next_v;
                if keep {
                    let k = seen.points;
                    if k > 0 {
                        records[record_at(room, k - 1, 11u32)] = bits;
                    }
                    records[record_at(room, k, 0u32)] = hit.triangle;
                    records[record_at(room, k, 1u32)] = hit.t.to_bits();
                    keep_vector(records, room, k, 2u32, origin);
                    keep_vector(records, room, k, 5u32, direction);
                    keep_vector(records, room, k, 8u32, throughput);
                    bits = 0u32;
                    bit = SAW_ALONG;
                }
                seen.points += 1;
                let goes_on = bounce < bounces || comptime!(features.sees_sky);
                let by_scattering = comptime!(features.combined) && point.shading.glossy;
                from.point = point;
                from.start = lifted(point.position, point.shading.geometric);
                purpose = TO_EMITTER;
                if !point.reflects || comptime!(features.dark) {
                    purpose = ENDED;
                } else {
                    if comptime!(features.cones) {
                        let set = cones.set(words, bounce, features.sobol);
                        from.cone_u = set.z;
                        from.cone_v = set.w;
                    }
                    from.sum = all_seen_from(floats, words, point.position, time, features);
                }
                if goes_on || by_scattering || comptime!(features.gathers_map) {
                    let drawn = numbers.direction(words, bounce, features.sobol);
                    let mut lobe = 0.0f32;
                    if point.shading.glossy {
                        lobe = numbers.choices(words, bounce, features.sobol).x;
                    }
                    scatter = point.shading.sample(drawn.x, drawn.y, lobe);
                    next_u = drawn.z;
                    next_v = drawn.w;
                }
                next = 0u32;
            }
        } else {
            if missed && limit > 0.0 {
                seen.radiance += throughput.times(light);
                if keep {
                    if purpose == TO_EMITTER {
                        bits |= SAW_EMITTER;
                    } else if purpose == TO_EMITTERS_ALONG {
                        bits |= bit;
                    } else if purpose == TO_MAP {
                        bits |= SAW_MAP;
                    } else {
                        bits |= SAW_MAP_ALONG;
                    }
                }
            }
            if purpose == TO_EMITTERS_ALONG {
                // Where bits end the last one stands for all; no light hides behind so many others.
                if bit < (1u32 << MOST_ALONG) {
                    bit *= 2;
                }
            }
            if purpose != TO_EMITTERS_ALONG {
                purpose += 1;
            }
        }
        // The next ray.
        let mut chosen = ShadowRay {
            direction: splat(0.0),
            limit: (-1.0f32).runtime(),
            light: splat(0.0),
        };
        let mut is_emitter = false;
        let mut is_map = false;
        let mut along = false;
        if purpose == TO_EMITTER || purpose == TO_EMITTERS_ALONG {
            if comptime!(features.emitters) {
                is_emitter = true;
            } else {
                purpose = TO_MAP;
            }
        }
        if is_emitter {
            let mut k = 0u32;
            let mut b = 0.0f32;
            let mut c = 0.0f32;
            let mut p = 1.0f32;
            let combined = comptime!(features.combined) && from.point.shading.glossy;
            let x = from.point.position;
            if purpose == TO_EMITTER {
                let choice: Choice = choose(floats, words, emitter_u, x, time, from.sum, features);
                let root = choice.rest.sqrt();
                k = choice.emitter;
                p = choice.chance;
                b = root * (1.0 - emitter_v);
                c = root * emitter_v;
            } else {
                along = true;
                k = NONE;
                if combined {
                    let found =
                        next_emitter_hit(floats, words, next, x, scatter.direction, time, features);
                    k = found.emitter;
                    b = found.weights.x;
                    c = found.weights.y;
                    next = k + 1;
                    if k != NONE {
                        p = chance(floats, words, k, x, time, from.sum, features);
                    }
                }
            }
            if k == NONE {
                purpose = TO_MAP;
            } else {
                let e = emitter(floats, words, k, time, features);
                chosen = towards_emitter(floats, &from, e, b, c, p, combined, along);
            }
        }
        if purpose == TO_MAP || purpose == TO_MAP_ALONG {
            if comptime!(features.gathers_map) {
                is_map = true;
            } else {
                purpose = ONWARDS;
            }
        }
        if comptime!(features.gathers_map) {
            if is_map {
                let mut towards = scatter.direction;
                if purpose == TO_MAP {
                    let drawn = numbers.choices(words, bounce, features.sobol);
                    towards = choose_direction(floats, words, drawn.z, drawn.w);
                }
                let by_scattering = purpose == TO_MAP_ALONG;
                chosen = towards_map(floats, words, &from, towards, by_scattering, features);
            }
        }
        if purpose == ONWARDS {
            let last = bounce >= bounces;
            if (last && !comptime!(features.sees_sky)) || scatter.weight.is_zero() {
                purpose = ENDED;
            } else {
                throughput = throughput.times(scatter.weight);
                let mut survived = 1.0f32;
                if comptime!(features.roulette) {
                    if !last && bounce >= words[ROULETTE_AFTER] {
                        let survival = throughput.max_element().max(0.05).min(1.0);
                        let drawn = numbers.choices(words, bounce, features.sobol);
                        if drawn.y >= survival {
                            purpose = ENDED;
                        }
                        throughput = throughput * (1.0 / survival);
                        survived = survival;
                    }
                }
                if keep {
                    bits |= WENT_ON;
                    records[record_at(room, seen.points - 1, 12u32)] = survived.to_bits();
                }
                let mut u = 0.0f32;
                let mut v = 0.0f32;
                if comptime!(features.cones) {
                    let set = cones.set(words, bounce, features.sobol);
                    u = set.x;
                    v = set.y;
                }
                let geometric = from.point.shading.geometric;
                let bent = bend(scatter.direction, geometric, floats[CONE], u, v);
                chosen.direction = bent.direction;
                chosen.limit = f32::MAX;
            }
        }
        origin = from.start;
        direction = chosen.direction;
        limit = chosen.limit;
        light = chosen.light;
    }
    if keep {
        if seen.points > 0 {
            records[record_at(room, seen.points - 1, 11u32)] = bits;
        }
    }
    seen
}
