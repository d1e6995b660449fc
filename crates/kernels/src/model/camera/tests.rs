use super::*;

impl Camera {
    /// Sets the inverse of the basis.
    fn inverted(mut self) -> Self {
        let volume = 1.0 / self.across.dot(self.upward.cross(self.forward));
        self.dual = Dual {
            x: self.upward.cross(self.forward) * volume,
            y: self.forward.cross(self.across) * volume,
            z: self.across.cross(self.upward) * volume,
        };
        self
    }
}

/// A camera with non-square pixels and an off-center principal point.
fn camera(aperture: f32, parallel: bool) -> Camera {
    let forward = v3(0.1, -0.2, -1.0).normalize();
    let right = forward.cross(v3(0.0, 1.0, 0.0)).normalize();
    let up = right.cross(forward);
    let mut shift = V3::ZERO;
    if !parallel {
        shift = right * 0.1 - up * 0.05;
    }
    Camera {
        eye: v3(0.3, 0.4, 2.0),
        across: right * 0.5,
        upward: up * 0.4,
        forward: forward + shift,
        lens: Pair {
            first: right * aperture,
            second: up * aperture,
        },
        aperture,
        per_focus: if aperture > 0.0 { 0.4 } else { 0.0 },
        parallel,
        width: 60.0,
        height: 40.0,
        filter: 0.0,
        dual: Dual::default(),
    }
    .inverted()
}

const KINDS: [(f32, bool); 3] = [(0.0, false), (0.2, false), (0.0, true)];

#[test]
fn a_point_on_a_ray_is_seen_by_its_film_point() {
    for (aperture, parallel) in KINDS {
        let c = camera(aperture, parallel);
        let ray = c.ray(13.0, 29.0, 0.4, -0.6);
        let point = ray.origin + ray.direction * 3.7;
        let found = c.project(point, 0.4, -0.6);
        assert!((found.x - 13.0).abs() < 1e-3 && (found.y - 29.0).abs() < 1e-3);
        let origin = c.origin_towards(point, 0.4, -0.6);
        assert!((origin - ray.origin).length() < 1e-5, "{origin:?}");
        let (p, along) = (v3(0.2, 0.1, -1.0), v3(0.3, -0.2, 0.5));
        let h = 1e-2;
        let (a, b) = (
            c.project(p + along * h, 0.4, -0.6),
            c.project(p - along * h, 0.4, -0.6),
        );
        let got = c.project_along(p, along, 0.4, -0.6);
        assert!((got.x - (a.x - b.x) / (2.0 * h)).abs() < 2e-2, "{got:?}");
        assert!((got.y - (a.y - b.y) / (2.0 * h)).abs() < 2e-2, "{got:?}");
    }
}

/// Both backward passes against central differences, in all vectors of a camera.
#[test]
fn derivatives() {
    let (p, g) = (v3(0.2, 0.1, -1.0), v2(0.7, -0.4));
    let (g_o, g_d) = (v3(0.3, -0.8, 0.4), v3(-0.5, 0.2, 0.9));
    for (aperture, parallel) in KINDS {
        let c = camera(aperture, parallel);
        let of_ray = |c: &Camera| {
            let r = c.ray(13.0, 29.0, 0.4, -0.6);
            f64::from(g_o.dot(r.origin) + g_d.dot(r.direction))
        };
        let of_film = |c: &Camera| {
            let f = c.inverted().project(p, 0.4, -0.6);
            f64::from(g.x * f.x + g.y * f.y)
        };
        let mut by_ray = CameraGradient::default();
        let ray = c.ray(13.0, 29.0, 0.4, -0.6);
        c.ray_backward(&ray, v2(13.5, 28.5), g_o, g_d, &mut by_ray);
        let mut by_film = CameraGradient::default();
        c.project_backward(p, 0.4, -0.6, g, &mut by_film);
        // The logarithm of the area on the film of a triangle about a point of a ray, per its own area.
        let point = ray.origin + ray.direction * 3.0;
        let normal = v3(0.3, 0.2, 1.0).normalize();
        let (side, side2) = (normal.cross(V3::AXES[0]), normal.cross(V3::AXES[1]));
        let of_area = |c: &Camera| {
            let c = c.inverted();
            let along = |side: V3| c.project_along(point, side, 0.4, -0.6);
            let (a, b) = (along(side), along(side2));
            f64::from((a.x * b.y - a.y * b.x).abs().ln())
        };
        let mut by_area = CameraGradient::default();
        c.area_backward(&ray, point, normal, 1.0, &mut by_area);
        type Number = (fn(&mut Camera) -> &mut f32, fn(&CameraGradient) -> f32);
        let numbers: [Number; 12] = [
            (|c| &mut c.eye.x, |g| g.eye.x),
            (|c| &mut c.eye.z, |g| g.eye.z),
            (|c| &mut c.forward.y, |g| g.forward.y),
            (|c| &mut c.forward.z, |g| g.forward.z),
            (|c| &mut c.across.x, |g| g.across.x),
            (|c| &mut c.across.z, |g| g.across.z),
            (|c| &mut c.upward.y, |g| g.upward.y),
            (|c| &mut c.upward.z, |g| g.upward.z),
            (|c| &mut c.lens.first.x, |g| g.lens.first.x),
            (|c| &mut c.lens.first.z, |g| g.lens.first.z),
            (|c| &mut c.lens.second.y, |g| g.lens.second.y),
            (|c| &mut c.per_focus, |g| g.per_focus),
        ];
        for (i, (number, gradient)) in numbers.into_iter().enumerate() {
            // Without a lens there are no lens parameters.
            if aperture == 0.0 && i >= 8 {
                continue;
            }
            for (name, f, by) in [
                ("ray", &of_ray as &dyn Fn(&Camera) -> f64, &by_ray),
                ("area", &of_area, &by_area),
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
                    "{name} {i} of {aperture} {parallel}: {got} {wanted}"
                );
            }
        }
    }
}
