//! What passes a surface: nothing inside of it, seams and vertices included, half at its border,
//! and everything from a convex mesh outwards, at any tessellation and blur.

mod common;

use burn::tensor::{DType, Device};
use common::values;
use softray::geometry::Vec3;
use softray::prelude::*;
use softray::scene::Flattened;
use softray::visibility::{CoverageSettings, Rays, coverage};

/// A scene to shoot rays through.
struct Range {
    flat: Flattened,
    sigma: f64,
}

impl Range {
    fn new(objects: Vec<Object>, eye: [f64; 3], sigma: f64) -> Self {
        let scene = Scene {
            objects,
            ..Scene::new()
        };
        let camera = Camera::look_at(eye, [0.0; 3]).up([0.3, 0.9, 0.2]);
        Self {
            flat: Flattened::new(&scene, &camera, None).expect("a scene"),
            sigma,
        }
    }

    /// Rows of absolute origins, relative to the centre of the bounds.
    fn rows(&self, points: &[[f64; 3]], center: [f64; 3], unit: f64) -> Vec3 {
        let context = &self.flat.context;
        let axis = |k: usize| {
            let row: Vec<f64> = points.iter().map(|p| (p[k] - center[k]) / unit).collect();
            context.row(&row)
        };
        Vec3::new(axis(0), axis(1), axis(2))
    }

    /// The share of light that passes along each ray, as shadow rays and as drawn surfaces see it.
    fn passed(
        &self,
        form: Visibility,
        origins: &[[f64; 3]],
        directions: &[[f64; 3]],
        departure: Option<Vec<u32>>,
    ) -> [Vec<f64>; 2] {
        let rays = Rays {
            origin: self.rows(origins, self.flat.bounds.center, self.flat.unit),
            direction: self.rows(directions, [0.0; 3], 1.0),
            time: None,
            departure,
            arrival: None,
        };
        let settings = CoverageSettings {
            sigma: self.sigma / self.flat.unit.powi(2),
            t_min: 1e-5 * self.flat.radius(),
            start: 0.0,
            arrival_margin: 1e-4,
        };
        let (context, topology) = (&self.flat.context, &self.flat.topology);
        let found = coverage(context, &self.flat.triangles, topology, &rays, &settings);
        let range = softray::visibility::DepthRange::new(&rays, self.flat.radius());
        let passed = form.transmittance(context, topology, &found);
        let weights = form.weights(context, topology, found, range);
        [
            values(&passed),
            values(&weights.expect("weights").background),
        ]
    }
}

/// A point of each of some triangles and a direction above its plane.
fn leaving(mesh: &Mesh, count: usize) -> (Vec<u32>, Vec<[f64; 3]>, Vec<[f64; 3]>) {
    let vertices = mesh.host_vertices().expect("vertices");
    let mut found = (Vec::new(), Vec::new(), Vec::new());
    // A low-discrepancy sequence (golden ratio in four dimensions).
    let mut u = [0.5; 4];
    for _ in 0..count {
        for (u, step) in u.iter_mut().zip([0.8567, 0.7339, 0.6287, 0.5386]) {
            *u = (*u + step) % 1.0;
        }
        let k = (u[0] * mesh.faces.len() as f64) as usize;
        let [a, b, c] = mesh.faces[k].map(|i| vertices[i as usize]);
        let (s, t) = (u[1].sqrt() * (1.0 - u[2]), u[1].sqrt() * u[2]);
        let point: [f64; 3] = std::array::from_fn(|i| a[i] + s * (b[i] - a[i]) + t * (c[i] - a[i]));
        let e = |p: [f64; 3]| -> [f64; 3] { std::array::from_fn(|i| p[i] - a[i]) };
        let (p, q) = (e(b), e(c));
        let normal: [f64; 3] = std::array::from_fn(|i| {
            p[(i + 1) % 3] * q[(i + 2) % 3] - p[(i + 2) % 3] * q[(i + 1) % 3]
        });
        let length = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        // n plus a vector of at most nearly its length: down to 2° above the plane.
        let angle = std::f64::consts::TAU * u[3];
        let along = length(p);
        let direction: [f64; 3] = std::array::from_fn(|i| {
            let n = normal[i] / length(normal);
            0.04 * n + angle.cos() * p[i] / along + angle.sin() * (n - p[i] / along) * u[1]
        });
        let above = (0..3)
            .map(|i| direction[i] * normal[i])
            .sum::<f64>()
            .signum();
        let size = length(direction);
        found.0.push(k as u32);
        found.1.push(point);
        found.2.push(direction.map(|x| above * x / size));
    }
    found
}

#[test]
fn rays_leave_a_convex_mesh_freely() {
    let device = Device::flex();
    let sphere = |splits| shapes::icosphere(splits, &device);
    let cube = || shapes::cube(&device).subdivided();
    for mesh in [
        cube(),
        sphere(1),
        sphere(2),
        sphere(3),
        sphere(4),
        sphere(5),
    ] {
        let rays = if mesh.faces.len() > 5000 { 64 } else { 256 };
        let (departure, origins, directions) = leaving(&mesh, rays);
        for sigma in [1e-6, 1e-4, 1e-2] {
            let objects = vec![Object::new(mesh.clone())];
            let range = Range::new(objects, [0.0, 0.0, 5.0], sigma);
            for form in [Visibility::Layered, Visibility::softmax(1e-3)] {
                let departure = Some(departure.clone());
                let [shadow, drawn] = range.passed(form, &origins, &directions, departure);
                let faces = mesh.faces.len();
                // Where nothing is met the softmax is over the background alone.
                for passed in [shadow, drawn] {
                    assert_eq!(
                        passed,
                        vec![1.0; rays],
                        "{form:?}, {faces} faces, σ {sigma}"
                    );
                }
            }
        }
    }
}

/// A flat grid of 1 × 1 cells in the plane y = 0, from −4 to 4.
fn grid(dtype: DType, sigma: f64) -> Range {
    let mesh = shapes::plane_grid(8.0, 8.0, 8, 8, &Device::flex()).cast(dtype);
    Range::new(vec![Object::new(mesh)], [0.0, 5.0, 0.0], sigma)
}

/// Rays down at points of the plane, from straight above and aslant.
fn down(at: &[[f64; 2]], slant: f64) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
    let length = (1.0 + slant * slant).sqrt();
    let origins = at.iter().map(|p| [p[0] - 2.0 * slant, 2.0, p[1]]);
    let directions = at.iter().map(|_| [slant / length, -1.0 / length, 0.0]);
    (origins.collect(), directions.collect())
}

#[test]
fn nothing_passes_a_flat_grid() {
    // Middles of triangles, both kinds of seams, vertices, and points in between.
    let mut points = Vec::new();
    for i in -24..=24 {
        for j in -24..=24 {
            points.push([f64::from(i) / 8.0, f64::from(j) / 8.0]);
        }
    }
    for (dtype, tolerance) in [(DType::F64, 1e-12), (DType::F32, 1e-5)] {
        for sigma in [1e-8, 1e-6, 1e-4, 1e-2, 0.1] {
            let range = grid(dtype, sigma);
            for slant in [0.0, 0.7] {
                let (origins, directions) = down(&points, slant);
                for passed in range.passed(Visibility::Layered, &origins, &directions, None) {
                    let most = passed.iter().fold(0.0f64, |m, v| m.max(*v));
                    assert!(most < tolerance, "{most:e} at σ {sigma}");
                }
            }
        }
    }
    // The product over triangles lets a quarter through at each seam.
    let (origins, directions) = down(&[[0.25, 1.0]], 0.0);
    let [shadow, _] =
        grid(DType::F64, 1e-6).passed(Visibility::softmax(1e-3), &origins, &directions, None);
    assert!((shadow[0] - 0.25).abs() < 1e-6, "{}", shadow[0]);
}

#[test]
fn half_passes_at_a_straight_border_and_all_beyond() {
    let sigma = 1e-3;
    let range = grid(DType::F64, sigma);
    // Along the side x = 4, in the middle of edges: at a vertex of the border the triangles that
    // share it would add up.
    for across in [-0.2, -0.1, -0.05, -0.01, 0.0, 0.01, 0.05, 0.1, 0.2, 0.5] {
        let at: Vec<[f64; 2]> = (-3..3)
            .map(|j| [4.0 + across, f64::from(j) + 0.5])
            .collect();
        let (origins, directions) = down(&at, 0.3);
        let logit = -across * f64::abs(across) / sigma;
        let expected = 1.0 - 1.0 / (1.0 + (-logit).exp());
        for passed in range.passed(Visibility::Layered, &origins, &directions, None) {
            for v in passed {
                assert!(
                    (v - expected).abs() < 1e-9,
                    "{v}, expected {expected} at {across}"
                );
            }
        }
    }
}
