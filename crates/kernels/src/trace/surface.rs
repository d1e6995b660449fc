//! Surface points that rays hit: position, normals and material.

use crate::cube::*;

use super::corners::facing;
use super::parts::{COLORS, NORMALS, TANGENTS, TRIANGLES};
use super::scene::{COMPENSATED, GLOSSY, LEAST_ROUGHNESS, REFLECTS, Scene, model_in};
use super::sums::Sums;
use crate::host::BsdfKind;
use crate::model::bsdf::{Models, Shading, ShadingGradient};
use crate::model::numbers::is_nonzero;
use crate::model::triangle::{Plane, hit_backward};
use crate::model::{Pair, V2, V3, splat, v2, v3};
use crate::sampling::Receiver;

/// A surface point that a ray hit.
#[apply(zeroed!)]
pub struct Point {
    pub triangle: u32,
    pub material: u32,
    pub object: u32,
    /// Distance along the ray.
    pub distance: f32,
    /// Position at the ray's time.
    pub position: V3,
    /// Barycentric weights of the point.
    pub weights: V3,
    /// 1 if the ray came from the triangle's front, otherwise −1.
    pub side: f32,
    pub uv: V2,
    pub shading: Shading,
    /// Whether it scatters any light.
    pub reflects: bool,
    /// Whether its roughness is the least one, and not its material's.
    pub roughened: bool,
}

/// Derivatives with respect to a surface point, except those that involve its incoming ray.
#[apply(zeroed!)]
pub struct PointGradient {
    pub position: V3,
    pub geometric: V3,
    pub shading: ShadingGradient,
    /// With respect to the emitted radiance, if that is textured.
    pub emission: V3,
}

/// Derivatives with respect to a ray.
#[apply(zeroed!)]
pub struct RayGradient {
    pub origin: V3,
    pub direction: V3,
    /// The part of the ray's motion that follows the material behind it, and the derivative of this part with respect to
    /// the direction.
    pub share: f32,
    pub by_share: V3,
}

/// A point of a triangle's plane, and the side that is seen.
#[apply(zeroed!)]
pub struct OnPlane {
    position: V3,
    /// Its position at shutter open.
    pub at_rest: V3,
    side: f32,
    geometric: V3,
}

/// Returns the point near `near` of a plane that has moved by a shift, seen along a direction.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn on_plane(plane: &Plane, shift: V3, near: V3, direction: V3) -> OnPlane {
    let mut at_rest = near - shift;
    // Projected onto the plane: the distance from it is a rounding error that grows with the ray's length.
    at_rest -= plane.normal * plane.above(at_rest);
    let side = select(plane.normal.dot(direction) < 0.0, 1.0f32, -1.0f32);
    OnPlane {
        position: at_rest + shift,
        at_rest,
        side,
        geometric: plane.normal * side,
    }
}

/// A triangle that a ray hit at a distance along a direction, and its material.
#[apply(zeroed!)]
pub struct HitTriangle {
    pub triangle: u32,
    pub material: u32,
    pub object: u32,
    /// Bits of the material, and its first color if that is a constant.
    pub bits: u32,
    pub diffuse: V3,
    pub distance: f32,
    pub direction: V3,
    #[cfg_attr(feature = "gpu", cube(comptime))]
    pub models: Models,
}

/// Returns a point with its triangle's normal and a constant diffuse material, without barycentric weights.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn plain_point(on: &OnPlane, hit: &HitTriangle) -> Point {
    Point {
        triangle: hit.triangle,
        material: hit.material,
        object: hit.object,
        distance: hit.distance,
        position: on.position,
        weights: splat(0.0),
        side: on.side,
        uv: v2(0.0, 0.0),
        shading: Shading {
            geometric: on.geometric,
            normal: on.geometric,
            incoming: hit.direction,
            diffuse: hit.diffuse,
            specular: splat(0.0),
            exponent: 0.0f32.runtime(),
            glossy: false.runtime(),
            smooth: false.runtime(),
            model: 0u32.runtime(),
            compensated: false.runtime(),
            inside: on.side < 0.0,
            models: comptime!(hit.models),
            pair: Pair {
                first: on.geometric,
                second: on.geometric,
            },
            paired: false.runtime(),
            mirrored: false.runtime(),
        },
        reflects: hit.bits & REFLECTS != 0,
        roughened: false.runtime(),
    }
}

/// Returns a triangle that a ray hits, and its material.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn hit_triangle(scene: &Scene, triangle: u32, distance: f32, direction: V3) -> HitTriangle {
    let material = scene.material_of(triangle);
    HitTriangle {
        triangle,
        material,
        object: scene.object_of(triangle),
        bits: scene.bits_of(material),
        diffuse: scene.constant_of(material, 0u32),
        distance,
        direction,
        models: comptime!(scene.features.models),
    }
}

/// Returns the point near `near` of a triangle, seen along a direction from a distance at a shutter time, after `bounce`
/// bounces.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn point_at(
    scene: &Scene,
    triangle: u32,
    near: V3,
    distance: f32,
    direction: V3,
    time: f32,
    bounce: u32,
) -> Point {
    let hit = hit_triangle(scene, triangle, distance, direction);
    let shift = scene.shift(triangle, time);
    let tri = scene.triangle(triangle);
    let on = on_plane(&tri.plane(), shift, near, direction);
    let mut p = plain_point(&on, &hit);
    p.weights = tri.weights(on.at_rest);
    p.uv = scene.uv_at(triangle, p.weights);
    if comptime!(scene.features.smooth) {
        p.shading.smooth = scene.normal_rows(triangle).exist();
        p.shading.normal = scene.normal_at(triangle, p.weights, on.geometric);
    }
    if comptime!(scene.features.tilted) {
        let front = p.shading.normal * p.side;
        let at = scene.tilt_at(triangle, p.material, p.weights, p.uv, front);
        if at.exists {
            p.shading.normal = at.tilt.tilted() * p.side;
            p.shading.smooth = true;
        }
    }
    if comptime!(scene.features.textured) {
        p.shading.diffuse = scene.color(p.material, 0u32, p.uv);
    }
    if comptime!(scene.features.tinted) {
        let rows = scene.rows_of_colors(triangle);
        if rows.exist() {
            let tint = rows.of(scene.colors, 3u32).at(p.weights);
            p.shading.diffuse = p.shading.diffuse.times(tint);
        }
    }
    if comptime!(scene.features.glossy) && hit.bits & GLOSSY != 0 {
        p.shading.glossy = true;
        p.shading.specular = scene.color(p.material, 1u32, p.uv);
        p.shading.exponent = scene.color(p.material, 2u32, p.uv).x;
    }
    if comptime!(scene.features.models.has_others()) {
        p.shading.model = model_in(hit.bits);
        p.shading.compensated = hit.bits & COMPENSATED != 0;
    }
    if comptime!(scene.features.regularized) {
        p.roughened = regularize(scene, &mut p.shading, bounce);
    }
    p.shading.pair.first = p.shading.normal;
    p.shading.pair.second = p.shading.normal;
    p
}

/// Raises the roughness of a glossy surface that a path meets after `bounce` bounces to the view's least roughness. The first
/// surface of a path has its own roughness, and the inside of glass behind it has, too. Returns whether there was a change.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn regularize(scene: &Scene, shading: &mut Shading, bounce: u32) -> bool {
    let refracts = shading.inside && shading.model == const { BsdfKind::Dielectric as u32 };
    let mut changed = false;
    if shading.glossy && bounce > select(refracts, 1u32, 0u32) {
        changed = shading.roughen(scene.settings[LEAST_ROUGHNESS]);
    }
    changed
}

/// Backward pass of a surface point. Turns derivatives with respect to its position, geometric normal, distance and
/// shading into those with respect to the scene, which are added, and to the ray that hit it, which are returned.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn point_backward(
    scene: &Scene,
    sums: &Sums,
    p: &Point,
    time: f32,
    by: &PointGradient,
    by_distance: f32,
) -> RayGradient {
    let shade = by.shading;
    let mut by_uv = v2(0.0, 0.0);
    let mut by_diffuse = shade.diffuse;
    let mut by_color = splat(0.0);
    if comptime!(scene.features.tinted) {
        let rows = scene.rows_of_colors(p.triangle);
        if rows.exist() {
            by_color = by_diffuse.times(scene.color(p.material, 0u32, p.uv));
            by_diffuse = by_diffuse.times(rows.of(scene.colors, 3u32).at(p.weights));
            if comptime!(sums.of.colors) {
                rows.add(sums, p.weights, by_color, COLORS);
            }
        }
    }
    if comptime!(sums.of.materials || (sums.of.rays && scene.features.textured)) {
        let mut channels = 1u32;
        if comptime!(scene.features.glossy) && p.shading.glossy {
            channels = 3;
        }
        let mut channel = 0u32;
        while channel < channels {
            let mut g = by_diffuse;
            if channel == 1 {
                g = shade.specular;
            } else if channel == 2 {
                g = v3(select(p.roughened, 0.0, shade.exponent), 0.0, 0.0);
            }
            let wanted = comptime!(sums.of.materials);
            let more = scene.color_backward(sums, p.material, channel, p.uv, g, wanted);
            by_uv.x += more.x;
            by_uv.y += more.y;
            channel += 1;
        }
    }
    if comptime!(scene.features.glows) && !by.emission.is_zero() {
        let more = scene.emission_backward(sums, p.material, p.uv, by.emission);
        by_uv.x += more.x;
        by_uv.y += more.y;
    }
    let mut by_ray = RayGradient::default();
    if comptime!(sums.of.rays) {
        let by_corners = corners_backward(scene, sums, p, by_uv, by_color, shade.normal);
        let by_normal = by_corners.geometric + shade.geometric + by.geometric;
        let direction = p.shading.incoming;
        // Barycentric weights depend on the point relative to the corners, which move with the triangle.
        let by_point = by.position + by_corners.position + direction * by_distance;
        let with_plane = hit_backward(p.shading.geometric, direction, by_point);
        if comptime!(sums.of.objects) && scene.is_wanted(p.object) {
            sums.add_vector(3 * p.triangle, by_normal * p.side, TRIANGLES);
            let g = with_plane - by_corners.position;
            scene.add_to_corners(sums, p.triangle, p.weights, g, time);
        }
        let through = by_point - with_plane;
        by_ray.origin = through - direction * by_distance;
        by_ray.direction = through * p.distance + shade.incoming;
    }
    by_ray
}

/// Returns a point as the receiver for which emitters are chosen.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn receiver_of(point: &Point, time: f32) -> Receiver {
    Receiver {
        position: point.position,
        normal: point.shading.geometric,
        time,
    }
}

/// Backward pass of the interpolation at a surface point. Turns derivatives with respect to its texture coordinates,
/// color and shading normal into those with respect to the values at the triangle's corners and the normal map, which
/// are added. Returns the derivatives with respect to its position, of which each corner receives the negative times
/// its weight, and to its geometric normal.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn corners_backward(
    scene: &Scene,
    sums: &Sums,
    p: &Point,
    by_uv: V2,
    by_color: V3,
    by_normal: V3,
) -> PointGradient {
    // With respect to the weights of the second and third corner.
    let mut by_b = 0.0f32;
    let mut by_c = 0.0f32;
    let mut by_uv = by_uv;
    let mut by_normal = by_normal;
    if comptime!(scene.features.tilted) {
        let normal = scene.normal_at(p.triangle, p.weights, p.shading.geometric);
        let front = normal * p.side;
        let at = scene.tilt_at(p.triangle, p.material, p.weights, p.uv, front);
        if at.exists {
            let by = at.tilt.backward(by_normal * p.side);
            by_normal = by.normal * p.side;
            let wanted = comptime!(sums.of.materials);
            let more = scene.texture_backward(sums, at.map, p.uv, by.texel, wanted);
            by_uv.x += more.x;
            by_uv.y += more.y;
            let corners = at.rows.of(scene.tangents, 4u32);
            by_b += by.tangent.dot(corners.b - corners.a);
            by_c += by.tangent.dot(corners.c - corners.a);
            if comptime!(sums.of.tangents) {
                at.rows.add(sums, p.weights, by.tangent, TANGENTS);
            }
        }
    }
    if comptime!(scene.features.tinted) {
        let rows = scene.rows_of_colors(p.triangle);
        if rows.exist() {
            let corners = rows.of(scene.colors, 3u32);
            by_b += by_color.dot(corners.b - corners.a);
            by_c += by_color.dot(corners.c - corners.a);
        }
    }
    if comptime!(scene.features.textured) {
        let rows = scene.uv_rows(p.triangle);
        if rows.exist() {
            let a = scene.uv_of(rows.a);
            let b = scene.uv_of(rows.b);
            let c = scene.uv_of(rows.c);
            by_b += by_uv.x * (b.x - a.x) + by_uv.y * (b.y - a.y);
            by_c += by_uv.x * (c.x - a.x) + by_uv.y * (c.y - a.y);
            scene.add_to_uvs(sums, p.triangle, p.weights, by_uv);
        }
    }
    let mut found = PointGradient::default();
    found.geometric = by_normal;
    if comptime!(scene.features.smooth) {
        let rows = scene.normal_rows(p.triangle);
        if rows.exist() {
            let corners = rows.of(scene.normals, 3u32);
            let at = facing(corners.at(p.weights), p.shading.geometric);
            let by_sum = by_normal.reject_from_normalized(at.normal) * at.factor;
            found.geometric = splat(0.0);
            by_b += by_sum.dot(corners.b - corners.a);
            by_c += by_sum.dot(corners.c - corners.a);
            if comptime!(sums.of.normals) {
                rows.add(sums, p.weights, by_sum, NORMALS);
            }
        }
    }
    if is_nonzero(by_b) || is_nonzero(by_c) {
        let slopes = scene.triangle(p.triangle).slopes();
        found.position = slopes.first * by_b + slopes.second * by_c;
    }
    found
}
