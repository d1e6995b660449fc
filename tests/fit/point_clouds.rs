//! Points on meshes and distances between clouds: plain loops, counts, and gradients against central
//! differences.

use crate::common;
use crate::common::cpu_devices;
use crate::common::errors::{message, says};
use crate::common::numbers::{mean, noise};
use crate::common::tensors::{gradient, leaf, points, values};
use burn::tensor::DType;
use glam::DVec3;
use softray::loss::{chamfer, f_score};
use softray::optim::{sample_points, sample_points_and_normals};
use softray::prelude::*;

fn tensor(values: &[f64], device: &Device, dtype: DType) -> Tensor<2> {
    common::tensors::tensor(values, [values.len() / 3, 3], device, dtype)
}

fn on_flex(values: &[f64]) -> Tensor<2> {
    tensor(values, &Device::flex(), DType::F64)
}

/// Autodiff agrees with central differences at every component of the rows `x`.
#[track_caller]
fn gradients_agree(x: &[f64], f: impl Fn(Tensor<2>) -> Tensor<1>) {
    let count = x.len() / 3;
    common::tensors::gradients_agree(x, |x| f(x.reshape([count, 3])));
}

/// A square of triangles of very different sizes, of which one has no area.
fn square(device: &Device) -> Mesh {
    let v = [
        [0.0, 0.0],
        [1.0, 0.0],
        [1.0, 1.0],
        [0.0, 1.0],
        [0.9, 0.4],
        [0.5, 0.0],
    ];
    let v = v.map(|[x, y]| [x, y, 2.0]);
    let faces = vec![
        [0, 5, 4],
        [5, 1, 4],
        [0, 1, 5],
        [1, 2, 4],
        [2, 3, 4],
        [3, 0, 4],
    ];
    Mesh::from_host(&v, faces, device)
}

#[test]
fn points_are_uniform_by_area() {
    for device in cpu_devices() {
        let count = 6400;
        let rows = sample_points(&square(&device), count, 3).expect("points");
        assert_eq!(rows.dims(), [count, 3]);
        assert!(!rows.is_tracked());
        let mut cells = [0; 64];
        for p in points(&rows) {
            assert!((p.z - 2.0).abs() < 1e-6);
            let cell = |x: f64| ((8.0 * x) as usize).min(7);
            cells[8 * cell(p.y) + cell(p.x)] += 1;
        }
        // Five standard deviations of independent points, which stratified ones stay below.
        for (i, n) in cells.iter().enumerate() {
            assert!((n - 100i32).abs() < 50, "{i}: {n}");
        }
        let spread: i32 = cells.iter().map(|n| (n - 100).pow(2)).sum();
        // χ² of 63 degrees of freedom has a mean of 63 and a standard deviation of 11.
        assert!(spread < 100 * 110, "{spread}");
    }
}

#[test]
fn points_lie_on_their_faces_with_their_normals() {
    let device = Device::flex();
    let ball = shapes::icosphere(2, &device).scaled(3.0);
    let (rows, normals) = sample_points_and_normals(&ball, 2000, 1).expect("points");
    let of = |mesh: &Mesh, seed| values(&sample_points(mesh, 2000, seed).expect("points"));
    assert_eq!(values(&rows), of(&ball, 1));
    assert_ne!(values(&rows), of(&ball, 2));
    let (rows, normals) = (points(&rows), points(&normals));
    let mut sum = DVec3::ZERO;
    for (p, n) in rows.iter().zip(&normals) {
        assert!((n.length() - 1.0).abs() < 1e-5);
        // The distance of a face's plane from the origin.
        let distance = p.dot(*n);
        assert!(distance > 2.8 && distance <= 3.0 + 1e-5, "{distance}");
        sum += *p;
    }
    assert!((sum / 2000.0).length() < 0.1, "{sum}");
    // A face whose size f32's products don't hold.
    let small = shapes::icosphere(0, &device).scaled(1e-25);
    let (_, normals) = sample_points_and_normals(&small, 10, 1).expect("points");
    for n in points(&normals) {
        assert!((n.length() - 1.0).abs() < 1e-5);
    }
}

#[test]
fn gradients_of_points_and_normals() {
    let ball = shapes::icosahedron(&Device::flex()).cast(DType::F64);
    let x: Vec<f64> = values(&ball.vertices)
        .iter()
        .zip(noise(36, 4))
        .map(|(v, n)| v + 0.1 * n)
        .collect();
    let weights = on_flex(&noise(90, 8));
    // Which faces are drawn changes with the areas: with one face for each point it can't.
    let triangles: Vec<[u32; 3]> = ball.faces[..1].to_vec();
    gradients_agree(&x, |x| {
        let mesh = Mesh::new(x, triangles.clone());
        let (p, n) = sample_points_and_normals(&mesh, 30, 5).expect("points");
        (p * weights.clone() + n * weights.clone().powi_scalar(2)).sum()
    });
    // Of many faces: the derivative along a move of all is that of the mean.
    let offset = Tensor::<1>::from_floats([0.1, 0.2, 0.3], &Device::flex());
    let offset = offset.cast(DType::F64).autodiff().require_grad();
    let moved = ball.translated(offset.clone());
    let rows = sample_points(&moved, 30, 5).expect("points");
    for g in gradient(&offset, &rows.mean_dim(0).sum().backward()) {
        assert!((g - 1.0).abs() < 1e-6, "{g}");
    }
}

#[test]
fn chamfer_is_that_of_a_plain_loop() {
    let (a, b) = (noise(3 * 150, 1), noise(3 * 90, 2));
    let vectors = |v: &[f64]| -> Vec<DVec3> { v.chunks_exact(3).map(DVec3::from_slice).collect() };
    let least = |p: &DVec3, to: &[DVec3]| {
        let squares = to.iter().map(|q| p.distance_squared(*q));
        squares.fold(f64::INFINITY, f64::min)
    };
    let (p, q) = (vectors(&a), vectors(&b));
    let squares =
        |from: &[DVec3], to: &[DVec3]| -> Vec<f64> { from.iter().map(|p| least(p, to)).collect() };
    let (from_a, from_b) = (squares(&p, &q), squares(&q, &p));
    let threshold = 0.25;
    let share =
        |v: &[f64]| v.iter().filter(|s| s.sqrt() <= threshold).count() as f64 / v.len() as f64;
    let (precision, recall) = (share(&from_a), share(&from_b));
    assert!(precision > 0.1 && recall < 0.9 && precision != recall);
    for device in cpu_devices() {
        for (dtype, tolerance) in [(DType::F64, 1e-12), (DType::F32, 1e-5)] {
            let (a, b) = (tensor(&a, &device, dtype), tensor(&b, &device, dtype));
            let loss = chamfer(a.clone(), b.clone()).expect("a loss");
            assert_eq!(loss.dims(), [1]);
            assert!(!loss.is_tracked());
            let found = values(&loss)[0];
            assert!((found - mean(&from_a) - mean(&from_b)).abs() < tolerance);
            assert_eq!(
                values(&chamfer(a.clone(), a.clone()).expect("a loss")),
                [0.0]
            );
            let score = f_score(&a, &b, threshold).expect("a score");
            let expected = 2.0 * precision * recall / (precision + recall);
            assert!((score - expected).abs() < 1e-12, "{score} {expected}");
            assert_eq!(f_score(&a, &a, 0.0).expect("a score"), 1.0);
            assert_eq!(f_score(&a, &(b + 10.0), 0.5).expect("a score"), 0.0);
        }
    }
}

#[test]
fn gradients_of_chamfer_flow_to_both() {
    let (a, b) = (noise(3 * 12, 1), noise(3 * 7, 2));
    gradients_agree(&a, |x| chamfer(x, on_flex(&b)).expect("a loss"));
    gradients_agree(&b, |x| chamfer(on_flex(&a), x).expect("a loss"));
}

#[test]
fn what_has_no_points_is_an_error() {
    let device = Device::flex();
    let good = || on_flex(&[0.0; 6]);
    let nan = || on_flex(&[0.0, 0.0, 0.0, 0.0, f64::NAN, 0.0]);
    let wide = || Tensor::<2>::zeros([4, 2], (&device, DType::F64));
    let cases = [
        (
            chamfer(wide(), good()),
            "points a: shape is [4, 2], expected [N, 3]",
        ),
        (chamfer(good(), wide()), "points b: shape is [4, 2]"),
        (chamfer(good(), nan()), "points b: row 1 is [0.0, NaN, 0.0]"),
        (
            chamfer(good(), good().cast(DType::F32)),
            "points b: dtype is F32",
        ),
        (
            f_score(&good(), &good(), -1.0).map(|_| unreachable!("a score")),
            "f_score: threshold is -1",
        ),
        (
            f_score(&good(), &good(), f64::NAN).map(|_| unreachable!("a score")),
            "f_score: threshold is NaN",
        ),
    ];
    for (found, expected) in cases {
        says(message(found), [expected]);
    }
    let mesh = |v: &[[f64; 3]], faces| Mesh::from_host(v, faces, &device);
    let line = [[0.0; 3], [1.0; 3], [2.0; 3]];
    let cases = [
        (sample_points(&square(&device), 0, 1), "count is 0"),
        (
            sample_points(&mesh(&line, vec![]), 9, 1),
            "faces is 0 without area",
        ),
        (
            sample_points(&mesh(&line, vec![[0, 1, 1]]), 9, 1),
            "faces is 1 without area",
        ),
        (
            sample_points(&mesh(&line, vec![[0, 1, 3]]), 9, 1),
            "vertices of face 0",
        ),
        (
            sample_points(&square(&device).scaled(f64::NAN), 9, 1),
            "scaled by NaN",
        ),
    ];
    for (found, expected) in cases {
        says(message(found), [expected]);
    }
}

/// A fit pulls a ball onto a larger, moved one.
#[test]
fn chamfer_draws_a_mesh_to_a_cloud() {
    let device = Device::flex();
    let target = shapes::icosphere(3, &device)
        .scaled(1.5)
        .translated([0.4, 0.0, -0.3]);
    let target = sample_points(&target, 800, 1).expect("points");
    let ball = shapes::icosphere(2, &device);
    let (mut offset, mut size) = ([0f32; 3], 1f32);
    let mut losses = Vec::new();
    for step in 0..30 {
        let (at, scale) = (leaf(&offset, &device), leaf(&[size], &device));
        let moved = ball.clone().scaled(scale.clone()).translated(at.clone());
        let cloud = sample_points(&moved, 800, step).expect("points");
        let loss = chamfer(cloud, target.clone()).expect("a loss");
        losses.push(values(&loss)[0]);
        let gradients = loss.backward();
        let slope = |t: &Tensor<1>| gradient(t, &gradients);
        for (o, g) in offset.iter_mut().zip(slope(&at)) {
            *o -= 0.4 * g as f32;
        }
        size -= 0.2 * slope(&scale)[0] as f32;
    }
    assert!((size - 1.5).abs() < 0.05, "{size}");
    for (o, expected) in offset.iter().zip([0.4, 0.0, -0.3]) {
        assert!((o - expected).abs() < 0.05, "{offset:?}");
    }
    assert!(losses[29] < 0.1 * losses[0], "{losses:?}");
}
