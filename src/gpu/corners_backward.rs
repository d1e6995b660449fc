//! Derivatives by what is interpolated between corners: `kernel/corners` in a kernel of a GPU.

use crate::cube::*;

use super::corners::{Corners, corners_of, normal_at, normal_rows, tilt_at, uv_rows};
use super::layout::{
    COLOUR_ROWS, COLOURS as COLOUR_VALUES, FIRST_SUMS, NONE, NORMALS as NORMAL_VALUES,
    SURFACE_STRIDE, SURFACES, TANGENTS as TANGENT_VALUES, UVS as UV_VALUES,
};
use super::reading::Scene;
use super::sums::{NORMALS, TANGENTS, Totals, component};
use super::surface::Point;
use super::texture_backward::{add_to_uvs, texture_backward};
use crate::model::triangle::barycentric_slopes;
use crate::model::{V2, V3, splat};

/// Derivatives by a surface point, which each corner takes less by its weight, and by its geometric normal.
#[apply(record!)]
pub(super) struct CornersGradient {
    pub place: V3,
    pub geometric: V3,
}

/// Adds a derivative by an interpolated vector to those by the vectors at a triangle's corners.
#[cube]
pub(super) fn add_to_rows(
    scene: &Scene,
    sums: &Totals,
    rows: usize,
    weights: V3,
    g: V3,
    #[comptime] part: usize,
) {
    let mut k = 0u32;
    while k < 3 {
        let at = scene.header[FIRST_SUMS + part] + 3 * scene.words[rows + k as usize];
        sums.add_vector(at, g * component(weights, k), part);
        k += 1;
    }
}

/// Adds the derivatives by a surface point's texture coordinates, colour and shading normal to those of the values
/// at its triangle's corners and of its normal map.
#[cube]
pub(super) fn corners_backward(
    scene: &Scene,
    sums: &Totals,
    p: &Point,
    by_uv: V2,
    by_colour: V3,
    by_normal: V3,
) -> CornersGradient {
    let mut by_b = 0.0f32;
    let mut by_c = 0.0f32;
    let mut by_uv = by_uv;
    let mut by_normal = by_normal;
    if comptime!(scene.features.tilted) {
        let geometric = p.shading.geometric;
        let normal = normal_at(scene, p.triangle, p.weights, geometric);
        let front = normal * p.side;
        let at = tilt_at(scene, p.triangle, p.material, p.weights, p.uv, front);
        if at.exists {
            let by = at.tilt.backward(by_normal * p.side);
            by_normal = by.normal * p.side;
            let wanted = comptime!(sums.of.materials);
            let more = texture_backward(scene, sums, at.map, p.uv, by.texel, wanted);
            by_uv.x += more.x;
            by_uv.y += more.y;
            let list = scene.header[TANGENT_VALUES];
            let corners: Corners = corners_of(scene, list, at.rows, 4u32);
            by_b += by.tangent.dot(corners.b - corners.a);
            by_c += by.tangent.dot(corners.c - corners.a);
            if comptime!(sums.of.tangents) {
                add_to_rows(scene, sums, at.rows, p.weights, by.tangent, TANGENTS);
            }
        }
    }
    if comptime!(scene.features.tinted) {
        let rows = (scene.header[COLOUR_ROWS] + 3 * p.triangle) as usize;
        if scene.words[rows] != NONE {
            let list = scene.header[COLOUR_VALUES];
            let corners: Corners = corners_of(scene, list, rows, 3u32);
            by_b += by_colour.dot(corners.b - corners.a);
            by_c += by_colour.dot(corners.c - corners.a);
        }
    }
    if comptime!(scene.features.textured) {
        let rows = uv_rows(scene, p.triangle);
        if scene.words[rows] != NONE {
            let values = scene.header[UV_VALUES];
            let a = (values + 2 * scene.words[rows]) as usize;
            let b = (values + 2 * scene.words[rows + 1]) as usize;
            let c = (values + 2 * scene.words[rows + 2]) as usize;
            by_b += by_uv.x * (scene.floats[b] - scene.floats[a])
                + by_uv.y * (scene.floats[b + 1] - scene.floats[a + 1]);
            by_c += by_uv.x * (scene.floats[c] - scene.floats[a])
                + by_uv.y * (scene.floats[c + 1] - scene.floats[a + 1]);
            add_to_uvs(scene, sums, p.triangle, p.weights, by_uv);
        }
    }
    let mut by_geometric = by_normal;
    if comptime!(scene.features.smooth) {
        let rows = normal_rows(scene, p.triangle);
        if scene.words[rows] != NONE {
            let list = scene.header[NORMAL_VALUES];
            let corners: Corners = corners_of(scene, list, rows, 3u32);
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
            if comptime!(sums.of.normals) {
                add_to_rows(scene, sums, rows, p.weights, by_sum, NORMALS);
            }
        }
    }
    let at = scene.header[SURFACES] + SURFACE_STRIDE as u32 * p.triangle;
    let slopes = barycentric_slopes(
        scene.vector(at),
        scene.vector(at + 3),
        scene.vector(at + 6),
        scene.vector(at + 9),
        scene.floats[at as usize + 13],
    );
    CornersGradient {
        place: slopes.first * by_b + slopes.second * by_c,
        geometric: by_geometric,
    }
}
