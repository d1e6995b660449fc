//! Losses of the shape of meshes: closed forms, plain loops, central differences.

mod mesh_loops;

use crate::common;
use crate::common::cpu_devices;
use crate::common::errors::{message, says};
use crate::common::numbers::{largest, noise};
use crate::common::tensors::{gradient, tensor, values};
use burn::tensor::DType;
use glam::DVec3;
use mesh_loops::{bends, cotangents, umbrella};
use softray::optim::MeshRegularizer;
use softray::prelude::*;

type Loss = fn(&MeshRegularizer, Tensor<3>) -> Tensor<1>;

const LOSSES: [(&str, Loss); 7] = [
    ("laplacian", |r, v| r.laplacian(v)),
    ("laplacian_cotangent", |r, v| r.laplacian_cotangent(v)),
    ("normal_consistency", |r, v| r.normal_consistency(v)),
    ("flatness", |r, v| r.flatness(v)),
    ("edge_length", |r, v| r.edge_length(v, 0.3)),
    ("volume", |r, v| r.volume(v).sum()),
    ("area", |r, v| r.area(v).sum()),
];

/// Vertices `[B, V, 3]`.
fn batch(meshes: &[Vec<DVec3>], device: &Device, dtype: DType) -> Tensor<3> {
    let shape = [meshes.len(), meshes[0].len(), 3];
    let flat: Vec<f64> = meshes.iter().flatten().flat_map(|v| v.to_array()).collect();
    tensor(&flat, shape, device, dtype)
}

fn points(mesh: &Mesh) -> Vec<DVec3> {
    common::tensors::points(&mesh.vertices)
}

/// The regularizer and vertices `[1, V, 3]` of a mesh, in f64.
fn of(mesh: &Mesh) -> (MeshRegularizer, Tensor<3>) {
    let regular = MeshRegularizer::from_mesh(mesh).expect("a mesh");
    let vertices = batch(&[points(mesh)], &mesh.vertices.device(), DType::F64);
    (regular, vertices)
}

/// With vertices moved by up to so much, the same for the same seed.
fn shaken(vertices: &[DVec3], by: f64, seed: u64) -> Vec<DVec3> {
    let moves = noise(3 * vertices.len(), seed);
    let moves = moves.chunks_exact(3).map(|m| by * DVec3::from_slice(m));
    vertices.iter().zip(moves).map(|(v, m)| *v + m).collect()
}

fn scalar(t: Tensor<1>) -> f64 {
    common::tensors::scalar(&t)
}

#[track_caller]
fn close(found: f64, expected: f64, tolerance: f64) {
    let apart = (found - expected).abs();
    assert!(apart <= tolerance, "{found} expected {expected}");
}

/// Corners (1, 1, 1), (1, −1, −1), (−1, 1, −1), (−1, −1, 1), wound outwards.
fn tetrahedron(device: &Device) -> Mesh {
    let v = [
        [1.0; 3],
        [1.0, -1.0, -1.0],
        [-1.0, 1.0, -1.0],
        [-1.0, -1.0, 1.0],
    ];
    Mesh::from_host(&v, vec![[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]], device)
}

#[test]
fn closed_forms_of_a_cube_and_a_tetrahedron() {
    for device in cpu_devices() {
        let (r, v) = of(&shapes::cube(&device));
        close(scalar(r.volume(v.clone())), 8.0, 1e-12);
        close(scalar(r.area(v.clone())), 24.0, 1e-12);
        // 12 edges at right angles and 6 diagonals of the sides.
        close(scalar(r.normal_consistency(v.clone())), 2.0 / 3.0, 1e-12);
        close(scalar(r.flatness(v.clone())), 2.0 / 3.0, 1e-12);
        let mean = r.mean_edge_length(&v).expect("a length");
        close(mean, (12.0 * 2.0 + 6.0 * 8f64.sqrt()) / 18.0, 1e-12);

        let (r, v) = of(&tetrahedron(&device));
        close(scalar(r.volume(v.clone())), 8.0 / 3.0, 1e-12);
        close(scalar(r.area(v.clone())), 8.0 * 3f64.sqrt(), 1e-12);
        // The dihedral angle has a cosine of 1/3.
        close(scalar(r.normal_consistency(v.clone())), 4.0 / 3.0, 1e-12);
        close(scalar(r.flatness(v.clone())), 16.0 / 9.0, 1e-12);
        // δ = −4/3 v for either kind of weights, and |v|² = 3.
        close(scalar(r.laplacian(v.clone())), 16.0 / 3.0, 1e-12);
        close(scalar(r.laplacian_cotangent(v.clone())), 16.0 / 3.0, 1e-12);
        close(scalar(r.edge_length(v.clone(), 8f64.sqrt())), 0.0, 1e-12);
        close(scalar(r.edge_length(v, 0.0)), 8.0, 1e-12);
    }
}

#[test]
fn a_plane_is_flat_and_a_fold_is_not() {
    let device = Device::flex();
    let (r, v) = of(&shapes::plane_grid(2.0, 3.0, 4, 5, &device));
    close(scalar(r.normal_consistency(v.clone())), 0.0, 1e-14);
    close(scalar(r.flatness(v.clone())), 0.0, 1e-14);
    close(scalar(r.volume(v.clone())), 0.0, 1e-14);
    close(scalar(r.area(v)), 6.0, 1e-12);

    // Two triangles at an edge, the second at an angle from the plane of the first.
    for (angle, cos) in [(0.0f64, 1.0), (60.0, 0.5), (90.0, 0.0), (180.0, -1.0)] {
        let (sin, c) = angle.to_radians().sin_cos();
        let v = [[0.0; 3], [1.0, 0.0, 0.0], [0.5, 1.0, 0.0], [0.5, -c, sin]];
        for faces in [vec![[0, 1, 2], [1, 0, 3]], vec![[0, 1, 2], [0, 1, 3]]] {
            let (r, v) = of(&Mesh::from_host(&v, faces, &device));
            // Host vertices pass through f32 in `from_host`.
            close(scalar(r.normal_consistency(v.clone())), 1.0 - cos, 1e-6);
            close(scalar(r.flatness(v)), (1.0 - cos) * (1.0 - cos), 1e-6);
        }
    }
}

/// On the unit sphere an edge of length h has δ·n = −h²/2, so |δ|² falls by 16 where edges halve;
/// area and volume approach those of the sphere as h².
#[test]
fn a_sphere_in_the_limit() {
    let at = |n| {
        let (r, v) = of(&shapes::icosphere(n, &Device::flex()));
        let h = r.mean_edge_length(&v).expect("a length");
        let uniform = scalar(r.laplacian(v.clone()));
        let cotangent = scalar(r.laplacian_cotangent(v.clone()));
        let area = scalar(r.area(v.clone()));
        (h, uniform, cotangent, area, scalar(r.volume(v)))
    };
    use std::f64::consts::PI;
    let (coarse, fine) = (at(3), at(4));
    println!("{coarse:?} {fine:?}");
    close(coarse.2 / fine.2, 16.0, 0.5);
    // Edges differ by up to 20 % in length, and so do their fourth powers from the mean's.
    close(fine.2 / (fine.0.powi(2) / 2.0).powi(2), 1.0, 0.1);
    assert!(fine.1 >= fine.2 * 0.99, "uniform weights see edges too");
    close((4.0 * PI - coarse.3) / (4.0 * PI - fine.3), 4.0, 0.1);
    let ball = 4.0 / 3.0 * PI;
    close((ball - coarse.4) / (ball - fine.4), 4.0, 0.1);
}

#[test]
fn equal_to_plain_loops() {
    for device in cpu_devices() {
        for mesh in [
            shapes::icosphere(1, &device),
            shapes::torus(1.0, 0.4, 9, 5, &device),
        ] {
            let v = shaken(&points(&mesh), 0.15, 3);
            let r = MeshRegularizer::from_mesh(&mesh).expect("a mesh");
            let t = || batch(std::slice::from_ref(&v), &device, DType::F64);
            let weights = cotangents(&v, &mesh.faces);
            let uniform = weights.keys().map(|e| (*e, 1.0)).collect();
            close(scalar(r.laplacian(t())), umbrella(&v, &uniform), 1e-13);
            close(
                scalar(r.laplacian_cotangent(t())),
                umbrella(&v, &weights),
                1e-13,
            );
            let expected = bends(&v, &mesh.faces, |c| 1.0 - c);
            close(scalar(r.normal_consistency(t())), expected, 1e-13);
            let expected = bends(&v, &mesh.faces, |c| (1.0 - c) * (1.0 - c));
            close(scalar(r.flatness(t())), expected, 1e-13);
        }
    }
}

/// Against differences in f64, of a batch of two: rounding of the values, about 1e-15, over the step
/// leaves up to 1e-8 of the largest.
#[test]
fn gradients_are_central_differences() {
    let step = 1e-6;
    for device in cpu_devices() {
        let mesh = shapes::icosphere(1, &device);
        let r = MeshRegularizer::from_mesh(&mesh).expect("a mesh");
        let meshes = [1, 2].map(|seed| shaken(&points(&mesh), 0.1, seed));
        let fixed = meshes.each_ref().map(|v| cotangents(v, &mesh.faces));
        for (name, loss) in LOSSES {
            let value = |meshes: &[Vec<DVec3>; 2]| {
                if name == "laplacian_cotangent" {
                    // With the weights of the place, as they have no gradient.
                    (umbrella(&meshes[0], &fixed[0]) + umbrella(&meshes[1], &fixed[1])) / 2.0
                } else {
                    scalar(loss(&r, batch(meshes, &device, DType::F64)))
                }
            };
            let leaf = batch(&meshes, &device.clone().autodiff(), DType::F64).require_grad();
            let tape = loss(&r, leaf.clone()).backward();
            let gradient = gradient(&leaf, &tape);
            let size = largest(gradient.iter().copied());
            assert!(size > 1e-3, "{name}: {size}");
            let mut apart = Vec::new();
            for entry in (0..gradient.len()).step_by(5) {
                let moved = |by: f64| {
                    let mut m = meshes.clone();
                    let per_mesh = gradient.len() / 2;
                    let row = entry % per_mesh;
                    m[entry / per_mesh][row / 3][row % 3] += by;
                    value(&m)
                };
                let difference = (moved(step) - moved(-step)) / (2.0 * step);
                apart.push(difference - gradient[entry]);
            }
            let worst = largest(apart);
            println!("{device:?} {name}: {worst:e} of {size:e}");
            assert!(worst < 1e-6 * size, "{name}: {worst:e}");
        }
    }
}

#[test]
fn a_batch_is_its_items() {
    let device = Device::flex();
    let mesh = shapes::torus(1.0, 0.4, 8, 6, &device);
    let r = MeshRegularizer::from_mesh(&mesh).expect("a mesh");
    let meshes: Vec<_> = (0..3).map(|s| shaken(&points(&mesh), 0.1, s)).collect();
    let together = batch(&meshes, &device, DType::F64);
    let alone = |i: usize| batch(&meshes[i..=i], &device, DType::F64);
    for (name, loss) in LOSSES {
        let sum: f64 = (0..3).map(|i| scalar(loss(&r, alone(i)))).sum();
        let expected = if ["volume", "area"].contains(&name) {
            sum
        } else {
            sum / 3.0
        };
        close(scalar(loss(&r, together.clone())), expected, 1e-12);
    }
    let volumes = values(&r.volume(together.clone()));
    let areas = values(&r.area(together));
    assert_eq!((volumes.len(), areas.len()), (3, 3));
    for i in 0..3 {
        close(volumes[i], scalar(r.volume(alone(i))), 1e-12);
        close(areas[i], scalar(r.area(alone(i))), 1e-12);
    }
}

/// Ragged batches: two meshes as one of disjoint parts.
#[test]
fn disjoint_parts_are_one_mesh() {
    let device = Device::flex();
    let (a, b) = (tetrahedron(&device), shapes::cube(&device));
    let shift = |f: &[u32; 3]| f.map(|i| i + 4);
    let faces: Vec<_> = a
        .faces
        .iter()
        .copied()
        .chain(b.faces.iter().map(shift))
        .collect();
    let r = MeshRegularizer::new(&faces, 12, &device).expect("a mesh");
    let v = batch(&[[points(&a), points(&b)].concat()], &device, DType::F64);
    close(scalar(r.volume(v.clone())), 8.0 / 3.0 + 8.0, 1e-12);
    // 6 edges of 4/3 and 18 of 2/3.
    close(scalar(r.normal_consistency(v)), (8.0 + 12.0) / 24.0, 1e-12);
}

#[test]
fn finite_on_degenerate_triangles() {
    for device in cpu_devices() {
        let mesh = shapes::icosphere(1, &device);
        // A face that names a vertex twice, one used three times, and a vertex without faces.
        let mut faces = mesh.faces.to_vec();
        faces.extend([[0, 0, 1], faces[0], faces[0]]);
        let whole = points(&mesh);
        let r = MeshRegularizer::new(&faces, whole.len() + 1, &device).expect("a mesh");
        let with = |change: fn(usize, DVec3) -> DVec3| -> Vec<DVec3> {
            let mut v: Vec<_> = whole
                .iter()
                .enumerate()
                .map(|(i, v)| change(i, *v))
                .collect();
            v.push(DVec3::splat(0.1));
            v
        };
        let cases = [
            ("a point", with(|_, _| DVec3::ONE)),
            ("a line", with(|_, v| DVec3::new(v.x, 2.0 * v.x, 0.0))),
            (
                "two together",
                with(|i, v| if i < 2 { DVec3::X } else { v }),
            ),
            (
                "many together",
                with(|i, v| if i < 20 { DVec3::X } else { v }),
            ),
            ("a needle", with(|i, v| if i == 0 { v * 1e-9 } else { v })),
            (
                "nearly a line",
                with(|_, v| DVec3::new(v.x, 1e-7 * v.y, 1e-7 * v.z)),
            ),
            ("flat", with(|_, v| DVec3::new(v.x, 0.0, v.z))),
            ("tiny", with(|_, v| v * 1e-6)),
            ("huge", with(|_, v| v * 1e6)),
        ];
        for (case, v) in cases {
            for dtype in [DType::F32, DType::F64] {
                for (name, loss) in LOSSES {
                    let meshes = [v.clone(), with(|_, v| v)];
                    let leaf = batch(&meshes, &device.clone().autodiff(), dtype).require_grad();
                    let value = loss(&r, leaf.clone());
                    assert!(values(&value)[0].is_finite(), "{case} {dtype:?} {name}");
                    let gradient = gradient(&leaf, &value.backward());
                    let finite = gradient.iter().all(|g| g.is_finite());
                    assert!(finite, "gradient: {case} {dtype:?} {name}");
                }
            }
        }
    }
}

/// Angles don't depend on the size of a mesh, in f32 either.
#[test]
fn bends_are_the_same_at_any_scale() {
    let device = Device::flex();
    let mesh = shapes::icosphere(2, &device);
    let r = MeshRegularizer::from_mesh(&mesh).expect("a mesh");
    let v = shaken(&points(&mesh), 0.05, 4);
    for (name, loss) in &LOSSES[2..4] {
        let at = |scale: f64, dtype| {
            let v = v.iter().map(|v| *v * scale).collect();
            scalar(loss(&r, batch(&[v], &device, dtype)))
        };
        let expected = at(1.0, DType::F64);
        for scale in [1e-12, 1e-6, 1.0, 1e6, 1e12] {
            let found = at(scale, DType::F32);
            println!("{name} at {scale:e}: {found} {expected}");
            close(found, expected, 1e-5 * expected);
        }
    }
}

/// Without an edge of two faces a bend is 0, and still in the graph.
#[test]
fn one_triangle_has_no_bends() {
    let device = Device::flex().autodiff();
    let mesh = shapes::triangle([0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], &device);
    let r = MeshRegularizer::from_mesh(&mesh).expect("a mesh");
    let leaf = mesh.vertices.require_grad();
    for (_, loss) in &LOSSES[2..4] {
        let value = loss(&r, leaf.clone().unsqueeze());
        assert_eq!(scalar(value.clone()), 0.0);
        let gradient = gradient(&leaf, &value.backward());
        assert!(gradient.iter().all(|g| *g == 0.0));
    }
}

/// Untracked vertices, on a device with and without autodiff, add to tracked losses.
#[test]
fn tracked_and_untracked_mix() {
    let plain = Device::flex();
    let mesh = shapes::cube(&plain);
    let r = MeshRegularizer::from_mesh(&mesh).expect("a mesh");
    let constant: Tensor<3> = mesh.vertices.clone().autodiff().unsqueeze();
    let leaf = mesh.vertices.clone().autodiff().require_grad();
    for (name, loss) in LOSSES {
        let sum = loss(&r, constant.clone()) + loss(&r, leaf.clone().unsqueeze());
        let gradient = leaf.grad(&sum.backward());
        assert!(gradient.is_some(), "{name}");
    }
    // And a regularizer that was made on a device with autodiff takes plain vertices.
    let (r, _) = of(&shapes::cube(&plain.autodiff()));
    close(scalar(r.volume(mesh.vertices.unsqueeze())), 8.0, 1e-5);
}

#[test]
fn errors_name_the_field_and_the_value() {
    let device = Device::flex();
    let of = |faces: &[[u32; 3]]| message(MeshRegularizer::new(faces, 3, &device));
    says(of(&[]), ["faces is without a triangle"]);
    says(of(&[[0, 0, 1]]), ["three different vertices"]);
    let beyond = of(&[[0, 1, 2], [0, 1, 3]]);
    says(beyond, ["face 1 is [0, 1, 3], expected indices under 3"]);
}

#[test]
#[should_panic(expected = "vertices have shape [1, 4, 3], expected [_, 8, 3]")]
fn vertices_of_another_mesh_are_refused() {
    let device = Device::flex();
    let (r, _) = of(&shapes::cube(&device));
    let (_, v) = of(&tetrahedron(&device));
    let _ = r.laplacian(v);
}
