//! Boundary terms of primary rays: jumps of the image at an edge on the film.

use crate::cube::*;

use super::edge_points::{EdgePoint, add_to_edge, edge_of, sides};
use super::edge_sides::{Approach, LightBeside};
use super::following::Origin;
use super::numbers::{Exposure, NO_PIXEL, OF_EDGES, sampler};
use super::pixel::Seen;
use super::scene::Scene;
use super::sums::{Sums, add_to_camera};
use crate::model::camera::{Camera, CameraGradient};
use crate::model::filter::film_kernel;
use crate::model::numbers::{is_finite, is_nonzero};
use crate::model::segment::OnSegment;
use crate::model::{V2, V3, v2};
use crate::sampling::Dimensions;

/// A point of an edge, as the camera sees it through a lens point.
#[apply(record!)]
pub struct FilmPoint {
    pub point: EdgePoint,
    /// Origin of the ray to it.
    pub origin: V3,
    pub lens: V2,
    /// Whether it exists and is in front of the camera.
    pub is_seen: bool,
    /// A point of the pixel filter, relative to its radius, and the film point in pixels whose ray would reach the
    /// edge's point.
    kernel: V2,
    pub film: V2,
    /// The image of the vector along the edge.
    along: V2,
}

/// Returns the film point, in pixels, at the center of a pixel.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn middle_of(scene: &Scene, pixel: u32) -> V2 {
    let width = scene.width;
    v2((pixel % width) as f32 + 0.5, (pixel / width) as f32 + 0.5)
}

/// Returns a sampled point of an edge, one of `count` samples.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn film_point(
    scene: &Scene,
    c: &Camera,
    edge: u32,
    on: OnSegment,
    count: u32,
    at: &Exposure,
) -> FilmPoint {
    let lens = at.lens;
    let mut p = edge_of(scene, edge, at.time);
    p.lambda = on.lambda;
    p.per_density = on.per_density / count as f32;
    p.position = p.a + p.along * on.lambda + scene.shift(p.faces.a, at.time);
    let origin = c.origin_towards(p.position, lens.x, lens.y);
    p.to = p.position - origin;
    FilmPoint {
        point: p,
        origin,
        lens,
        is_seen: p.exists && p.to.dot(c.dual.z) > 0.0,
        kernel: v2(0.0, 0.0),
        film: v2(0.0, 0.0),
        along: v2(0.0, 0.0),
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl FilmPoint {
    /// Chooses the film point of a sample, from whose pixel a ray would reach the edge's point. `radius` is the
    /// radius of the pixel filter.
    #[inline(always)]
    pub fn project(&mut self, scene: &Scene, c: &Camera, sample: u32, radius: f32) {
        let numbers = sampler(scene, OF_EDGES).stream(NO_PIXEL, sample);
        let drawn = numbers.draw(scene.points, Dimensions::of_set(0u32));
        let at = c.project(self.point.position, self.lens.x, self.lens.y);
        self.kernel = v2(film_kernel(drawn.x), film_kernel(drawn.y));
        self.film = v2(at.x - radius * self.kernel.x, at.y - radius * self.kernel.y);
    }

    /// Returns the ray to the edge's point.
    #[inline(always)]
    pub fn approach(&mut self, scene: &Scene, c: &Camera, time: f32) -> Approach {
        let p = self.point;
        let view = p.to.normalize();
        self.along = c.project_along(p.position, p.along, self.lens.x, self.lens.y);
        // To the right of the edge's image, on a film whose y points down.
        let side = c.across * self.along.y + c.upward * self.along.x;
        Approach {
            point: p,
            origin: self.origin,
            view,
            sides: sides(scene, &p, view, side, time),
            follows: scene.follows_on_film(),
            from: Origin {
                on_film: true.runtime(),
                evenly: false.runtime(),
            },
        }
    }

    /// Adds the derivatives due to the jump of a loss that depends on what is seen by `g`. Returns the largest component of
    /// the derivative with respect to the edge's point.
    #[inline(always)]
    pub fn backward(
        &self,
        scene: &Scene,
        sums: &Sums,
        c: &Camera,
        g: &Seen,
        light: &LightBeside,
        time: f32,
    ) -> f32 {
        let mut by_camera = CameraGradient::default();
        let per_density = self.point.per_density;
        let per_jump = v2(self.along.y * per_density, -self.along.x * per_density);
        let lens = self.lens;
        let jump = g.jump(&light.jump);
        let mut largest = 0.0f32;
        let mut spreads = jump;
        if comptime!(scene.features.follows_on_film()) {
            let mut side = 0u32;
            while side < 2 {
                let mut on = light.minus;
                if side == 1 {
                    on = light.plus;
                }
                let follows = g.jump(&on.light);
                if is_nonzero(follows) && is_finite(follows) {
                    spreads -= follows;
                    let by_film = v2(-per_jump.x * follows, -per_jump.y * follows);
                    let by_point =
                        c.project_backward(on.near, lens.x, lens.y, by_film, &mut by_camera);
                    scene.add_to_point(sums, on.triangle, on.near, by_point, time);
                    largest = by_point.abs().max_element();
                }
                side += 1;
            }
        }
        let by_film = v2(per_jump.x * jump, per_jump.y * jump);
        let size = jump * per_density;
        if is_nonzero(size) && is_finite(size) {
            let at = self.point.position;
            let by_point = c.project_backward(at, lens.x, lens.y, by_film, &mut by_camera);
            add_to_edge(scene, sums, &self.point, by_point, time);
            largest = max(largest, by_point.abs().max_element());
        }
        if comptime!(sums.of.camera) && largest > 0.0 {
            // A wider filter moves its points away from the center, past the edge.
            let across = per_jump.x * self.kernel.x + per_jump.y * self.kernel.y;
            by_camera.filter -= across * spreads;
            add_to_camera(sums, &by_camera);
        }
        largest
    }
}
