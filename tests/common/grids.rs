//! Surfaces of grids of signed distances on a device: two grids of different topology in one batch of renders.

use burn::tensor::DType;
use softray::modules::TetrahedralGrid;
use softray::prelude::*;

use super::numbers::{apart, noise};
use super::tensors::{gradient, tensor, values};

/// What a device computes of grids.
pub struct OfGrids {
    faces: Vec<Vec<[u32; 3]>>,
    vertices: Vec<f64>,
    soft: Vec<f64>,
    /// Of vertices and soft silhouettes, by distances and offsets.
    by: Vec<f64>,
    radiance: Vec<f64>,
    /// Of the radiance, by distances and offsets.
    radiance_by: Vec<f64>,
}

/// A torus and a ball, with offsets without a pattern.
pub fn of_grids(device: &Device) -> OfGrids {
    let grid = TetrahedralGrid::new(10, 2.0).expect("a grid");
    let (n, size) = (grid.size(), grid.size().pow(3));
    let nodes = values(&grid.nodes(&Device::flex()));
    let torus = |p: &[f64]| (p[0].hypot(p[1]) - 0.55).hypot(p[2]) - 0.25;
    let ball = |p: &[f64]| p[0].hypot(p[1]).hypot(p[2]) - 0.61;
    let fields = nodes.chunks(3).map(torus).chain(nodes.chunks(3).map(ball));
    let fields: Vec<f64> = fields.collect();
    let leaf = |t: Tensor<1>| t.autodiff().require_grad();
    let distances = leaf(tensor(&fields, [2 * size], device, DType::F32));
    let offsets = leaf(tensor(&noise(6 * size, 1), [6 * size], device, DType::F32));
    let shaped = distances.clone().reshape([2, n, n, n]);
    let moved = offsets.clone().reshape([2, n, n, n, 3]);
    let meshes = grid
        .surfaces(shaped.clone(), Some(moved))
        .expect("surfaces");

    let weighted = |t: Tensor<1>| {
        let weights = noise(t.dims()[0], 2);
        (t.clone() * tensor(&weights, t.dims(), device, DType::F32).autodiff()).sum()
    };
    let by = |loss: Tensor<1>| {
        let gradients = loss.backward();
        [
            gradient(&distances, &gradients),
            gradient(&offsets, &gradients),
        ]
        .concat()
    };
    let camera = Camera::look_at([0.4, 0.3, 4.0], [0.0; 3]).with_fov_y(32.0);
    let views = [(0, camera.clone()), (1, camera.clone())];
    let soft = grid
        .opacity(shaped, &views, [12, 10], 0.2)
        .expect("silhouettes");
    let vertices = Tensor::cat(meshes.iter().map(|m| m.vertices.clone()).collect(), 0);
    let shape = weighted(vertices.clone().flatten(0, 1)) + weighted(soft.clone().flatten(0, 2));

    let scene = |mesh: &Mesh| {
        let body = Object::new(mesh.clone()).with_material(Material::diffuse([0.7; 3]));
        Scene::new().with_object(body).with_environment([1.0; 3])
    };
    let scenes = meshes.iter().map(scene).collect();
    let batch = Batch::views(scenes, views.into()).expect("a batch");
    let options = RenderOptions::new(12, 10).with_samples(4).with_bounces(1);
    let radiance = render_batch(&batch, &options).expect("images").radiance;
    OfGrids {
        faces: meshes.iter().map(|mesh| mesh.faces.to_vec()).collect(),
        vertices: values(&vertices),
        soft: values(&soft),
        by: by(shape),
        radiance_by: by(weighted(radiance.clone().flatten(0, 3))),
        radiance: values(&radiance),
    }
}

/// Vertices, soft silhouettes and their derivatives agree but for rounding. It lets a few samples of renders hit other
/// faces.
pub fn assert_close(found: &OfGrids, wanted: &OfGrids) {
    assert!(found.faces == wanted.faces, "other faces");
    for (what, found, wanted, bound) in [
        ("vertices", &found.vertices, &wanted.vertices, 1e-5),
        ("soft silhouettes", &found.soft, &wanted.soft, 1e-5),
        ("derivatives", &found.by, &wanted.by, 1e-4),
        ("radiance", &found.radiance, &wanted.radiance, 1e-2),
        (
            "its derivatives",
            &found.radiance_by,
            &wanted.radiance_by,
            2e-2,
        ),
    ] {
        let apart = apart(found, wanted);
        println!("{what}: {apart:.1e} apart");
        assert!(apart < bound, "{what}: {apart}");
    }
}
