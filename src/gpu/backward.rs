//! Back along a path that left records: `kernel/backward` in a kernel of a GPU.

use burn::cubecl::{self, prelude::*};

use super::hit::vector;
use super::layout::{
    CONE, EMITS, FIRST_SUMS, NONE, NORMALS as NORMAL_VALUES, OF_MATERIAL, OF_MATERIALS,
    OF_TRIANGLE, OF_TRIANGLES, SKY as SKY_TEXELS, SKY_HEIGHT, SKY_WIDTH, SURFACE_STRIDE, SURFACES,
    TEXELS as TEXEL_VALUES, UVS as UV_VALUES, VERTEX_ROWS, WANTED_OBJECTS,
};
use super::light::{
    all_seen_from, cell_of_map, chance, choose, choose_direction, density_of_direction, emitter,
    next_emitter_hit, sky,
};
use super::passes::jumped;
use super::path::{
    Beginning, ESCAPED, MOST_ALONG, Room, SAW_ALONG, SAW_EMITTER, SAW_MAP, SAW_MAP_ALONG, WENT_ON,
    camera, kept, kept_vector, record_at,
};
use super::sums::{
    AREAS, CAMERA, MATERIALS, NORMALS, SKY, TEXELS, TRIANGLES, UVS, VELOCITIES, VERTICES, add,
    add_vector,
};
use super::surface::{Cell, Point, cell_of_texture, point_at};
use super::{Derivatives, Features};
use crate::model::bsdf::{Scatter, ShadingGradient};
use crate::model::camera::CameraGradient;
use crate::model::cone::{bend, bend_backward};
use crate::model::emitter::power_heuristic;
use crate::model::triangle::{barycentric_slopes, hit_backward};
use crate::model::{Pair, V2, V3, splat, v2, v3};

/// Derivatives of a loss by what a pixel's rays bring back.
#[derive(CubeType, CubeTypeMut, Clone, Copy, Debug)]
#[expand(derive(Clone, Copy))]
pub(super) struct Upstream {
    pub radiance: V3,
    pub opacity: f32,
    pub depth: f32,
    pub normal: V3,
}

/// Derivatives by a surface point, but for those that its incoming ray takes part in.
#[derive(CubeType, CubeTypeMut, Clone, Copy, Debug)]
#[expand(derive(Clone, Copy))]
pub(super) struct PointGradient {
    pub position: V3,
    pub geometric: V3,
    pub shading: ShadingGradient,
}

#[cube]
pub(super) fn no_point_gradient() -> PointGradient {
    let zero = splat(0.0f32.runtime());
    PointGradient {
        position: zero,
        geometric: zero,
        shading: ShadingGradient {
            geometric: zero,
            normal: zero,
            incoming: zero,
            diffuse: zero,
            specular: zero,
            exponent: 0.0f32.runtime(),
        },
    }
}

/// Derivatives by a ray.
#[derive(CubeType, CubeTypeMut, Clone, Copy, Debug)]
#[expand(derive(Clone, Copy))]
struct RayGradient {
    origin: V3,
    direction: V3,
}

#[cube]
pub(super) fn no_camera_gradient() -> CameraGradient {
    let zero = splat(0.0f32.runtime());
    CameraGradient {
        eye: zero,
        across: zero,
        upward: zero,
        forward: zero,
        lens: Pair {
            first: zero,
            second: zero,
        },
        per_focus: 0.0f32.runtime(),
    }
}

/// Adds the derivatives by the camera of some paths.
#[cube]
pub(super) fn add_camera(
    words: &[u32],
    totals: &[Atomic<u32>],
    scales: &[f32],
    g: &CameraGradient,
) {
    let first = words[FIRST_SUMS + CAMERA];
    add_vector(totals, scales, first, g.eye, CAMERA);
    add_vector(totals, scales, first + 3, g.across, CAMERA);
    add_vector(totals, scales, first + 6, g.upward, CAMERA);
    add_vector(totals, scales, first + 9, g.forward, CAMERA);
    add_vector(totals, scales, first + 12, g.lens.first, CAMERA);
    add_vector(totals, scales, first + 15, g.lens.second, CAMERA);
    add(totals, scales, first + 18, g.per_focus, CAMERA);
}

/// Adds the derivatives of g·colour by the texels of a cell; returns those by the point, in texels.
#[cube]
fn cell_backward(
    floats: &[f32],
    totals: &[Atomic<u32>],
    scales: &[f32],
    texels: u32,
    cell: Cell,
    sums: u32,
    g: V3,
    #[comptime] part: usize,
    #[comptime] wanted: bool,
) -> V2 {
    let x = cell.x;
    let y = cell.y;
    if wanted {
        let mut k = 0u32;
        while k < 4 {
            let mut texel = cell.a;
            let mut weight = (1.0 - x) * (1.0 - y);
            if k == 1 {
                texel = cell.b;
                weight = x * (1.0 - y);
            } else if k == 2 {
                texel = cell.c;
                weight = (1.0 - x) * y;
            } else if k == 3 {
                texel = cell.d;
                weight = x * y;
            }
            add_vector(totals, scales, sums + texel, g * weight, part);
            k += 1;
        }
    }
    let a = vector(floats, texels + cell.a).dot(g);
    let b = vector(floats, texels + cell.b).dot(g);
    let c = vector(floats, texels + cell.c).dot(g);
    let d = vector(floats, texels + cell.d).dot(g);
    v2(
        (1.0 - y) * (b - a) + y * (d - c),
        (1.0 - x) * (c - a) + x * (d - b),
    )
}

/// Adds the derivatives of g·radiance of the environment; returns that by the direction.
#[cube]
fn sky_backward(
    floats: &[f32],
    words: &[u32],
    totals: &[Atomic<u32>],
    scales: &[f32],
    direction: V3,
    g: V3,
    #[comptime] features: Features,
    #[comptime] of: Derivatives,
) -> V3 {
    let mut by_direction = splat(0.0);
    let first = words[FIRST_SUMS + SKY];
    if comptime!(features.sky_constant && of.sky) {
        add_vector(totals, scales, first, g, SKY);
    }
    if comptime!(features.sky_map) {
        let cell = cell_of_map(words, direction);
        let texels = words[SKY_TEXELS];
        let by = cell_backward(floats, totals, scales, texels, cell, first, g, SKY, of.sky);
        let d = direction;
        let around = (d.x * d.x + d.z * d.z).max(1e-12);
        let columns = words[SKY_WIDTH] as f32 / std::f32::consts::TAU;
        let rows = words[SKY_HEIGHT] as f32 / std::f32::consts::PI;
        by_direction = v3(-d.z, 0.0, d.x) * (by.x * columns / around)
            - v3(0.0, 1.0, 0.0) * (by.y * rows / around.sqrt());
    }
    by_direction
}

/// Adds a derivative by a point of a triangle, which moves with its corners.
#[cube]
pub(super) fn add_to_corners(
    words: &[u32],
    totals: &[Atomic<u32>],
    scales: &[f32],
    triangle: u32,
    object: u32,
    weights: V3,
    g: V3,
    time: f32,
    #[comptime] of: Derivatives,
) {
    let row = words[VERTEX_ROWS] + 3 * triangle;
    let first = words[FIRST_SUMS + VERTICES];
    let mut k = 0u32;
    while k < 3 {
        let mut weight = weights.x;
        if k == 1 {
            weight = weights.y;
        } else if k == 2 {
            weight = weights.z;
        }
        let at = first + 3 * words[(row + k) as usize];
        add_vector(totals, scales, at, g * weight, VERTICES);
        k += 1;
    }
    if comptime!(of.velocities) {
        let at = words[FIRST_SUMS + VELOCITIES] + 3 * object;
        add_vector(totals, scales, at, g * time, VELOCITIES);
    }
}

#[cube]
pub(super) fn is_wanted(words: &[u32], object: u32) -> bool {
    words[(words[WANTED_OBJECTS] + object) as usize] != 0
}

/// Adds the derivatives of g·colour by a colour of a material; returns that by the texture coordinates.
#[cube]
fn colour_backward(
    floats: &[f32],
    words: &[u32],
    totals: &[Atomic<u32>],
    scales: &[f32],
    point: &Point,
    #[comptime] channel: u32,
    g: V3,
    #[comptime] features: Features,
    #[comptime] of: Derivatives,
) -> V2 {
    let mut by_uv = v2(0.0, 0.0);
    let mut constant = true;
    if comptime!(features.textured) {
        let row = words[OF_MATERIALS] + OF_MATERIAL as u32 * point.material;
        let texture = (row + 1 + 4 * channel) as usize;
        if words[texture] != NONE {
            constant = false;
            let cell = cell_of_texture(words, texture, point.uv);
            let texels = words[TEXEL_VALUES];
            let sums = words[FIRST_SUMS + TEXELS];
            let by = cell_backward(
                floats,
                totals,
                scales,
                texels,
                cell,
                sums,
                g,
                TEXELS,
                of.materials,
            );
            by_uv = v2(
                by.x * words[texture + 1] as f32,
                -by.y * words[texture + 2] as f32,
            );
        }
    }
    if comptime!(of.materials) {
        if constant {
            let at = words[FIRST_SUMS + MATERIALS] + 12 * point.material + 3 * channel;
            add_vector(totals, scales, at, g, MATERIALS);
        }
    }
    by_uv
}

/// Adds the derivatives by texture coordinates and shading normals; returns that by the point, which each
/// corner takes less by its weight.
#[cube]
fn attributes_backward(
    floats: &[f32],
    words: &[u32],
    totals: &[Atomic<u32>],
    scales: &[f32],
    p: &Point,
    by_uv: V2,
    by_normal: V3,
    #[comptime] features: Features,
    #[comptime] of: Derivatives,
) -> V3 {
    let row = (words[OF_TRIANGLES] + OF_TRIANGLE as u32 * p.triangle) as usize;
    let mut by_b = 0.0f32;
    let mut by_c = 0.0f32;
    if comptime!(features.textured) {
        if words[row + 2] != NONE {
            let values = words[UV_VALUES];
            let a = (values + 2 * words[row + 2]) as usize;
            let b = (values + 2 * words[row + 3]) as usize;
            let c = (values + 2 * words[row + 4]) as usize;
            by_b += by_uv.x * (floats[b] - floats[a]) + by_uv.y * (floats[b + 1] - floats[a + 1]);
            by_c += by_uv.x * (floats[c] - floats[a]) + by_uv.y * (floats[c + 1] - floats[a + 1]);
            if comptime!(of.uvs) {
                let first = words[FIRST_SUMS + UVS];
                let i = first + 2 * words[row + 2];
                let j = first + 2 * words[row + 3];
                let k = first + 2 * words[row + 4];
                add(totals, scales, i, by_uv.x * p.weights.x, UVS);
                add(totals, scales, i + 1, by_uv.y * p.weights.x, UVS);
                add(totals, scales, j, by_uv.x * p.weights.y, UVS);
                add(totals, scales, j + 1, by_uv.y * p.weights.y, UVS);
                add(totals, scales, k, by_uv.x * p.weights.z, UVS);
                add(totals, scales, k + 1, by_uv.y * p.weights.z, UVS);
            }
        }
    }
    if comptime!(features.smooth) {
        if p.shading.smooth {
            let values = words[NORMAL_VALUES];
            let a = vector(floats, values + 3 * words[row + 5]);
            let b = vector(floats, values + 3 * words[row + 6]);
            let c = vector(floats, values + 3 * words[row + 7]);
            let sum = a * p.weights.x + b * p.weights.y + c * p.weights.z;
            let inverse = 1.0 / sum.length().max(1e-15);
            let unit = sum * inverse;
            let mut by_sum = by_normal.reject_from_normalized(unit) * inverse;
            if sum.dot(p.shading.geometric) < 0.0 {
                by_sum = -by_sum;
            }
            by_b += by_sum.dot(b - a);
            by_c += by_sum.dot(c - a);
            if comptime!(of.normals) {
                let first = words[FIRST_SUMS + NORMALS];
                let i = first + 3 * words[row + 5];
                let j = first + 3 * words[row + 6];
                let k = first + 3 * words[row + 7];
                add_vector(totals, scales, i, by_sum * p.weights.x, NORMALS);
                add_vector(totals, scales, j, by_sum * p.weights.y, NORMALS);
                add_vector(totals, scales, k, by_sum * p.weights.z, NORMALS);
            }
        }
    }
    let at = words[SURFACES] + SURFACE_STRIDE as u32 * p.triangle;
    let slopes = barycentric_slopes(
        vector(floats, at),
        vector(floats, at + 3),
        vector(floats, at + 6),
        vector(floats, at + 9),
        floats[at as usize + 13],
    );
    slopes.first * by_b + slopes.second * by_c
}

/// Adds the derivatives by the scene's parts of a point that has derivatives by its position, geometric normal,
/// distance and shading; returns those by the ray that hit it.
#[cube]
fn point_backward(
    floats: &[f32],
    words: &[u32],
    totals: &[Atomic<u32>],
    scales: &[f32],
    p: &Point,
    distance: f32,
    time: f32,
    by: &PointGradient,
    by_t: f32,
    #[comptime] features: Features,
    #[comptime] of: Derivatives,
) -> RayGradient {
    let shade = by.shading;
    let mut by_uv = v2(0.0, 0.0);
    if comptime!(of.materials || (of.rays && features.textured)) {
        by_uv = colour_backward(
            floats,
            words,
            totals,
            scales,
            p,
            0u32,
            shade.diffuse,
            features,
            of,
        );
        if comptime!(features.glossy) {
            if p.shading.glossy {
                let of_specular = colour_backward(
                    floats,
                    words,
                    totals,
                    scales,
                    p,
                    1u32,
                    shade.specular,
                    features,
                    of,
                );
                let by_exponent = v3(shade.exponent, 0.0, 0.0);
                let of_exponent = colour_backward(
                    floats,
                    words,
                    totals,
                    scales,
                    p,
                    2u32,
                    by_exponent,
                    features,
                    of,
                );
                by_uv.x += of_specular.x + of_exponent.x;
                by_uv.y += of_specular.y + of_exponent.y;
            }
        }
    }
    let mut by_ray = RayGradient {
        origin: splat(0.0),
        direction: splat(0.0),
    };
    if comptime!(of.rays) {
        let by_place = attributes_backward(
            floats,
            words,
            totals,
            scales,
            p,
            by_uv,
            shade.normal,
            features,
            of,
        );
        let mut by_normal = shade.geometric + by.geometric;
        if !p.shading.smooth {
            by_normal += shade.normal;
        }
        let direction = p.shading.incoming;
        // Barycentric coordinates see the point from the corners, which are where the triangle is.
        let by_point = by.position + by_place + direction * by_t;
        let front = p.shading.geometric * p.side;
        let with_plane = hit_backward(front, direction, by_point);
        if comptime!(of.objects) {
            if is_wanted(words, p.object) {
                let at = words[FIRST_SUMS + TRIANGLES] + 3 * p.triangle;
                add_vector(totals, scales, at, by_normal * p.side, TRIANGLES);
                let g = with_plane - by_place;
                add_to_corners(
                    words, totals, scales, p.triangle, p.object, p.weights, g, time, of,
                );
            }
        }
        let through = by_point - with_plane;
        by_ray.origin = through - direction * by_t;
        by_ray.direction = through * distance + shade.incoming;
    }
    by_ray
}

/// Back over light from a point of an emitter, which stays where it is on it; returns the derivative by the
/// throughput.
#[cube]
fn light_backward(
    floats: &[f32],
    words: &[u32],
    totals: &[Atomic<u32>],
    scales: &[f32],
    point: &Point,
    k: u32,
    weights: V2,
    chance: f32,
    combined: bool,
    by_scattering: bool,
    throughput: V3,
    time: f32,
    g: V3,
    by: &mut PointGradient,
    #[comptime] features: Features,
    #[comptime] of: Derivatives,
) -> V3 {
    let e = emitter(floats, words, k, time, features);
    let corners = v3(1.0 - weights.x - weights.y, weights.x, weights.y);
    let light = e.a * corners.x + e.b * corners.y + e.c * corners.z;
    let to = light - point.position;
    let squared = to.length_squared().max(1e-37);
    let inverse = 1.0 / squared.sqrt();
    let direction = to * inverse;
    let facing = -e.normal.dot(direction);
    let per_area = facing / squared * e.area;
    let reflected = point.shading.evaluate(direction);
    let mut density = chance;
    if combined {
        let other = point.shading.density(direction) * per_area;
        density = power_heuristic(chance, other, by_scattering);
    }
    let scale = per_area / density;
    let carried = g.times(throughput);
    if comptime!(of.emission) {
        let at = words[FIRST_SUMS + MATERIALS] + 12 * e.material + 9;
        let by_emission = carried.times(reflected) * scale;
        add_vector(totals, scales, at, by_emission, MATERIALS);
    }
    let by_reflected = carried.times(e.emission) * scale;
    let mut by_direction =
        point
            .shading
            .evaluate_backward(direction, by_reflected, &mut by.shading);
    if comptime!(of.rays) {
        // facing·area/r²
        let by_scale = carried.times(reflected).dot(e.emission) / density;
        let by_facing = by_scale * e.area / squared;
        by_direction -= e.normal * by_facing;
        // The length that the direction was divided by, and r².
        let by_to = (by_direction.reject_from_normalized(direction)
            - direction * (2.0 * by_facing * facing))
            * inverse;
        if comptime!(of.objects) {
            if is_wanted(words, e.object) {
                let at = words[FIRST_SUMS + AREAS] + e.triangle;
                add(totals, scales, at, by_scale * facing / squared, AREAS);
                let at = words[FIRST_SUMS + TRIANGLES] + 3 * e.triangle;
                add_vector(totals, scales, at, -(direction * by_facing), TRIANGLES);
                add_to_corners(
                    words, totals, scales, e.triangle, e.object, corners, by_to, time, of,
                );
            }
        }
        by.position -= by_to;
    }
    g.times(reflected).times(e.emission) * scale
}

/// Back over light of a map along a direction, which is fixed; returns the derivative by the throughput.
#[cube]
fn map_backward(
    floats: &[f32],
    words: &[u32],
    totals: &[Atomic<u32>],
    scales: &[f32],
    point: &Point,
    direction: V3,
    by_scattering: bool,
    throughput: V3,
    g: V3,
    by: &mut PointGradient,
    #[comptime] features: Features,
    #[comptime] of: Derivatives,
) -> V3 {
    let shading = point.shading;
    let chance = density_of_direction(floats, words, direction);
    let density = power_heuristic(chance, shading.density(direction), by_scattering);
    let reflected = shading.evaluate(direction);
    let radiance = sky(floats, words, direction, features);
    let scale = 1.0 / density;
    let carried = g.times(throughput) * scale;
    if comptime!(of.sky) {
        let by_sky = carried.times(reflected);
        sky_backward(
            floats, words, totals, scales, direction, by_sky, features, of,
        );
    }
    shading.evaluate_backward(direction, carried.times(radiance), &mut by.shading);
    g.times(reflected).times(radiance) * scale
}

/// Back along a path: adds the derivatives of the light that it brought, times `upstream`.
#[cube]
pub(super) fn path_backward(
    floats: &[f32],
    words: &[u32],
    records: &mut [u32],
    totals: &[Atomic<u32>],
    scales: &[f32],
    room: Room,
    path: Beginning,
    points: u32,
    upstream: Upstream,
    by_camera: &mut CameraGradient,
    #[comptime] features: Features,
    #[comptime] of: Derivatives,
) {
    let g = upstream.radiance;
    let numbers = path.numbers;
    let time = path.time;
    let mut by_throughput = splat(0.0);
    let mut by_origin = splat(0.0);
    let mut by_direction = splat(0.0);
    if points == 0 {
        by_direction = sky_backward(
            floats,
            words,
            totals,
            scales,
            path.ray.direction,
            g,
            features,
            of,
        );
    }
    let mut left = points;
    while left > 0 {
        left -= 1;
        let i = left;
        let triangle = records[record_at(room, i, 0u32)];
        let distance = kept(records, room, i, 1u32);
        let origin = kept_vector(records, room, i, 2u32);
        let incoming = kept_vector(records, room, i, 5u32);
        let throughput = kept_vector(records, room, i, 8u32);
        let bits = records[record_at(room, i, 11u32)];
        let near = origin + incoming * distance;
        let point = point_at(floats, words, triangle, near, incoming, time, features);
        let mut by = no_point_gradient();
        let mut by_before = splat(0.0);
        // The way on, and the light that it ended in.
        let mut drawn = path.film;
        let mut choices = path.film;
        let mut scatter = Scatter {
            direction: splat(0.0),
            weight: splat(0.0),
            local: splat(0.0),
            of_gloss: false,
            u: 0.0f32,
            v: 0.0f32,
        };
        if bits != 0 {
            drawn = numbers.direction(words, i, features.sobol);
            if comptime!(features.glossy || features.gathers_map) {
                choices = numbers.choices(words, i, features.sobol);
            }
            scatter = point.shading.sample(drawn.x, drawn.y, choices.x);
        }
        if bits & WENT_ON != 0 {
            let survival = kept(records, room, i, 12u32);
            let mut cone_u = 0.0f32;
            let mut cone_v = 0.0f32;
            if comptime!(features.cones) {
                let set = path.cones.set(words, i, features.sobol);
                cone_u = set.x;
                cone_v = set.y;
            }
            let tangent = floats[CONE];
            let geometric = point.shading.geometric;
            let bent = bend(scatter.direction, geometric, tangent, cone_u, cone_v);
            by.position += by_origin;
            let mut by_leaving = by_direction;
            let mut by_after = by_throughput;
            if bits & ESCAPED != 0 {
                let after = throughput.times(scatter.weight) * (1.0 / survival);
                by_after += g.times(sky(floats, words, bent.direction, features));
                let towards = bent.direction;
                by_leaving += sky_backward(
                    floats,
                    words,
                    totals,
                    scales,
                    towards,
                    g.times(after),
                    features,
                    of,
                );
            }
            let by_survivor = by_after * (1.0 / survival);
            by_before += by_survivor.times(scatter.weight);
            let by_axis = bend_backward(
                &bent,
                scatter.direction,
                geometric,
                by_leaving,
                &mut by.geometric,
            );
            let by_weight = by_survivor.times(throughput);
            point
                .shading
                .sample_backward(&scatter, by_weight, by_axis, &mut by.shading);
        }
        // Light that arrived.
        if comptime!(features.emitters) {
            let seen_along = (bits >> 1) & ((1u32 << MOST_ALONG) - 1);
            if bits & SAW_EMITTER != 0 || seen_along != 0 {
                let x = point.position;
                let sum = all_seen_from(floats, words, x, time, features);
                let combined = comptime!(features.combined) && point.shading.glossy;
                let mut next = 0u32;
                let mut bit = SAW_EMITTER.runtime();
                // The emitter that was drawn, then those along the way on.
                while bit < (2u32 << MOST_ALONG) && next != NONE {
                    let along = bit >= SAW_ALONG;
                    let mut k = 0u32;
                    let mut weights = v2(0.0, 0.0);
                    let mut p = 1.0f32;
                    if along {
                        let way = scatter.direction;
                        let found = next_emitter_hit(floats, words, next, x, way, time, features);
                        k = found.emitter;
                        weights = found.weights;
                        next = k;
                        if k != NONE {
                            next = k + 1;
                            p = chance(floats, words, k, x, time, sum, features);
                        }
                    } else {
                        let mut u = path.film.z;
                        let mut v = path.film.w;
                        if i > 0 {
                            let before = numbers.direction(words, i - 1, features.sobol);
                            u = before.z;
                            v = before.w;
                        }
                        let choice = choose(floats, words, u, x, time, sum, features);
                        let root = choice.rest.sqrt();
                        k = choice.emitter;
                        p = choice.chance;
                        weights = v2(root * (1.0 - v), root * v);
                    }
                    if k != NONE && bits & bit != 0 {
                        by_before += light_backward(
                            floats, words, totals, scales, &point, k, weights, p, combined, along,
                            throughput, time, g, &mut by, features, of,
                        );
                    }
                    bit *= 2;
                    if seen_along == 0 {
                        next = NONE;
                    }
                }
            }
        }
        if comptime!(features.gathers_map) {
            let mut bit = SAW_MAP.runtime();
            while bit <= SAW_MAP_ALONG {
                if bits & bit != 0 {
                    let along = bit == SAW_MAP_ALONG;
                    let mut towards = scatter.direction;
                    if !along {
                        towards = choose_direction(floats, words, choices.z, choices.w);
                    }
                    by_before += map_backward(
                        floats, words, totals, scales, &point, towards, along, throughput, g,
                        &mut by, features, of,
                    );
                }
                bit *= 2;
            }
        }
        by_throughput = by_before;
        if comptime!(of.jumps) {
            jumped(words, records, room, i, &mut by);
        }
        let mut by_t = 0.0f32;
        if i == 0 {
            by_t = upstream.depth;
            by.geometric += upstream.normal;
            if comptime!(of.emission) {
                let row = words[OF_MATERIALS] + OF_MATERIAL as u32 * point.material;
                if point.side > 0.0 && words[row as usize] & EMITS != 0 {
                    let at = words[FIRST_SUMS + MATERIALS] + 12 * point.material + 9;
                    add_vector(totals, scales, at, g, MATERIALS);
                }
            }
        }
        let by_ray = point_backward(
            floats, words, totals, scales, &point, distance, time, &by, by_t, features, of,
        );
        by_origin = by_ray.origin;
        by_direction = by_ray.direction;
    }
    if comptime!(of.camera) {
        camera(floats, features.parallel).ray_backward(
            &path.ray,
            by_origin,
            by_direction,
            by_camera,
        );
    }
}
