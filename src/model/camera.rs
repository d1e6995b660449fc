//! A perspective camera, pinhole or thin lens: rays through points of the film, points of the film that
//! see a point of space, and derivatives of both.

use super::V3;

/// A camera in a scene's inner units. Film points are in pixels, (0, 0) the image's upper left corner.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Camera {
    pub eye: V3,
    /// Unit vectors.
    pub forward: V3,
    pub right: V3,
    pub up: V3,
    /// tan(fov_y/2).
    pub half_height: f32,
    /// Radius of the lens, 0 for a pinhole, and distance of the focus plane.
    pub aperture: f32,
    pub focus: f32,
    /// Pixels.
    pub width: f32,
    pub height: f32,
}

/// Derivatives by what a camera is made of.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct CameraGradient {
    pub eye: V3,
    pub forward: V3,
    pub right: V3,
    pub up: V3,
    pub half_height: f32,
    pub aperture: f32,
    pub focus: f32,
}

/// A ray from a point of the lens (on the unit disk) through a point of the film.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct CameraRay {
    pub origin: V3,
    pub direction: V3,
    /// The length that the direction was divided by.
    pub length: f32,
    /// Film point in units of half the image's height, (0, 0) its middle, y up.
    pub x: f32,
    pub y: f32,
    pub lens_x: f32,
    pub lens_y: f32,
}

/// A point of the film, in pixels.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct FilmPoint {
    pub x: f32,
    pub y: f32,
}

impl Camera {
    /// The ray through a film point in pixels.
    #[inline(always)]
    pub fn ray(&self, x: f32, y: f32, lens_x: f32, lens_y: f32) -> CameraRay {
        let x = (2.0 * x - self.width) / self.height;
        let y = 1.0 - 2.0 * y / self.height;
        let through = self.through(x, y);
        let mut origin = self.eye;
        let mut along = through;
        if self.aperture > 0.0 {
            let on_lens = (self.right * lens_x + self.up * lens_y) * self.aperture;
            origin = self.eye + on_lens;
            along = through * self.focus - on_lens;
        }
        let length = along.length();
        CameraRay {
            origin,
            direction: along * (1.0 / length),
            length,
            x,
            y,
            lens_x,
            lens_y,
        }
    }

    #[inline(always)]
    fn through(&self, x: f32, y: f32) -> V3 {
        (self.right * x + self.up * y) * self.half_height + self.forward
    }

    /// Adds the derivatives of g_o·origin + g_d·direction.
    #[inline(always)]
    pub fn ray_backward(&self, ray: &CameraRay, g_o: V3, g_d: V3, gradient: &mut CameraGradient) {
        let by_along = g_d.across(ray.direction) * (1.0 / ray.length);
        gradient.eye += g_o;
        let mut by_through = by_along;
        if self.aperture > 0.0 {
            let by_lens = g_o - by_along;
            gradient.right += by_lens * (ray.lens_x * self.aperture);
            gradient.up += by_lens * (ray.lens_y * self.aperture);
            gradient.aperture += by_lens.dot(self.right * ray.lens_x + self.up * ray.lens_y);
            gradient.focus += by_along.dot(self.through(ray.x, ray.y));
            by_through = by_along * self.focus;
        }
        gradient.right += by_through * (ray.x * self.half_height);
        gradient.up += by_through * (ray.y * self.half_height);
        gradient.forward += by_through;
        gradient.half_height += by_through.dot(self.right * ray.x + self.up * ray.y);
    }

    /// The point of the lens, relative to its middle.
    #[inline(always)]
    pub fn lens_point(&self, lens_x: f32, lens_y: f32) -> V3 {
        (self.right * lens_x + self.up * lens_y) * self.aperture
    }

    /// 1 over the focus distance, 0 for a pinhole.
    #[inline(always)]
    fn inverse_focus(&self) -> f32 {
        let mut inverse = 0.0;
        if self.aperture > 0.0 {
            inverse = 1.0 / self.focus;
        }
        inverse
    }

    /// The film point that sees a point of space from a point of the lens. The depth has to be positive.
    #[inline(always)]
    pub fn project(&self, point: V3, lens_x: f32, lens_y: f32) -> FilmPoint {
        let r = point - self.eye - self.lens_point(lens_x, lens_y);
        let depth = r.dot(self.forward);
        let shift = self.aperture * self.inverse_focus();
        let x = (r.dot(self.right) / depth + shift * lens_x) / self.half_height;
        let y = (r.dot(self.up) / depth + shift * lens_y) / self.half_height;
        FilmPoint {
            x: 0.5 * (self.width + x * self.height),
            y: 0.5 * (1.0 - y) * self.height,
        }
    }

    /// How the film point moves while the point of space moves along a vector, in pixels.
    #[inline(always)]
    pub fn project_along(&self, point: V3, along: V3, lens_x: f32, lens_y: f32) -> [f32; 2] {
        let r = point - self.eye - self.lens_point(lens_x, lens_y);
        let inverse = 1.0 / r.dot(self.forward);
        let depth = along.dot(self.forward) * inverse;
        let scale = 0.5 * self.height * inverse / self.half_height;
        [
            (along.dot(self.right) - r.dot(self.right) * depth) * scale,
            -(along.dot(self.up) - r.dot(self.up) * depth) * scale,
        ]
    }

    /// Adds the derivatives of g·(film point, in pixels); returns that by the point of space.
    #[inline(always)]
    pub fn project_backward(
        &self,
        point: V3,
        lens_x: f32,
        lens_y: f32,
        g: [f32; 2],
        gradient: &mut CameraGradient,
    ) -> V3 {
        let lens = self.lens_point(lens_x, lens_y);
        let r = point - self.eye - lens;
        let inverse = 1.0 / r.dot(self.forward);
        let scale = 0.5 * self.height / self.half_height;
        let g_x = g[0] * scale;
        let g_y = -g[1] * scale;
        let x = r.dot(self.right) * inverse;
        let y = r.dot(self.up) * inverse;
        let a = g_x * inverse;
        let b = g_y * inverse;
        let c = -(a * x + b * y);
        let by_r = self.right * a + self.up * b + self.forward * c;
        gradient.right += r * a;
        gradient.up += r * b;
        gradient.forward += r * c;
        gradient.eye -= by_r;
        let inverse_focus = self.inverse_focus();
        let shift = self.aperture * inverse_focus;
        let by_shift = g_x * lens_x + g_y * lens_y;
        gradient.half_height -=
            (g_x * (x + shift * lens_x) + g_y * (y + shift * lens_y)) / self.half_height;
        if self.aperture > 0.0 {
            gradient.right -= by_r * (self.aperture * lens_x);
            gradient.up -= by_r * (self.aperture * lens_y);
            gradient.aperture +=
                by_shift * inverse_focus - by_r.dot(self.right * lens_x + self.up * lens_y);
            gradient.focus -= by_shift * shift * inverse_focus;
        }
        by_r
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::v3;

    fn camera(aperture: f32) -> Camera {
        let forward = v3(0.1, -0.2, -1.0).normalized();
        let right = forward.cross(v3(0.0, 1.0, 0.0)).normalized();
        Camera {
            eye: v3(0.3, 0.4, 2.0),
            forward,
            right,
            up: right.cross(forward),
            half_height: 0.4,
            aperture,
            focus: 2.5,
            width: 60.0,
            height: 40.0,
        }
    }

    #[test]
    fn a_point_on_a_ray_is_seen_by_its_film_point() {
        for aperture in [0.0, 0.2] {
            let c = camera(aperture);
            let ray = c.ray(13.0, 29.0, 0.4, -0.6);
            let found = c.project(ray.origin + ray.direction * 3.7, 0.4, -0.6);
            assert!((found.x - 13.0).abs() < 1e-3 && (found.y - 29.0).abs() < 1e-3);
            let (p, along) = (v3(0.2, 0.1, -1.0), v3(0.3, -0.2, 0.5));
            let h = 1e-2;
            let (a, b) = (
                c.project(p + along * h, 0.4, -0.6),
                c.project(p - along * h, 0.4, -0.6),
            );
            let got = c.project_along(p, along, 0.4, -0.6);
            assert!((got[0] - (a.x - b.x) / (2.0 * h)).abs() < 2e-2, "{got:?}");
            assert!((got[1] - (a.y - b.y) / (2.0 * h)).abs() < 2e-2, "{got:?}");
        }
    }

    /// Both backward passes against central differences, in every number of a camera.
    #[test]
    fn derivatives() {
        let (p, g) = (v3(0.2, 0.1, -1.0), [0.7, -0.4]);
        let (g_o, g_d) = (v3(0.3, -0.8, 0.4), v3(-0.5, 0.2, 0.9));
        for aperture in [0.0, 0.2] {
            let c = camera(aperture);
            let of_ray = |c: &Camera| {
                let r = c.ray(13.0, 29.0, 0.4, -0.6);
                f64::from(g_o.dot(r.origin) + g_d.dot(r.direction))
            };
            let of_film = |c: &Camera| {
                let f = c.project(p, 0.4, -0.6);
                f64::from(g[0] * f.x + g[1] * f.y)
            };
            let mut by_ray = CameraGradient::default();
            c.ray_backward(&c.ray(13.0, 29.0, 0.4, -0.6), g_o, g_d, &mut by_ray);
            let mut by_film = CameraGradient::default();
            c.project_backward(p, 0.4, -0.6, g, &mut by_film);
            type Number = (fn(&mut Camera) -> &mut f32, fn(&CameraGradient) -> f32);
            let numbers: [Number; 8] = [
                (|c| &mut c.eye.x, |g| g.eye.x),
                (|c| &mut c.eye.z, |g| g.eye.z),
                (|c| &mut c.forward.y, |g| g.forward.y),
                (|c| &mut c.right.x, |g| g.right.x),
                (|c| &mut c.up.y, |g| g.up.y),
                (|c| &mut c.half_height, |g| g.half_height),
                (|c| &mut c.aperture, |g| g.aperture),
                (|c| &mut c.focus, |g| g.focus),
            ];
            for (i, (number, gradient)) in numbers.into_iter().enumerate() {
                // A pinhole has no lens to differentiate by.
                if aperture == 0.0 && i >= 6 {
                    continue;
                }
                for (name, f, by) in [
                    ("ray", &of_ray as &dyn Fn(&Camera) -> f64, &by_ray),
                    ("film", &of_film, &by_film),
                ] {
                    let h = 3e-3;
                    let (mut a, mut b) = (c, c);
                    *number(&mut a) += h;
                    *number(&mut b) -= h;
                    let wanted = (f(&a) - f(&b)) / (2.0 * f64::from(h));
                    let got = f64::from(gradient(by));
                    let scale = wanted.abs().max(0.1);
                    assert!(
                        (got - wanted).abs() < 1e-2 * scale,
                        "{name} {i}: {got} {wanted}"
                    );
                }
            }
        }
    }
}
