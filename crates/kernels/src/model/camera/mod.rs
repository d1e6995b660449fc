//! A camera: rays through film points, projection of points onto the film, and derivatives of both.
//!
//! A film point (x, y), in halves of the image height about the image center with y up, is seen along x·across +
//! y·upward + forward from the eye. With parallel rays it is seen along forward from eye + x·across + y·upward. The
//! three vectors form any basis, so they include the field of view, the principal point and non-square pixels.
//! Projection uses the inverse of the basis.

mod host;
#[cfg(test)]
mod tests;

use super::filter::filter_by_radius;
#[cfg(feature = "gpu")]
use super::lists::vector;
use super::{Pair, V2, V3, splat, v2, v3};
use crate::cube::*;
pub use host::HostCamera;

/// A camera in internal units of a scene.
#[apply(zeroed!)]
pub struct Camera {
    pub eye: V3,
    pub across: V3,
    pub upward: V3,
    pub forward: V3,
    /// Rows of the inverse of (across, upward, forward).
    pub dual: Dual,
    /// Axes of the lens, as long as its radius; 0 for a pinhole.
    pub lens: Pair,
    /// Radius of the lens.
    pub aperture: f32,
    /// 1 over the distance of the focal plane, 0 for a pinhole.
    pub per_focus: f32,
    pub parallel: bool,
    /// In pixels.
    pub width: f32,
    pub height: f32,
    /// Radius of the pixel filter in pixels if it is due to a ray cone, whose constant angle makes it change with the
    /// field of view; otherwise 0.
    pub filter: f32,
}

/// Rows of the inverse of a basis.
#[apply(zeroed!)]
pub struct Dual {
    pub x: V3,
    pub y: V3,
    pub z: V3,
}

/// Derivatives with respect to the fields of [`Camera`].
#[apply(zeroed!)]
pub struct CameraGradient {
    pub eye: V3,
    pub across: V3,
    pub upward: V3,
    pub forward: V3,
    pub lens: Pair,
    pub per_focus: f32,
    /// With respect to the filter radius.
    pub filter: f32,
}

/// A ray from a lens point (on the unit disk) through a film point.
#[apply(zeroed!)]
pub struct CameraRay {
    pub origin: V3,
    pub direction: V3,
    /// Length of the direction before normalization.
    pub length: f32,
    /// Film point in halves of the image height, (0, 0) at the center, y up.
    pub x: f32,
    pub y: f32,
    pub lens_x: f32,
    pub lens_y: f32,
}

#[cfg_attr(feature = "gpu", cube)]
impl Camera {
    /// Returns the ray through a film point in pixels.
    #[inline(always)]
    pub fn ray(&self, x: f32, y: f32, lens_x: f32, lens_y: f32) -> CameraRay {
        let film_x = (2.0 * x - self.width) / self.height;
        let film_y = 1.0 - 2.0 * y / self.height;
        let beside = self.across * film_x + self.upward * film_y;
        let mut origin = self.eye + beside;
        let mut along = self.forward;
        if !self.parallel {
            let on_lens = self.lens_point(lens_x, lens_y);
            origin = self.eye + on_lens;
            along = beside + self.forward - on_lens * self.per_focus;
        }
        let length = along.length();
        CameraRay {
            origin,
            direction: along * (1.0 / length),
            length,
            x: film_x,
            y: film_y,
            lens_x,
            lens_y,
        }
    }

    /// Returns the lens point relative to the lens center.
    #[inline(always)]
    pub fn lens_point(&self, lens_x: f32, lens_y: f32) -> V3 {
        self.lens.first * lens_x + self.lens.second * lens_y
    }

    /// Adds the derivatives of g_o·origin + g_d·direction of a ray; `pixel` is the center of its pixel.
    #[inline(always)]
    pub fn ray_backward(
        &self,
        ray: &CameraRay,
        pixel: V2,
        g_o: V3,
        g_d: V3,
        gradient: &mut CameraGradient,
    ) {
        let by_along = g_d.reject_from_normalized(ray.direction) * (1.0 / ray.length);
        let mut by_beside = g_o;
        if !self.parallel {
            by_beside = by_along;
            let by_lens = g_o - by_along * self.per_focus;
            gradient.lens.first += by_lens * ray.lens_x;
            gradient.lens.second += by_lens * ray.lens_y;
            gradient.per_focus -= by_along.dot(self.lens_point(ray.lens_x, ray.lens_y));
        }
        if self.filter > 0.0 {
            let at = self.film_point(ray);
            let by_film = self.film_backward(ray, g_o, g_d);
            gradient.filter += by_film.x * filter_by_radius(at.x - pixel.x, self.filter)
                + by_film.y * filter_by_radius(at.y - pixel.y, self.filter);
        }
        gradient.eye += g_o;
        gradient.across += by_beside * ray.x;
        gradient.upward += by_beside * ray.y;
        gradient.forward += by_along;
    }

    /// Returns a ray's film point in pixels.
    #[inline(always)]
    pub fn film_point(&self, ray: &CameraRay) -> V2 {
        let x = 0.5 * (self.width + ray.x * self.height);
        v2(x, 0.5 * (1.0 - ray.y) * self.height)
    }

    /// Returns the derivative of g_o·origin + g_d·direction of a ray with respect to its film point in pixels.
    #[inline(always)]
    pub fn film_backward(&self, ray: &CameraRay, g_o: V3, g_d: V3) -> V2 {
        let mut by_beside = g_o;
        if !self.parallel {
            by_beside = g_d.reject_from_normalized(ray.direction) * (1.0 / ray.length);
        }
        let scale = 2.0 / self.height;
        v2(
            by_beside.dot(self.across) * scale,
            -by_beside.dot(self.upward) * scale,
        )
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Camera {
    /// Returns the coordinates of a vector in the camera's basis; the third is the depth.
    #[inline(always)]
    pub fn local(&self, r: V3) -> V3 {
        v3(self.dual.x.dot(r), self.dual.y.dot(r), self.dual.z.dot(r))
    }

    /// Returns the origin of the ray from a lens point to a point in space.
    #[inline(always)]
    pub fn origin_towards(&self, point: V3, lens_x: f32, lens_y: f32) -> V3 {
        let mut origin = self.eye + self.lens_point(lens_x, lens_y);
        if self.parallel {
            origin = point - self.forward * self.dual.z.dot(point - self.eye);
        }
        origin
    }

    /// Returns 1 over the divisor of a point's coordinates.
    #[inline(always)]
    pub fn per_depth(&self, depth: f32) -> f32 {
        let mut inverse = 1.0f32;
        if !self.parallel {
            inverse = 1.0 / depth;
        }
        inverse
    }

    /// Returns the film point, in pixels, that sees a point in space from a lens point. The depth must be positive.
    #[inline(always)]
    pub fn project(&self, point: V3, lens_x: f32, lens_y: f32) -> V2 {
        let lens = self.lens_point(lens_x, lens_y);
        let r = self.local(point - self.eye - lens);
        let inverse = self.per_depth(r.z);
        let x = r.x * inverse + self.dual.x.dot(lens) * self.per_focus;
        let y = r.y * inverse + self.dual.y.dot(lens) * self.per_focus;
        V2 {
            x: 0.5 * (self.width + x * self.height),
            y: 0.5 * (1.0 - y) * self.height,
        }
    }

    /// Returns the vector by which the film point moves, in pixels, while the point in space moves along a vector.
    #[inline(always)]
    pub fn project_along(&self, point: V3, along: V3, lens_x: f32, lens_y: f32) -> V2 {
        let r = self.local(point - self.eye - self.lens_point(lens_x, lens_y));
        let inverse = self.per_depth(r.z);
        let moved = self.local(along);
        let mut nearer = 0.0f32;
        if !self.parallel {
            nearer = moved.z * inverse;
        }
        let scale = 0.5 * self.height * inverse;
        v2(
            (moved.x - r.x * nearer) * scale,
            -(moved.y - r.y * nearer) * scale,
        )
    }

    /// Adds the derivatives of g·(film point in pixels), and returns the one with respect to the point in space.
    #[inline(always)]
    pub fn project_backward(
        &self,
        point: V3,
        lens_x: f32,
        lens_y: f32,
        g: V2,
        gradient: &mut CameraGradient,
    ) -> V3 {
        let lens = self.lens_point(lens_x, lens_y);
        let r = self.local(point - self.eye - lens);
        let inverse = self.per_depth(r.z);
        let g_x = 0.5 * self.height * g.x;
        let g_y = -0.5f32 * self.height * g.y;
        let a = g_x * inverse;
        let b = g_y * inverse;
        let mut c = 0.0f32;
        if !self.parallel {
            c = -(a * r.x + b * r.y) * inverse;
        }
        // The coordinates are the inverse basis times a vector. They change with a basis vector by minus the inverse
        // times its change, times the coordinate.
        let by_r = self.dual.x * a + self.dual.y * b + self.dual.z * c;
        let by_shift = (self.dual.x * g_x + self.dual.y * g_y) * self.per_focus;
        let on_lens = self.local(lens);
        gradient.across -= by_r * r.x + by_shift * on_lens.x;
        gradient.upward -= by_r * r.y + by_shift * on_lens.y;
        gradient.forward -= by_r * r.z + by_shift * on_lens.z;
        gradient.eye -= by_r;
        let by_lens = by_shift - by_r;
        gradient.lens.first += by_lens * lens_x;
        gradient.lens.second += by_lens * lens_y;
        gradient.per_focus += g_x * on_lens.x + g_y * on_lens.y;
        by_r
    }

    /// Adds the derivatives of g · log A, with A the area on the film of a part of a surface with a unit normal, per its own
    /// area. Returns the derivative with respect to its point; that with respect to the normal is g d/(n·d), with d the
    /// direction of the ray.
    #[inline(always)]
    pub fn area_backward(
        &self,
        ray: &CameraRay,
        point: V3,
        normal: V3,
        g: f32,
        gradient: &mut CameraGradient,
    ) -> V3 {
        // A is |n·d| / z³ times the determinant of the inverse basis, with z the depth and d from the lens point; for
        // parallel rays |n·forward| times this determinant.
        gradient.across -= self.dual.x * g;
        gradient.upward -= self.dual.y * g;
        gradient.forward -= self.dual.z * g;
        let mut by_point = splat(0.0);
        if self.parallel {
            gradient.forward += normal * (g / normal.dot(self.forward));
        } else {
            let d = point - ray.origin;
            let r = self.local(d);
            let by_depth = self.dual.z * (-3.0f32 * g / r.z);
            gradient.across -= by_depth * r.x;
            gradient.upward -= by_depth * r.y;
            gradient.forward -= by_depth * r.z;
            by_point = normal * (g / normal.dot(d)) + by_depth;
            gradient.eye -= by_point;
            gradient.lens.first -= by_point * ray.lens_x;
            gradient.lens.second -= by_point * ray.lens_y;
        }
        by_point
    }
}

/// Number of floats of a camera in a list.
pub const NUMBERS: usize = 32;

impl Camera {
    /// Returns the camera's floats in a list.
    pub fn numbers(&self) -> [f32; NUMBERS] {
        let (lens, dual) = (&self.lens, &self.dual);
        let basis = [self.eye, self.across, self.upward, self.forward];
        let others = [lens.first, lens.second, dual.x, dual.y, dual.z];
        let mut numbers = [self.per_focus; NUMBERS];
        for (to, v) in numbers
            .chunks_exact_mut(3)
            .zip(basis.into_iter().chain(others))
        {
            to.copy_from_slice(&v.to_array());
        }
        let others = [self.width, self.height, self.filter, self.aperture];
        numbers[28..].copy_from_slice(&others);
        numbers
    }
}

/// Reads the camera at the start of a list.
#[cfg(feature = "gpu")]
#[cube]
pub fn camera_at(list: &[f32], parallel: bool) -> Camera {
    Camera {
        eye: vector(list, 0u32),
        across: vector(list, 3u32),
        upward: vector(list, 6u32),
        forward: vector(list, 9u32),
        lens: Pair {
            first: vector(list, 12u32),
            second: vector(list, 15u32),
        },
        dual: Dual {
            x: vector(list, 18u32),
            y: vector(list, 21u32),
            z: vector(list, 24u32),
        },
        aperture: list[31],
        per_focus: list[27],
        parallel,
        width: list[28],
        height: list[29],
        filter: list[30],
    }
}
