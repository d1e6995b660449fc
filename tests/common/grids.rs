//! Surfaces of grids of signed distances on a device.

use burn::tensor::DType;
use softray::modules::TetrahedralGrid;
use softray::prelude::*;

use super::numbers::{apart, noise};
use super::tensors::{gradient, tensor, values};

/// What a device computes of two grids, a torus and a ball, with offsets without a pattern.
pub struct OfGrids {
    faces: Vec<Vec<[u32; 3]>>,
    vertices: Vec<f64>,
    soft: Vec<f64>,
    /// Derivatives of a weighted sum of vertices and soft silhouettes.
    by_distances: Vec<f64>,
    by_offsets: Vec<f64>,
}

pub fn of_grids(device: &Device) -> OfGrids {
    let grid = TetrahedralGrid::new(10, 2.0).expect("a grid");
    let (n, count) = (grid.size(), 2 * grid.size().pow(3));
    let nodes = values(&grid.nodes(&Device::flex()));
    let torus = |p: &[f64]| (p[0].hypot(p[1]) - 0.55).hypot(p[2]) - 0.25;
    let ball = |p: &[f64]| p[0].hypot(p[1]).hypot(p[2]) - 0.61;
    let fields = nodes.chunks(3).map(torus).chain(nodes.chunks(3).map(ball));
    let fields: Vec<f64> = fields.collect();
    let distances = tensor(&fields, [2, n, n, n], device, DType::F32);
    let distances = distances.autodiff().require_grad();
    let offsets = noise(3 * count, 1);
    let offsets = tensor(&offsets, [2, n, n, n, 3], device, DType::F32);
    let offsets = offsets.autodiff().require_grad();

    let meshes = grid.surfaces(distances.clone(), Some(offsets.clone()));
    let meshes = meshes.expect("surfaces");
    let vertices: Vec<_> = meshes.iter().map(|mesh| mesh.vertices.clone()).collect();
    let vertices = Tensor::cat(vertices, 0).flatten::<1>(0, 1);
    let camera = Camera::look_at([0.4, 0.3, 4.0], [0.0; 3]).with_fov_y(32.0);
    let views = [(0, camera.clone()), (1, camera)];
    let soft = grid.opacity(distances.clone(), &views, [12, 10], 0.2);
    let soft = soft.expect("silhouettes").flatten::<1>(0, 2);
    let weighted = |t: &Tensor<1>| {
        let weights = tensor(&noise(t.dims()[0], 2), t.dims(), device, DType::F32);
        (t.clone() * weights.autodiff()).sum()
    };
    let gradients = (weighted(&vertices) + weighted(&soft)).backward();
    OfGrids {
        faces: meshes.iter().map(|mesh| mesh.faces.to_vec()).collect(),
        vertices: values(&vertices),
        soft: values(&soft),
        by_distances: gradient(&distances, &gradients),
        by_offsets: gradient(&offsets, &gradients),
    }
}

pub fn assert_close(found: &OfGrids, wanted: &OfGrids, bound: f64) {
    assert!(found.faces == wanted.faces, "other faces");
    for (what, found, wanted) in [
        ("vertices", &found.vertices, &wanted.vertices),
        ("soft silhouettes", &found.soft, &wanted.soft),
        ("by distances", &found.by_distances, &wanted.by_distances),
        ("by offsets", &found.by_offsets, &wanted.by_offsets),
    ] {
        let apart = apart(found, wanted);
        println!("{what}: {apart:.1e} apart");
        assert!(apart < bound, "{what}: {apart}");
    }
}
