//! Derivatives by what a surface point is made of: `KernelScene::point_backward` in a kernel of a GPU.

use burn::cubecl::{self, prelude::*};

use super::hit::vector;
use super::layout::{
    FIRST_SUMS, NONE, NORMALS as NORMAL_VALUES, OF_MATERIAL, OF_MATERIALS, OF_TRIANGLE,
    OF_TRIANGLES, SKY as SKY_TEXELS, SKY_HEIGHT, SKY_WIDTH, SURFACE_STRIDE, SURFACES,
    TEXELS as TEXEL_VALUES, UVS as UV_VALUES, VERTEX_ROWS, WANTED_OBJECTS,
};
use super::light::cell_of_map;
use super::sums::{
    MATERIALS, NORMALS, SKY, TEXELS, TRIANGLES, UVS, VELOCITIES, VERTICES, add, add_vector,
};
use super::surface::{Cell, Point, cell_of_texture};
use super::{Derivatives, Features};
use crate::model::bsdf::ShadingGradient;
use crate::model::triangle::{barycentric_slopes, hit_backward};
use crate::model::{V2, V3, splat, v2, v3};

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
pub(super) struct RayGradient {
    pub origin: V3,
    pub direction: V3,
}

/// Adds the derivatives of g·colour by the texels of a cell; returns those by the point, in texels.
#[cube]
pub(super) fn cell_backward(
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
pub(super) fn sky_backward(
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
pub(super) fn colour_backward(
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
pub(super) fn attributes_backward(
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
pub(super) fn point_backward(
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
