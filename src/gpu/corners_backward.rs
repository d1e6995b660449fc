//! Derivatives by what is interpolated between corners: `kernel/corners` in a kernel of a GPU.

use burn::cubecl::{self, prelude::*};

use super::corners::{Corners, corners_of, normal_at, normal_rows, tilt_at, uv_rows};
use super::layout::{
    COLOUR_ROWS, COLOURS as COLOUR_VALUES, FIRST_SUMS, NONE, NORMALS as NORMAL_VALUES,
    SURFACE_STRIDE, SURFACES, TANGENTS as TANGENT_VALUES, UVS as UV_VALUES,
};
use super::reading::vector;
use super::sums::{NORMALS, TANGENTS, add_vector, component};
use super::surface::Point;
use super::texture_backward::{add_to_uvs, texture_backward};
use super::{Derivatives, Features};
use crate::model::triangle::barycentric_slopes;
use crate::model::{V2, V3, splat};

/// Derivatives by a surface point, which each corner takes less by its weight, and by its geometric normal.
#[derive(CubeType, CubeTypeMut, Clone, Copy, Debug)]
#[expand(derive(Clone, Copy))]
pub(super) struct CornersGradient {
    pub place: V3,
    pub geometric: V3,
}

/// Adds a derivative by an interpolated vector to those by the vectors at a triangle's corners.
#[cube]
pub(super) fn add_to_rows(
    words: &[u32],
    totals: &[Atomic<u32>],
    scales: &[f32],
    rows: usize,
    weights: V3,
    g: V3,
    #[comptime] part: usize,
) {
    let mut k = 0u32;
    while k < 3 {
        let at = words[FIRST_SUMS + part] + 3 * words[rows + k as usize];
        add_vector(totals, scales, at, g * component(weights, k), part);
        k += 1;
    }
}

/// Adds the derivatives by a surface point's texture coordinates, colour and shading normal to those of the values
/// at its triangle's corners and of its normal map.
#[cube]
pub(super) fn corners_backward(
    floats: &[f32],
    words: &[u32],
    totals: &[Atomic<u32>],
    scales: &[f32],
    p: &Point,
    by_uv: V2,
    by_colour: V3,
    by_normal: V3,
    #[comptime] features: Features,
    #[comptime] of: Derivatives,
) -> CornersGradient {
    let mut by_b = 0.0f32;
    let mut by_c = 0.0f32;
    let mut by_uv = by_uv;
    let mut by_normal = by_normal;
    if comptime!(features.tilted) {
        let geometric = p.shading.geometric;
        let smooth = comptime!(features.smooth);
        let normal = normal_at(floats, words, p.triangle, p.weights, geometric, smooth);
        let front = normal * p.side;
        let at = tilt_at(
            floats, words, p.triangle, p.material, p.weights, p.uv, front,
        );
        if at.exists {
            let by = at.tilt.backward(by_normal * p.side);
            by_normal = by.normal * p.side;
            let wanted = comptime!(of.materials);
            let more = texture_backward(
                floats, words, totals, scales, at.map, p.uv, by.texel, wanted,
            );
            by_uv.x += more.x;
            by_uv.y += more.y;
            let list = words[TANGENT_VALUES];
            let corners: Corners = corners_of(floats, words, list, at.rows, 4u32);
            by_b += by.tangent.dot(corners.b - corners.a);
            by_c += by.tangent.dot(corners.c - corners.a);
            if comptime!(of.tangents) {
                add_to_rows(
                    words, totals, scales, at.rows, p.weights, by.tangent, TANGENTS,
                );
            }
        }
    }
    if comptime!(features.tinted) {
        let rows = (words[COLOUR_ROWS] + 3 * p.triangle) as usize;
        if words[rows] != NONE {
            let list = words[COLOUR_VALUES];
            let corners: Corners = corners_of(floats, words, list, rows, 3u32);
            by_b += by_colour.dot(corners.b - corners.a);
            by_c += by_colour.dot(corners.c - corners.a);
        }
    }
    if comptime!(features.textured) {
        let rows = uv_rows(words, p.triangle);
        if words[rows] != NONE {
            let values = words[UV_VALUES];
            let a = (values + 2 * words[rows]) as usize;
            let b = (values + 2 * words[rows + 1]) as usize;
            let c = (values + 2 * words[rows + 2]) as usize;
            by_b += by_uv.x * (floats[b] - floats[a]) + by_uv.y * (floats[b + 1] - floats[a + 1]);
            by_c += by_uv.x * (floats[c] - floats[a]) + by_uv.y * (floats[c + 1] - floats[a + 1]);
            add_to_uvs(
                words, totals, scales, p.triangle, p.weights, by_uv, features, of,
            );
        }
    }
    let mut by_geometric = by_normal;
    if comptime!(features.smooth) {
        let rows = normal_rows(words, p.triangle);
        if words[rows] != NONE {
            let list = words[NORMAL_VALUES];
            let corners: Corners = corners_of(floats, words, list, rows, 3u32);
            let sum = corners.at(p.weights);
            let inverse = 1.0 / sum.length().max(1e-15);
            let unit = sum * inverse;
            let mut by_sum = by_normal.reject_from_normalized(unit) * inverse;
            if sum.dot(p.shading.geometric) < 0.0 {
                by_sum = -by_sum;
            }
            by_geometric = splat(0.0);
            by_b += by_sum.dot(corners.b - corners.a);
            by_c += by_sum.dot(corners.c - corners.a);
            if comptime!(of.normals) {
                add_to_rows(words, totals, scales, rows, p.weights, by_sum, NORMALS);
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
    CornersGradient {
        place: slopes.first * by_b + slopes.second * by_c,
        geometric: by_geometric,
    }
}
