//! Derivatives by what a surface point is made of: `KernelScene::point_backward` in a kernel of a GPU.

use crate::cube::*;

use super::corners::{Corners, corners_of};
use super::corners_backward::{add_to_rows, corners_backward};
use super::layout::{
    COLOUR_ROWS, COLOURS, FIRST_SUMS, NONE, SKY as SKY_TEXELS, VERTEX_ROWS, WANTED_OBJECTS,
};
use super::light::map_of;
use super::reading::Scene;
use super::sums::{COLOURS as COLOUR_SUMS, SKY, TRIANGLES, Totals, VELOCITIES, VERTICES};
use super::surface::Point;
use super::texture::{EMISSION, colour};
use super::texture_backward::{cell_backward, colour_backward};
use crate::model::bsdf::ShadingGradient;
use crate::model::triangle::hit_backward;
use crate::model::{V3, splat, v2, v3};

/// Derivatives by a surface point, but for those that its incoming ray takes part in.
#[apply(record!)]
pub(super) struct PointGradient {
    pub position: V3,
    pub geometric: V3,
    pub shading: ShadingGradient,
    /// By the radiance that it emits, where that is a texture.
    pub emission: V3,
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
        emission: zero,
    }
}

/// Derivatives by a ray.
#[apply(record!)]
pub(super) struct RayGradient {
    pub origin: V3,
    pub direction: V3,
}

/// Adds the derivatives of g·radiance of the environment; returns that by the direction.
#[cube]
pub(super) fn sky_backward(scene: &Scene, sums: &Totals, direction: V3, g: V3) -> V3 {
    let mut by_direction = splat(0.0);
    if comptime!(scene.features.sky_constant && sums.of.sky) {
        sums.add_vector(scene.header[FIRST_SUMS + SKY], g, SKY);
    }
    if comptime!(scene.features.sky_map) {
        let map = map_of(scene);
        let (cell, texels) = (map.cell(direction), scene.header[SKY_TEXELS]);
        let by = cell_backward(scene, sums, texels, cell, g, SKY, sums.of.sky);
        by_direction = map.by_direction(direction, by);
    }
    by_direction
}

/// Adds a derivative by a point of a triangle, which moves with its corners.
#[cube]
pub(super) fn add_to_corners(
    scene: &Scene,
    sums: &Totals,
    triangle: u32,
    object: u32,
    weights: V3,
    g: V3,
    time: f32,
) {
    let rows = (scene.header[VERTEX_ROWS] + 3 * triangle) as usize;
    add_to_rows(scene, sums, rows, weights, g, VERTICES);
    if comptime!(sums.of.velocities) {
        let at = scene.header[FIRST_SUMS + VELOCITIES] + 3 * object;
        sums.add_vector(at, g * time, VELOCITIES);
    }
}

#[cube]
pub(super) fn is_wanted(scene: &Scene, object: u32) -> bool {
    scene.words[(scene.header[WANTED_OBJECTS] + object) as usize] != 0
}

/// Adds the derivatives by the scene's parts of a point that has derivatives by its position, geometric normal,
/// distance and shading; returns those by the ray that hit it.
#[cube]
pub(super) fn point_backward(
    scene: &Scene,
    sums: &Totals,
    p: &Point,
    distance: f32,
    time: f32,
    by: &PointGradient,
    by_t: f32,
) -> RayGradient {
    let shade = by.shading;
    let mut by_uv = v2(0.0, 0.0);
    let mut by_diffuse = shade.diffuse;
    let mut by_colour = splat(0.0);
    let textured = comptime!(scene.features.textured);
    if comptime!(scene.features.tinted) {
        let rows = (scene.header[COLOUR_ROWS] + 3 * p.triangle) as usize;
        if scene.words[rows] != NONE {
            let corners: Corners = corners_of(scene, scene.header[COLOURS], rows, 3u32);
            let albedo = colour(scene, p.material, 0u32, p.uv, textured);
            by_colour = by_diffuse.times(albedo);
            by_diffuse = by_diffuse.times(corners.at(p.weights));
            if comptime!(sums.of.colours) {
                let part = comptime!(COLOUR_SUMS);
                add_to_rows(scene, sums, rows, p.weights, by_colour, part);
            }
        }
    }
    if comptime!(sums.of.materials || (sums.of.rays && scene.features.textured)) {
        let mut channels = 1u32;
        if comptime!(scene.features.glossy) {
            if p.shading.glossy {
                channels = 3;
            }
        }
        let mut channel = 0u32;
        while channel < channels {
            let mut g = by_diffuse;
            if channel == 1 {
                g = shade.specular;
            } else if channel == 2 {
                g = v3(shade.exponent, 0.0, 0.0);
            }
            let more = colour_backward(
                scene,
                sums,
                p.material,
                channel,
                p.uv,
                g,
                textured,
                sums.of.materials,
            );
            by_uv.x += more.x;
            by_uv.y += more.y;
            channel += 1;
        }
    }
    if comptime!(scene.features.glows) {
        if !by.emission.is_zero() {
            let more = colour_backward(
                scene,
                sums,
                p.material,
                EMISSION,
                p.uv,
                by.emission,
                true,
                sums.of.emission,
            );
            by_uv.x += more.x;
            by_uv.y += more.y;
        }
    }
    let mut by_ray = RayGradient {
        origin: splat(0.0),
        direction: splat(0.0),
    };
    if comptime!(sums.of.rays) {
        let by_corners = corners_backward(scene, sums, p, by_uv, by_colour, shade.normal);
        let by_place = by_corners.place;
        let by_normal = by_corners.geometric + shade.geometric + by.geometric;
        let direction = p.shading.incoming;
        // Barycentric coordinates see the point from the corners, which are where the triangle is.
        let by_point = by.position + by_place + direction * by_t;
        let front = p.shading.geometric * p.side;
        let with_plane = hit_backward(front, direction, by_point);
        if comptime!(sums.of.objects) {
            if is_wanted(scene, p.object) {
                let at = scene.header[FIRST_SUMS + TRIANGLES] + 3 * p.triangle;
                sums.add_vector(at, by_normal * p.side, TRIANGLES);
                let g = with_plane - by_place;
                add_to_corners(scene, sums, p.triangle, p.object, p.weights, g, time);
            }
        }
        let through = by_point - with_plane;
        by_ray.origin = through - direction * by_t;
        by_ray.direction = through * distance + shade.incoming;
    }
    by_ray
}
