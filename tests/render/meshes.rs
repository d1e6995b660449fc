//! Meshes moved, scaled, turned and given normals: closed forms, and gradients against central differences.

use std::collections::BTreeSet;

use crate::common;
use crate::common::cpu_devices;
use crate::common::errors::{message, says};
use crate::common::numbers::{furthest, rmse};
use crate::common::scenes::{emitting, on_axis, under_sky};
use crate::common::tensors::{gradient, points, radiance, values};
use burn::tensor::DType;
use glam::DVec3;
use softray::prelude::*;

fn tensor<const D: usize>(values: &[f64], shape: [usize; D]) -> Tensor<D> {
    common::tensors::tensor(values, shape, &Device::flex(), DType::F64)
}

/// Σ of the rows under weights that no symmetry cancels.
fn weighted(rows: Tensor<2>) -> Tensor<1> {
    let [n, c] = rows.dims();
    let weights: Vec<f64> = (0..n * c).map(|i| (1.7 * i as f64 + 0.3).sin()).collect();
    (rows * tensor(&weights, [n, c])).sum()
}

/// Autodiff agrees with central differences at every component of `x`.
#[track_caller]
fn gradients_agree(x: &[f64], f: impl Fn(Tensor<1>) -> Tensor<2>) {
    common::tensors::gradients_agree(x, |x| weighted(f(x)));
}

fn normals(mesh: &Mesh) -> Tensor<2> {
    mesh.normals.as_ref().expect("normals").values.clone()
}

fn unit(rows: Tensor<2>) -> Tensor<2> {
    rows.clone() / (rows.clone() * rows).sum_dim(1).sqrt()
}

/// Vertices and unit normals, one below the other.
fn both(mesh: &Mesh) -> Tensor<2> {
    Tensor::cat(vec![mesh.vertices.clone(), unit(normals(mesh))], 0)
}

fn globe() -> Mesh {
    shapes::sphere(7, 5, &Device::flex()).cast(DType::F64)
}

fn volume(mesh: &Mesh) -> f64 {
    let v = points(&mesh.vertices);
    let at = |i: u32| v[i as usize];
    let six = |f: &[u32; 3]| at(f[0]).dot(at(f[1]).cross(at(f[2])));
    mesh.faces.iter().map(six).sum::<f64>() / 6.0
}

fn close(found: &Tensor<2>, expected: &Tensor<2>, tolerance: f64) {
    assert_eq!(found.dims(), expected.dims());
    let apart = furthest(&values(found), &values(expected));
    assert!(apart <= tolerance, "{apart}");
}

#[test]
fn numbers_do_what_tensors_do() {
    for device in cpu_devices() {
        let mesh = || shapes::sphere(7, 5, &device);
        let t = |v: &[f32]| Tensor::<1>::from_floats(v, &device);
        let pairs = [
            (
                mesh().translated([1.0, 2.0, 3.0]),
                mesh().translated(t(&[1.0, 2.0, 3.0])),
            ),
            (mesh().scaled(0.3), mesh().scaled(t(&[0.3]))),
            (
                mesh().scaled([0.3, -0.5, 2.0]),
                mesh().scaled(t(&[0.3, -0.5, 2.0])),
            ),
            (
                mesh().rotated([1.0, 2.0, 0.5], 0.7),
                mesh().rotated(t(&[1.0, 2.0, 0.5]), t(&[0.7])),
            ),
            (
                mesh().rotated([0.0, 0.0, 3e30], -0.7),
                mesh().transformed(&Transform::new().with_axis_angle([0.0, 0.0, 1.0], t(&[-0.7]))),
            ),
        ];
        for (numbers, tensors) in pairs {
            assert!(!numbers.vertices.is_tracked() && !tensors.vertices.is_tracked());
            close(&numbers.vertices, &tensors.vertices, 1e-6);
            close(&normals(&numbers), &normals(&tensors), 1e-6);
            assert_eq!(numbers.faces, tensors.faces);
            assert_eq!(numbers.vertices.dtype(), DType::F32);
        }
    }
    // Counter-clockwise about z: x goes to y.
    let x = Mesh::from_host(&[[1.0, 0.0, 0.0]; 3], vec![[0, 1, 2]], &Device::flex());
    let turned = x.rotated([0.0, 0.0, 2.0], 90.0);
    close(
        &turned.vertices,
        &tensor(&[0.0, 1.0, 0.0].repeat(3), [3, 3]),
        1e-6,
    );
}

/// Normals of an ellipsoid, and mirror images with their front outside.
#[test]
fn scaled_normals_are_those_of_the_surface() {
    for factors in [[2.0, 0.5, 1.0], [2.0, -0.5, 1.0], [-1.0, -0.5, -3.0]] {
        let mesh = globe().scaled(factors);
        let s = DVec3::from(factors);
        for (p, n) in points(&mesh.vertices).iter().zip(points(&normals(&mesh))) {
            let expected = (*p / (s * s)).normalize();
            assert!(n.normalize().distance(expected) < 1e-6);
        }
        let expected = volume(&globe()) * (s.x * s.y * s.z).abs();
        assert!((volume(&mesh) - expected).abs() < 1e-6, "{factors:?}");
        // Each corner keeps its texture coordinates and its normal.
        let pairs = |mesh: &Mesh| -> BTreeSet<[u32; 3]> {
            let uvs = &mesh.uvs.as_ref().expect("uvs").faces;
            let normals = &mesh.normals.as_ref().expect("normals").faces;
            let corners = |i: usize| (0..3).map(move |c| (i, c));
            (0..mesh.faces.len())
                .flat_map(corners)
                .map(|(i, c)| [mesh.faces[i][c], uvs[i][c], normals[i][c]])
                .collect()
        };
        assert_eq!(pairs(&mesh), pairs(&globe()));
    }
    for factor in [0.5, -0.5] {
        let tensor = tensor(&[factor], [1]);
        for mesh in [globe().scaled(factor), globe().scaled(tensor.clone())] {
            close(&unit(normals(&mesh)), &unit(mesh.vertices.clone()), 1e-12);
            assert!(volume(&mesh) > 0.0);
        }
        let mesh = globe().transformed(&Transform::new().with_scale(tensor));
        close(&unit(normals(&mesh)), &unit(mesh.vertices.clone()), 1e-12);
        assert!(volume(&mesh) > 0.0);
    }
}

#[test]
fn gradients_of_moves_turns_and_scales() {
    gradients_agree(&[0.3, -0.2, 0.7], |x| both(&globe().translated(x)));
    gradients_agree(&[-0.6], |x| both(&globe().scaled(x)));
    let ellipsoid = || globe().scaled([1.0, 2.0, 0.7]);
    gradients_agree(&[0.3, -0.2, 0.7], |x| both(&ellipsoid().scaled(x)));
    gradients_agree(&[0.3, -0.2, 0.7, 1.3], |x| {
        both(&ellipsoid().rotated(x.clone().slice([0..3]), x.slice([3..4])))
    });
}

#[test]
fn what_cannot_move_a_mesh_is_an_error() {
    let device = Device::flex();
    let ball = || shapes::icosahedron(&device);
    let two = || Tensor::<1>::from_floats([1.0, 2.0], &device);
    let cases = [
        (
            ball().translated(two()),
            "translated by a tensor of shape [2], expected [3]",
        ),
        (
            ball().translated([0.0, f64::NAN, 0.0]),
            "translated by [0.0, NaN, 0.0]",
        ),
        (
            ball().translated(tensor(&[0.0; 3], [3])),
            "translated by a tensor of dtype F64, expected F32 like the vertices",
        ),
        (
            ball().scaled(two()),
            "scaled by a tensor of shape [2], expected [1] or [3]",
        ),
        (
            ball().scaled(f64::INFINITY),
            "scaled by inf, expected a finite number",
        ),
        (
            ball().scaled(two() / 0.0).scaled(2.0),
            "scaled by a tensor of shape [2]",
        ),
        (
            shapes::sphere(4, 3, &device).scaled([1.0, 0.0, 1.0]),
            "scaled by [1.0, 0.0, 1.0], expected factors other than 0",
        ),
        (
            ball().rotated([0.0; 3], 1.0),
            "rotated about an axis of [0.0, 0.0, 0.0]",
        ),
        (
            ball().rotated([1.0; 3], f64::NAN),
            "rotated by an angle of NaN",
        ),
        (
            ball().rotated(two(), 1.0),
            "rotated about an axis of a tensor of shape [2]",
        ),
        (
            ball().rotated([1.0; 3], f64::NAN).translated([1.0; 3]),
            "rotated by an angle of NaN",
        ),
    ];
    for (mesh, expected) in cases {
        says(message(mesh.bounds()), [expected]);
        let rendered = render(&under_sky(mesh), &on_axis(4.0), &RenderOptions::new(2, 2));
        says(message(rendered), [expected]);
    }
    // Flat, but without normals that it would leave undefined.
    assert!(ball().scaled([1.0, 0.0, 1.0]).bounds().is_ok());
}

#[test]
fn smooth_normals_of_solids() {
    for device in cpu_devices() {
        // However the sides of a cube are cut, and whatever its size and place.
        for (size, offset) in [(1.0, 0.0), (1e-12, 0.0), (1e12, 0.0), (1.0, 40.0)] {
            let cube = shapes::cube(&device).smooth_normals();
            let placed = shapes::cube(&device).scaled(size).translated([offset; 3]);
            let expected = cube.vertices * 3f64.sqrt().recip();
            close(&normals(&placed.smooth_normals()), &expected, 1e-5);
        }
        let ball = shapes::icosphere(3, &device).smooth_normals();
        close(&normals(&ball), &ball.vertices, 6e-3);
        let globe = shapes::sphere(32, 16, &device);
        close(
            &normals(&globe.clone().smooth_normals()),
            &normals(&globe),
            1e-2,
        );
        assert!(!normals(&ball).is_tracked());
        assert!(ball.without_normals().normals.is_none());
    }
}

/// Vertices without faces, faces without area, and faces that cancel.
#[test]
fn smooth_normals_are_finite_and_not_zero() {
    let device = Device::flex();
    let v = [
        [0.0; 3],
        [1.0, 0.0, 0.0],
        [0.0, 0.0, -1.0],
        [2.0, 0.0, 0.0],
        [5.0; 3],
        [5.0; 3],
        [0.0, 3.0, 0.0],
        [1.0, 3.0, 0.0],
        [0.0, 3.0, 1.0],
        [9.0, 9.0, 9.0],
    ];
    let faces = vec![
        [0, 1, 2],
        [0, 1, 3],
        [4, 5, 4],
        [4, 5, 1],
        [6, 7, 8],
        [6, 8, 7],
    ];
    let vertices = Mesh::from_host(&v, faces.clone(), &device).vertices;
    let leaf = vertices.autodiff().require_grad();
    let mesh = Mesh::new(leaf.clone(), faces).smooth_normals();
    let found = points(&normals(&mesh));
    for n in &found {
        assert!((n.length() - 1.0).abs() < 1e-5, "{found:?}");
    }
    for i in 0..3 {
        assert!(found[i].distance(DVec3::Y) < 1e-5, "{found:?}");
    }
    for i in 3..10 {
        assert!(found[i].distance(DVec3::Z) < 1e-5, "{found:?}");
    }
    let gradients = normals(&mesh).powi_scalar(3).sum().backward();
    let gradient = gradient(&leaf, &gradients);
    assert!(gradient.iter().all(|g| g.is_finite()), "{gradient:?}");
    // All in one place, none at all, and faces out of range.
    let point = Mesh::from_host(&[[2.0; 3]; 3], vec![[0, 1, 2]], &device).smooth_normals();
    assert_eq!(values(&normals(&point)), [0.0, 0.0, 1.0].repeat(3));
    let none = Mesh::from_host(&v, vec![], &device).smooth_normals();
    assert!(none.normals.is_none());
    let wrong = Mesh::from_host(&v, vec![[0, 1, 10]], &device).smooth_normals();
    says(message(wrong.bounds()), ["[0, 1, 10]"]);
}

/// Across a crease whose vertices are separate normals stay apart.
#[test]
fn separate_vertices_keep_normals_of_their_own() {
    let roof = |second: [u32; 3]| {
        let ridge = [[0.0, 1.0, 0.0], [0.0, 1.0, 1.0]];
        let v = [
            ridge[0],
            ridge[1],
            [1.0, 0.0, 0.0],
            [-1.0, 0.0, 0.0],
            ridge[0],
            ridge[1],
        ];
        let mesh = Mesh::from_host(&v, vec![[0, 1, 2], second], &Device::flex());
        points(&normals(&mesh.smooth_normals()))
    };
    let slope = DVec3::new(1.0, 1.0, 0.0).normalize();
    let split = roof([5, 4, 3]);
    assert!(split[0].distance(slope) < 1e-5);
    assert!(split[4].distance(DVec3::new(-slope.x, slope.y, 0.0)) < 1e-5);
    assert!(roof([1, 0, 3])[0].distance(DVec3::Y) < 1e-5);
}

#[test]
fn gradients_of_smooth_normals() {
    let ball = shapes::icosphere(0, &Device::flex()).cast(DType::F64);
    let x: Vec<f64> = values(&ball.vertices);
    let bent: Vec<f64> = (0..x.len())
        .map(|i| x[i] + 0.15 * (2.3 * i as f64).sin())
        .collect();
    gradients_agree(&bent, |x| {
        normals(
            &ball
                .clone()
                .with_vertices(x.reshape([12, 3]))
                .smooth_normals(),
        )
    });
}

/// The radiance of what is seen of a mesh in the light of a lamp.
fn lit(mesh: Mesh, material: Material) -> Vec<f64> {
    let device = mesh.vertices.device();
    let lamp = [
        [-2.0, 4.0, 5.0],
        [2.0, 4.0, 5.0],
        [2.0, 6.0, 3.0],
        [-2.0, 6.0, 3.0],
    ];
    let [a, b, c, d] = lamp;
    let lamp = emitting(shapes::quad(d, c, b, a, &device), [4.0; 3]);
    let scene = Scene::new()
        .with_object(Object::new(mesh).with_material(material))
        .with_object(lamp)
        .with_environment([0.2; 3]);
    let camera = Camera::look_at([0.0, 0.0, 5.0], [0.0; 3]).with_fov_y(22.0);
    let options = RenderOptions::new(24, 24).with_samples(16).with_bounces(1);
    radiance(&scene, &camera, &options)
}

#[test]
fn a_sphere_is_shaded_like_one() {
    let device = Device::flex();
    let gray = || Material::diffuse([0.7; 3]);
    let round = lit(shapes::sphere(256, 128, &device), gray());
    let off = |mesh: Mesh| rmse(&lit(mesh, gray()), &round);
    let coarse = || shapes::sphere(20, 10, &device);
    let (smooth, flat) = (off(coarse()), off(coarse().without_normals()));
    let computed = off(coarse().smooth_normals());
    assert!(
        smooth < 0.6 * flat && computed < 0.6 * flat,
        "{smooth} {computed} {flat}"
    );
}

/// u from 0 at +z, over +x at a quarter; v from −y to +y.
#[test]
fn a_map_lies_on_a_sphere_unmirrored() {
    let device = Device::flex();
    let texels: Vec<f32> = (0..16 * 16)
        .flat_map(|i| {
            let (x, y) = (i % 16, i / 16);
            [f32::from(u8::from(x < 8)), f32::from(u8::from(y < 8)), 0.5]
        })
        .collect();
    let texels = Tensor::<1>::from_floats(texels.as_slice(), &device).reshape([16, 16, 3]);
    let image = lit(
        shapes::sphere(32, 16, &device),
        Material::diffuse(ColorTexture::texture(texels)),
    );
    // Red is where u < 1/2, which is the right; green is the upper half.
    for (x, y, red, green) in [
        (6, 6, false, true),
        (17, 6, true, true),
        (17, 17, true, false),
    ] {
        let pixel = &image[3 * (24 * y + x)..][..3];
        assert!(pixel[2] > 0.02, "{pixel:?}");
        assert_eq!(pixel[0] > pixel[2], red, "{x} {y} {pixel:?}");
        assert_eq!(pixel[1] > pixel[2], green, "{x} {y} {pixel:?}");
    }
}
